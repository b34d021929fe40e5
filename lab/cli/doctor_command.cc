#include <fmt/format.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <string>
#include <system_error>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/link/link_trace.h"
#include "common/platform/realtime.h"
#include "common/platform/udp.h"
#include "lab/cli/commands.h"
#include "lab/study/link_advice.h"
#include "lab/study/parallel.h"
#include "tools/doctor/examine.h"
#include "tools/doctor/link.h"
#include "tools/doctor/loop.h"

namespace twoport::lab {
namespace {

using namespace twoport::doctor;

struct DoctorArguments {
  double rate_hz = 1000.0;
  double seconds = 0.0;  ///< 0: of the kind of measurement
  bool realtime = true, spin = true, json = false;
  std::string link, answer, save;
  LinkRequest request;
  double stiffness = 1000.0;
  int seeds = 1, jobs = all_cores();
};

double us(Duration d) {
  return 1e-3 * static_cast<double>(d.count());
}
double ms(Duration d) {
  return 1e-6 * static_cast<double>(d.count());
}

void print_json(const LoopFigures& loop, const std::vector<Finding>& findings) {
  fmt::print(
      "{{\n \"loop\": {{\"grade\": {}, \"rate_hz\": {}, \"ticks\": {}, \"skipped\": {}, \"late_us\": {{\"p50\": "
      "{:.3f}, \"p99\": {:.3f}, \"p999\": {:.3f}, \"max\": {:.3f}}},\n  \"late\": {{\"ticks\": {}, \"preempted\": {}, "
      "\"waited\": {}, \"moved\": {}, \"faulted\": {}, \"unexplained\": {}}},\n  \"not_permitted\": [",
      json_string(to_string(grade(loop))), loop.rate_hz, loop.ticks, loop.skipped, us(loop.lateness.percentile(0.5)),
      us(loop.lateness.percentile(0.99)), us(loop.lateness.percentile(0.999)), us(loop.lateness.max()), loop.late,
      loop.preempted, loop.waited, loop.moved, loop.faulted, loop.unexplained);
  for (std::size_t i = 0; i < loop.not_permitted.size(); ++i)
    fmt::print("{}{}", i > 0 ? ", " : "", json_string(loop.not_permitted[i]));
  fmt::print("]}},\n \"checks\": [");
  for (std::size_t i = 0; i < findings.size(); ++i) {
    const Finding& f = findings[i];
    fmt::print("{}\n  {{\"name\": {}, \"grade\": {}, \"says\": {}, \"cure\": {}}}", i > 0 ? "," : "",
               json_string(f.name), json_string(to_string(f.grade)), json_string(f.says), json_string(f.cure));
  }
  fmt::print("\n ]\n}}\n");
}

void print_text(const LoopFigures& loop, const std::vector<Finding>& findings) {
  fmt::print("{:<7} loop, as permitted here: {}\n", to_string(grade(loop)), describe(loop));
  if (const std::string why = blame(loop); !why.empty()) fmt::print("{:<7} {}\n", "", why);
  for (const std::string& sentence : loop.not_permitted) fmt::print("{:<7} without: {}\n", "", sentence);
  for (const Finding& f : findings) {
    fmt::print("{:<7} {}: {}\n", to_string(f.grade), f.name, f.says);
    if (!f.cure.empty()) fmt::print("{:<7}   cure: {}\n", "", f.cure);
  }
}

int loop_command(const DoctorArguments& a) {
  const Permissions may = probe_permissions();
  const auto now_s = [] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  };
  const Counters before = read_counters(read_file, now_s());
  const LoopFigures loop = measure_loop(
      {.rate_hz = a.rate_hz, .seconds = a.seconds > 0.0 ? a.seconds : 2.0, .realtime = a.realtime, .spin = a.spin});
  const Counters after = read_counters(read_file, now_s());
  const std::vector<Finding> findings = examine(read_file, may, before, after);
  if (a.json) {
    print_json(loop, findings);
  } else {
    print_text(loop, findings);
  }
  return grade(loop) == Grade::bad ? 3 : 0;
}

int link_command(const DoctorArguments& a) {
  const std::atomic<bool>& stop = stop_on_signals();
  LinkRequest request = a.request;
  request.address = a.link;
  parse_allowed_endpoint(request.address, "--link", !request.key.empty(), request.insecure);
  request.rate_hz = a.rate_hz;
  request.seconds = a.seconds > 0.0 ? a.seconds : 10.0;
  if (const double packets = request.seconds * request.rate_hz; packets > kMostPackets)
    throw ConfigError{fmt::format("--seconds {:g} at {:g} Hz are {:.0f} packets; a measurement has at most {:.0f}",
                                  request.seconds, request.rate_hz, packets, kMostPackets)};
  std::optional<WholeFile> saved;
  if (!a.save.empty()) {
    std::error_code none;
    std::string header(kLinkTraceHeader.size(), '\0');
    if (std::filesystem::is_regular_file(a.save, none) && std::filesystem::file_size(a.save, none) > 0 &&
        (!std::ifstream{a.save}.read(header.data(), static_cast<std::streamsize>(header.size())) ||
         header != kLinkTraceHeader))
      throw ConfigError{"--save " + a.save + ": the file is there and holds no link; give another name"};
    saved.emplace(a.save);
  }
  const LinkFigures f = measure_link(request, stop);
  if (f.silent_s > 0.0)
    print_error("{} has been silent for the last {:.1f} s; was it ended? What follows is of the {:.1f} s before\n",
                a.link, f.silent_s, f.seconds);
  const double round_trip_s = 1e-3 * ms(f.round_trip.percentile(0.5));
  const LinkTrace trace = f.trace();
  if (saved) {
    saved->write(to_csv(trace));
    saved->commit();
  }
  const DirectionFigures to_slave = f.to_slave.figures(), to_master = f.to_master.figures();
  const LinkAdvice advice = recommend(
      trace,
      {.scene = {}, .set = {}, .methods = {}, .stiffnesses_n_per_m = {a.stiffness}, .seeds = a.seeds, .jobs = a.jobs},
      show_progress);
  const double back_ms = f.clock_known ? 1e3 * f.clock.one_way_s : 0.0,
               bound_ms = f.clock_known ? 1e3 * f.clock.bound_s : 0.0;
  const double there_ms = 1e3 * round_trip_s - back_ms;
  if (a.json) {
    fmt::print(
        "{{\n \"address\": {}, \"seconds\": {:.3f}, \"silent_s\": {:.3f}, \"rate_hz\": {}, \"sent\": {}, "
        "\"encrypted\": {},\n \"round_trip_ms\": {{\"p50\": {:.3f}, \"p99\": {:.3f}, \"max\": {:.3f}}},\n "
        "\"one_way_ms\": {{\"to_slave\": {:.3f}, \"to_master\": {:.3f}, \"bound\": {:.3f}}},\n \"to_slave\": {},\n "
        "\"to_master\": {},\n \"advice\": {{\"method\": {}, \"why\": {}, \"to_slave.playout_ms\": {}, "
        "\"to_master.playout_ms\": {}, \"control.hold_after_s\": {:.2f}, \"control.passivity.round_trip_ms\": {:.1f}, "
        "\"control.passivity.initial_energy_j\": {:.4g}}}\n}}\n",
        json_string(a.link), f.seconds, f.silent_s, a.rate_hz, f.sent, f.encrypted, ms(f.round_trip.percentile(0.5)),
        ms(f.round_trip.percentile(0.99)), ms(f.round_trip.max()), there_ms, back_ms, bound_ms, to_json(to_slave),
        to_json(to_master), json_string(advice.method), json_string(advice.why[0]), advice.to_slave.playout_ms,
        advice.to_master.playout_ms, advice.hold_after_s, advice.round_trip_ms(), advice.initial_energy_j);
    return f.silent_s > 0.0 ? 3 : 0;
  }
  fmt::print("{}: {:.1f} s at {:g} Hz, {} packets sent, {}\n", a.link, f.seconds, a.rate_hz, f.sent,
             f.encrypted ? "encrypted" : "not encrypted");
  fmt::print("round trip: {:.2f} ms in the median, {:.2f} ms at 99 %, {:.2f} ms at most\n",
             ms(f.round_trip.percentile(0.5)), ms(f.round_trip.percentile(0.99)), ms(f.round_trip.max()));
  if (f.clock_known)
    fmt::print(
        "one way: {:.2f} ms there, {:.2f} ms back, if the fastest packet took as long there as back; at most {:.2f} ms "
        "wrong\n",
        there_ms, back_ms, bound_ms);
  fmt::print("{:<10} {:>9} {:>7} {:>8} {:>10} {:>11} {:>24} {:>12}\n", "", "received", "lost", "late", "duplicated",
             "in a row", "jitter: 50, 99 %, most ms", "longest gap");
  for (const auto& [name, d] : {std::pair{"to_slave", to_slave}, {"to_master", to_master}})
    fmt::print("{:<10} {:>9} {:>6.2f}% {:>8} {:>10} {:>11.1f} {:>8.2f} {:>7.2f} {:>7.2f} {:>9.1f} ms\n", name,
               d.received, 100.0 * d.loss(), d.late, d.duplicated, d.burst_packets, 1e3 * d.jitter_p50_s,
               1e3 * d.jitter_p99_s, 1e3 * d.jitter_max_s, 1e3 * d.longest_gap_s);
  fmt::print("\nFor a scene over this link, with a wall of {:g} N/m:\n", a.stiffness);
  std::fputs(to_text(advice).c_str(), stdout);
  if (saved) fmt::print("{}: {} packets\n", a.save, trace.to_slave.size() + trace.to_master.size());
  return f.silent_s > 0.0 ? 3 : 0;
}

int answer_command(const DoctorArguments& a) {
  LinkRequest request = a.request;
  request.address = a.answer.find(':') == std::string::npos ? "127.0.0.1:" + a.answer : a.answer;
  parse_allowed_endpoint(request.address, "--answer", !request.key.empty(), request.insecure);
  request.rate_hz = a.rate_hz;
  request.seconds = a.seconds > 0.0 ? a.seconds : std::numeric_limits<double>::infinity();
  answer(request, stop_on_signals());
  return 0;
}

}  // namespace

