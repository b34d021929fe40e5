#include "lab/cli/commands.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <exception>
#include <memory>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/scene/find.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "lab/lanes/lanes.h"
#include "lab/study/many_runs.h"
#include "lab/study/parallel.h"

namespace twoport::lab {

CLI::Option* add_list(CLI::App& command, const std::string& name, std::vector<std::string>& into,
                      const std::string& help) {
  return command.add_option(name, into, help)->allow_extra_args(false)->take_all();
}

CLI::Validator positive() {
  const auto error = [](const std::string& text) {
    double value = 0.0;
    if (CLI::detail::lexical_cast(text, value) && value > 0.0 && std::isfinite(value)) return std::string{};
    return fmt::format("\"{}\"; it must be a number above 0", text);
  };
  return {error, ""};
}

void add_scene(CLI::App& command, std::string& scene, std::vector<std::string>& set) {
  command.add_option("scene", scene, "Scene file (.textproto), or the name of a scene of the project")
      ->transform(scene_file)
      ->required();
  const CLI::Validator assignment{[](const std::string& text) { return assignment_error(text); }, "PATH=VALUE"};
  add_list(command, "--set", set, "Override, PATH=VALUE, e.g. control.passivity.method=NONE")->check(assignment);
}

void add_lanes(CLI::App& command, std::optional<int>& lanes) {
  command.add_option(
      "--lanes", lanes,
      "Simulations that a thread steps at once: 1, 2, 4 or 8; 0, the default: as many as the processor can. "
      "Says which runs ran alone, and why");
}

void say_lanes(const LaneUse& use) {
  if (use.together > 0) print_error("{} runs, {} at once ({})\n", use.together, use.lanes, name_of_lanes(use.lanes));
  for (const auto& [why, count] : use.alone) print_error("{} runs alone: {}\n", count, why);
}

void add_jobs(CLI::App& command, int& jobs) {
  const auto error = [](const std::string& text) {
    int value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= 1) return std::string{};
    return fmt::format("\"{}\"; it must be a whole number, at least 1", text);
  };
  jobs = all_cores();
  command.add_option("--jobs", jobs, "Threads")->check(CLI::Validator{error, "N"})->capture_default_str();
}

bool progress_is_shown() {
  static const bool terminal = ::isatty(STDERR_FILENO) == 1;
  return terminal;
}

void show_line(const std::string& line, double spent_s, bool last) {
  if (progress_is_shown()) return print_error("\r{}\033[K{}", line, last ? "\n" : "");
  static double next_s = 5.0;
  if (last || spent_s < next_s) return;
  next_s = spent_s + std::min(spent_s, 60.0);
  print_error("{}\n", line);
}

const std::atomic<bool>& stop_by_user() {
  static std::atomic<bool> stop{false};
  static_assert(std::atomic<bool>::is_always_lock_free);
  for (const int each : {SIGINT, SIGTERM})
    if (std::signal(each, [](int signal) {
          stop = true;
          std::signal(signal, SIG_DFL);
        }) == SIG_IGN)
      std::signal(each, SIG_IGN);
  return stop;
}

void Sketch::write_page(const std::string& head) const {
  if (out_.empty()) return;
  write_whole(out_ + "/coarse.html",
              fmt::format("<!doctype html><meta charset=\"utf-8\">{}<title>{}</title><p>{}</p><img src=\"{}\">\n", head,
                          picture_, line_, picture_));
}
Sketch::~Sketch() {
  try {
    if (!line_.empty()) write_page("");
  } catch (const std::exception& e) {
    print_error("{}\n", e.what());
  }
}
void Sketch::tell(const std::string& line, const std::function<void()>& draw) {
  const Clock::time_point from = Clock::now();
  print_error("{}{}\n", progress_is_shown() ? "\r\033[K" : "", line);
  draw();
  if (line_.empty() && !out_.empty()) print_error("{}/coarse.html shows the picture while it gets finer\n", out_);
  line_ = line;
  write_page("<meta http-equiv=\"refresh\" content=\"1\">");
  const Clock::time_point now = Clock::now();
  next_ = now + std::max((now - start_) / 2, 10 * (now - from));
}

namespace {

void show(const Progress& p, const char* what) {
  const bool all = p.done == p.count;
  std::string line = fmt::format("{} of {} {}", p.done, p.count, what);
  if (p.kept > 0) line += fmt::format(" ({} kept)", p.kept);
  line += fmt::format(", {:.0f} s", p.spent_s);
  if (p.left_s && !all) line += fmt::format(", {:.0f} s left", *p.left_s);
  show_line(line, p.spent_s, all);
}

}  // namespace

void show_progress(const Progress& p) {
  show(p, "cells");
}
void show_runs(const Progress& p) {
  show(p, "runs");
}

CLI::Option* add_robot(CLI::App& command, std::string& robot) {
  return command.add_option("--robot", robot,
                            "mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off]: a world of MuJoCo in place of the "
                            "scene's robot and environment");
}

std::optional<HostedRobot> open_robot(const std::string& choice, const Scene& scene) {
  if (choice.empty()) return {};
  // Others go by the clock.
  if (choice.substr(0, choice.find(':')) != "mujoco")
    throw ConfigError{"--robot " + choice +
                      ": does not run in virtual time; mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off] does"};
  return for_cartesian_dof(scene.dof, "--robot " + choice, [&]<int N>() -> std::optional<HostedRobot> {
    std::unique_ptr<Robot<N>> robot = all_drivers().robots.open<N>(choice, scene, Seconds{1.0 / scene.slave_rate_hz});
    HostedRobot hosted{choice, HostedRobot::Of<N>{&dynamic_cast<VirtualRobot<N>&>(*robot.release())}};
    static_cast<void>(make_simulation<N>(scene, hosted));  // refuses before anything runs
    return hosted;
  });
}

std::optional<HostedRobot> open_robot(const std::string& choice, const std::string& scene,
                                      const std::vector<std::string>& set) {
  return choice.empty() ? std::nullopt : open_robot(choice, load_scene(scene, set));
}

void refuse_replaced(const std::string& option, const std::vector<std::string>& paths) {
  for (const std::string& path : paths)
    for (const char* const field : {"environment", "robot.force_sensor", "robot.arm"})
      if (path.starts_with(field)) throw ConfigError{option + ": the world of --robot takes the place of " + field};
}

}  // namespace twoport::lab
