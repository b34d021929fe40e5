#include "lab/cli/subcommand.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <exception>
#include <utility>

#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/scene/find.h"
#include "common/scene/load.h"
#include "lab/lanes/lanes.h"
#include "lab/study/many_runs.h"
#include "lab/study/parallel.h"

namespace twoport::lab {

Option Option::required() {
  option_->required();
  return *this;
}
Option Option::show_default() {
  option_->capture_default_str();
  return *this;
}
Option Option::one_of(std::initializer_list<std::string> values) {
  option_->check(CLI::IsMember(std::vector<std::string>{values}));
  return *this;
}
template <class Number>
Option Option::between(Number least, Number most) {
  option_->check(CLI::Range(least, most));
  return *this;
}
template Option Option::between(int, int);
template Option Option::between(std::uint64_t, std::uint64_t);
template Option Option::between(double, double);
Option Option::positive() {
  const auto error = [](const std::string& text) {
    double value = 0.0;
    if (CLI::detail::lexical_cast(text, value) && value > 0.0 && std::isfinite(value)) return std::string{};
    return fmt::format("\"{}\"; it must be a number above 0", text);
  };
  option_->check(CLI::Validator{error, ""});
  return *this;
}
Option Option::at_least_one() {
  const auto error = [](const std::string& text) {
    int value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= 1) return std::string{};
    return fmt::format("\"{}\"; it must be a whole number, at least 1", text);
  };
  option_->check(CLI::Validator{error, "N"});
  return *this;
}
Option Option::assignment() {
  option_->check(CLI::Validator{[](const std::string& text) { return assignment_error(text); }, "PATH=VALUE"});
  return *this;
}
Option Option::scene() {
  option_->transform(scene_file);
  return *this;
}
Option Option::may_be_bare() {
  option_->expected(0, 1);
  return *this;
}
Option Option::needs(Option other) {
  option_->needs(other.option_);
  return *this;
}
Option Option::excludes(Option other) {
  option_->excludes(other.option_);
  return *this;
}

Command Command::add(const std::string& name, const std::string& description) {
  return Command{*app_->add_subcommand(name, description)};
}
template <class Value>
Option Command::option(const std::string& name, Value& into, const std::string& help) {
  return Option{app_->add_option(name, into, help)};
}
template Option Command::option(const std::string&, std::string&, const std::string&);
template Option Command::option(const std::string&, std::vector<std::string>&, const std::string&);
template Option Command::option(const std::string&, int&, const std::string&);
template Option Command::option(const std::string&, std::optional<int>&, const std::string&);
template Option Command::option(const std::string&, std::optional<double>&, const std::string&);
template Option Command::option(const std::string&, std::uint64_t&, const std::string&);
template Option Command::option(const std::string&, double&, const std::string&);
Option Command::list(const std::string& name, std::vector<std::string>& into, const std::string& help) {
  return Option{app_->add_option(name, into, help)->allow_extra_args(false)->take_all()};
}
void Command::flag(const std::string& name, bool& into, const std::string& help) {
  app_->add_flag(name, into, help);
}
void Command::print(const std::string& name, std::function<void()> what, const std::string& help) {
  app_->add_flag_callback(
      name,
      [what = std::move(what)] {
        what();
        throw CLI::Success{};
      },
      help);
}
void Command::describe(const std::string& option, const std::string& help) {
  app_->get_option(option)->description(help);
}
void Command::footer(const std::string& text) {
  app_->footer(text);
}
bool Command::given() const {
  return app_->parsed();
}

void add_scene(Command command, std::string& scene, std::vector<std::string>& set) {
  command.option("scene", scene, "Scene file (.textproto), or the name of a scene of the project").scene().required();
  command.list("--set", set, "Override, PATH=VALUE, e.g. control.passivity.method=NONE").assignment();
}

void add_lanes(Command command, std::optional<int>& lanes) {
  command.option("--lanes", lanes,
                 "Simulations that a thread steps at once: 1, 2, 4 or 8; 0, the default: as many as the processor can. "
                 "Says which runs ran alone, and why");
}

void say_lanes(const LaneUse& use) {
  if (use.together > 0) print_error("{} runs, {} at once ({})\n", use.together, use.lanes, name_of_lanes(use.lanes));
  for (const auto& [why, count] : use.alone) print_error("{} runs alone: {}\n", count, why);
}

void add_jobs(Command command, int& jobs) {
  jobs = all_cores();
  command.option("--jobs", jobs, "Threads").at_least_one().show_default();
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

}  // namespace twoport::lab