void add_doctor_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<DoctorArguments>();
  CLI::App& doctor = *app.add_subcommand(
      "doctor", "Why is the loop late, why is the link bad: measures and names the causes, each with a cure");
  doctor.add_option("--rate-hz", a->rate_hz, "Of the loop, or of packets")
      ->check(CLI::Range(1.0, 1e4))
      ->capture_default_str();
  doctor.add_option("--seconds", a->seconds, "To measure; absent: 2 for the loop, 10 for a link, no end for --answer")
      ->check(CLI::Range(0.05, 1e6));
  CLI::Option* link =
      doctor.add_option("--link", a->link, "HOST:PORT where a doctor answers: measures the link to there");
  doctor
      .add_option("--save", a->save,
                  "FILE.csv: a row for each packet of --link, for trace_file of a scene and --link of recommend")
      ->needs(link);
  doctor
      .add_option("--answer", a->answer,
                  "[ADDR:]PORT: is the other end of --link, until Ctrl-C. PORT alone: of 127.0.0.1")
      ->excludes(link);
  doctor.add_option("--key", a->request.key, "File of twoport-keygen, as for the programs; both ends need the same");
  doctor.add_flag("--insecure", a->request.insecure, "Without a key, allow addresses of other machines too");
  doctor.add_option("--stiffness", a->stiffness, "--link: of the wall for which a method is advised [N/m]")
      ->capture_default_str();
  doctor.add_flag("!--no-realtime", a->realtime, "Measure the loop without real-time scheduling and locked memory");
  doctor.add_flag("!--no-spin", a->spin, "Measure the loop without busy-waiting for the last 50 us");
  doctor.add_flag("--json", a->json, "Print the same as JSON");
  doctor.footer(
      "Grades: good, notice, bad, and unseen: what cannot be read on this machine. Exit status 3 where the loop's is "
      "bad: more than one tick in a thousand skipped, or 99 % not within a quarter of the period.");
  doctor.callback([a, &chosen] {
    chosen = [a] {
      if (!std::isfinite(a->seconds)) throw ConfigError{"--seconds: must be between 0.05 and 1e6"};
      if (!(a->stiffness > 0.0 && a->stiffness <= 1e9))
        throw ConfigError{fmt::format("--stiffness {}: must be > 0 and at most 1e9 N/m", a->stiffness)};
      if (!a->answer.empty()) return answer_command(*a);
      return a->link.empty() ? loop_command(*a) : link_command(*a);
    };
  });
}

}  // namespace twoport::lab
