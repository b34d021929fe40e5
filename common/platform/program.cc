#include "common/platform/program.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/platform/arguments.h"
#include "common/platform/keys.h"
#include "common/platform/realtime.h"
#include "common/platform/watchdog.h"
#include "common/record/summary.h"
#include "common/scene/find.h"
#include "common/scene/hints.h"
#include "common/scene/load.h"

namespace twoport {
namespace {

constexpr const char* kDefaultPage = "127.0.0.1:45080";

std::string version_line(const std::string& program) {
  return fmt::format("{} {} (wire protocol {})", program, TWOPORT_VERSION, kProtocolVersion & 0xffff);
}

}  // namespace

int live_program(int argc, char** argv, Side side, const std::string& drivers,
                 const std::function<int(const Scene&, const LiveArguments&)>& body) {
  const bool master = side == Side::master;
  const std::string name = std::string{"twoport-"} + to_string(side);
  const std::string hardware_flag = master ? "--device" : "--robot";
  CLI::App app{name + (master ? ": hand and haptic device, live" : ": robot and force sensor, live")};
  app.set_version_flag("--version", version_line(name));
  LiveArguments a;
  a.address = "127.0.0.1:45000";
  app.add_option("--scene", a.scene, "Scene file (.textproto), or the name of a scene of the project")
      ->transform(scene_file)
      ->required();
  app.add_option("--set", a.set, "Override, PATH=VALUE, e.g. control.passivity.method=NONE")->take_all();
  std::string duration;
  app.add_option(
      "--duration", duration,
      "SECONDS from the start of the program to its end, waiting for the other side included; replaces duration_s of "
      "the scene, which counts from the first contact with the other side. Without either, until Ctrl-C");
  app.add_option(master ? "--peer" : "--listen", a.address, "ADDR:PORT, an IP address or a host name")
      ->capture_default_str();
  app.add_option(
      "--key", a.key,
      std::string{"File with the key that both programs share, made by twoport-keygen"} +
          (master ? "" : ", or a folder of them, a key for each master that may come") +
          ": encrypts and authenticates every packet. Without it only addresses of this machine are allowed");
  if (master)
    app.add_option("--rekey-after", a.rekey_after_s,
                   "SECONDS after which new keys of packets are agreed on with the slave, beside the running session")
        ->check(CLI::Range(1.0, 600.0))
        ->capture_default_str();
  app.add_flag("--insecure", a.insecure,
               "Without a key, allow addresses of other machines too: anyone there can take over");
  app.add_option(hardware_flag, a.hardware, std::string{"NAME[:ARGS], "} + (master ? "the haptic device" : "the robot"))
      ->capture_default_str();
  app.add_flag_callback(
      "--list-devices",
      [&] {
        std::fputs(drivers.c_str(), stdout);
        throw CLI::Success{};
      },
      "One line for each NAME of " + hardware_flag);
  CLI::Option* page = nullptr;
  if (master) {
    page = app.add_option("--page", a.page,
                          std::string{"ADDR:PORT, default "} + kDefaultPage +
                              ": serves a page that shows the run and takes the pointer of --device page as the hand");
    page->expected(0, 1);
    app.add_option("--page-world", a.page_world,
                   "The --robot of the slave, where that is mujoco:FILE.xml...: what the page draws around the robot");
    app.add_flag(
        "--restartable", a.restartable,
        "The page has a button that ends this program with exit status 4, for whoever starts it and the slave again");
  }
  if (!master)
    app.add_flag("--fixed-environment", a.fixed_environment,
                 "Refuse the page's sliders for stiffness and friction of the simulated environment");
  app.add_option("--stop-port", a.stop_port,
                 "PORT: a datagram to 127.255.255.255:PORT stops every program of this machine that listens there, and "
                 "the other side: no force until both have ended")
      ->check(CLI::Range(1, 65535));
  app.add_option("--dscp", a.dscp,
                 "Mark of this program's datagrams to the other side, for networks that give priority by it (RFC "
                 "2474): 46 is expedited forwarding")
      ->check(CLI::Range(0, 63));
  app.add_option("--out", a.out, "Folder for summary.json and trace.csv");
  app.add_option("--record", a.record,
                 "FILE.mcap: everything that this side takes in and puts out, for twoport-lab replay and export, "
                 "Foxglove, PlotJuggler and Python; readable even after kill -9");
  app.add_option("--foxglove", a.foxglove,
                 "ADDR:PORT: the channels of a recording, live, for Foxglove and Lichtblick (port 8765)");
  app.add_option(
      "--stream", a.stream,
      "HOST:PORT: the columns of the trace as UDP datagrams, one JSON object each, for PlotJuggler (port 9870)");
  app.add_option("--stream-hz", a.stream_hz, "Datagrams of --stream in a second, at most")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  app.add_option("--trace", a.trace, "none or csv")->check(CLI::IsMember({"none", "csv"}))->capture_default_str();
  app.add_option("--trace-every", a.trace_every, "N: one tick in N has a row in the trace; the summary is of all ticks")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000'000}))
      ->capture_default_str();
  app.add_flag("!--no-realtime", a.realtime, "Do not request real-time scheduling or locked memory");
  app.add_flag("!--no-spin", a.spin, "Sleep until the tick, without busy-waiting for the last 50 us");
  return run_program(app, name, argc, argv, [&] {
    if (page != nullptr && page->count() > 0 && a.page.empty()) a.page = kDefaultPage;
    if (master && a.page.empty() && a.hardware == "page") a.page = kDefaultPage;
    if (!std::isfinite(a.rekey_after_s)) throw ConfigError("--rekey-after: must be between 1 and 600");
    if (!std::isfinite(a.stream_hz)) throw ConfigError("--stream-hz: must be between 0.1 and 1000");
    if (!duration.empty()) a.set.push_back("duration_s=" + duration);
    const Scene scene = load_scene(a.scene, a.set, SceneFor::live);
    if (!duration.empty()) a.limit_s = scene.duration_s;
    if (scene.control.architecture == Architecture::uncontrolled)
      throw ConfigError(a.scene +
                        ": control.architecture is UNCONTROLLED, which does not run live; use twoport-lab run");
    stop_on_signals();   // before hardware is opened, so that whatever has been opened is released
    switches_by_hand();  // SIGUSR1 to a slave counts, and does nothing
    zeroings_by_hand();  // before anything has real-time priority
    const Watchdog watchdog{name};
    return body(scene, a);
  });
}

std::string program_name(const std::string& side) {
  return "twoport-" + side + " " TWOPORT_VERSION;
}

void print_hints(const Scene& scene, const LiveArguments& a, bool device_is_simulated) {
  for (const std::string& sentence : live_hints(scene, device_is_simulated))
    print_error("{}: warning: {}\n", a.scene, sentence);
}

RunFolder begin_folder(const LiveArguments& a, const std::function<void()>& before_clearing) {
  if (a.out.empty()) {
    before_clearing();
    return {};
  }
  std::error_code error;
  std::filesystem::create_directories(a.out, error);
  if (error) throw ConfigError(fmt::format("--out {}: cannot be created: {}", a.out, error.message()));
  RunFolder folder{std::make_unique<FolderLock>(a.out, "--out"), nullptr};
  before_clearing();
  if (a.trace == "csv") folder.trace = std::make_unique<WholeFile>(a.out + "/trace.csv");
  for (const char* name : {"/summary.json", "/trace.csv", "/trace-gripper.csv"}) {
    std::filesystem::remove(a.out + name, error);
    if (error)
      throw ConfigError(fmt::format("{}{}: of an earlier run cannot be removed: {}", a.out, name, error.message()));
  }
  return folder;
}

int leave_files(const Scene& scene, const LiveArguments& a, const std::string& side, WholeFile* trace, Summary s) {
  describe_run(scene, side, s);
  const auto written = [&](auto write) {
    try {
      write();
      return true;
    } catch (const std::exception& e) {
      print_error("twoport-{}: {}\n", side, e.what());
      return false;
    }
  };
  const bool has_trace = trace == nullptr || written([&] { trace->commit_rows(); });
  const bool has_summary = written([&] { leave_summary(s, a.out); });
  if (has_summary && !a.out.empty())
    fmt::print("{} {}: {}; {} in {}\n", side, in_one_line(scene.name), s.verdict(),
               trace != nullptr && has_trace ? "summary and trace" : "summary", a.out);
  return has_trace && has_summary ? 0 : 1;
}

int judge(const Scene& scene, const LiveArguments& a, const Summary& s) {
  ExpectSpec expect = scene.expect;
  const bool apart = s.has_coupled_at_end() && !s.coupled_at_end();
  if (expect.stable && s.verdict_kind() == to_string(VerdictKind::undecided) && !apart) {
    // What a side cannot know breaks no promise.
    print_error("{}: warning: stable is not judged: {}\n", a.scene, s.verdict());
    expect.stable.reset();
  }
  const std::vector<std::string> violated = violations(expect, s);
  for (const std::string& sentence : violated) print_error("{}: {}\n", a.scene, sentence);
  return violated.empty() ? 0 : 3;
}

Percentiles percentiles(const Histogram& h, double unit_ns) {
  const auto in_units = [&](Duration d) { return static_cast<double>(d.count()) / unit_ns; };
  Percentiles all;
  all.set_p50(in_units(h.percentile(0.5)));
  all.set_p99(in_units(h.percentile(0.99)));
  all.set_p999(in_units(h.percentile(0.999)));
  all.set_max(in_units(h.max()));
  return all;
}

}  // namespace twoport
