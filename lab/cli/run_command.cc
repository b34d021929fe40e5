#include <fmt/format.h>

#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/mcap/bytes.h"
#include "common/record/summary.h"
#include "common/scene/hints.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/engine/recording.h"
#include "lab/run.h"
#include "lab/study/cells.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string scene, out, trace = "csv", verdict = "tail", record, robot;
  std::uint64_t trace_every = 1;
  std::vector<std::string> set;
};

int run_command(const Arguments& a) {
  const Scene scene = load_scene(a.scene, a.set);
  const std::optional<HostedRobot> robot = open_robot(a.robot, scene);
  for (const std::string& sentence : hints(scene)) print_error("{}: warning: {}\n", a.scene, sentence);
  if (!a.out.empty()) make_folder(a.out);
  // Before anything of an earlier run is removed.
  if (!a.record.empty()) {
    const bool has_earlier = has_content(a.record);
    std::fclose(take_file(a.record, mcap::kMagic));
    if (has_earlier) print_error("{} of an earlier run is now {}\n", a.record, earlier_file(a.record));
  }
  std::optional<FolderLock> lock;
  std::optional<WholeFile> trace, gripper_trace;
  if (!a.out.empty()) {
    lock.emplace(a.out, "--out");
    if (a.trace == "csv") trace.emplace(a.out + "/trace.csv");
    if (trace && scene.gripper) gripper_trace.emplace(a.out + "/trace-gripper.csv");
    for (const char* name : {"/summary.json", "/trace.csv", "/trace-gripper.csv"})
      std::filesystem::remove(a.out + name);  // of an earlier run
  }
  std::optional<RecordingOptions> record;
  std::string unrecorded;
  if (!a.record.empty()) record = {a.record, a.scene, read_whole(a.scene), a.set, &unrecorded};
  const Summary summary = run(scene, {.trace = trace ? &*trace : nullptr,
                                      .trace_every = a.trace_every,
                                      .verdict = verdict_from(a.verdict),
                                      .gripper_trace = gripper_trace ? &*gripper_trace : nullptr,
                                      .record = record ? &*record : nullptr,
                                      .robot = robot ? &*robot : nullptr});
  // First the trace: one that finds no room is cut, which leaves room for the summary.
  std::exception_ptr unwritten;
  try {
    if (trace) trace->commit_rows();
    if (gripper_trace) gripper_trace->commit_rows();
  } catch (const IoError&) {
    unwritten = std::current_exception();
  }
  leave_summary(summary, a.out);
  if (!a.out.empty()) fmt::print("{}: {}\n", in_one_line(scene.name), summary.verdict());
  if (!a.out.empty() && summary.has_gripper())
    fmt::print("{}, gripper: {}\n", in_one_line(scene.name), summary.gripper().verdict());
  if (!unrecorded.empty() && unwritten) print_error("--record {}\n", unrecorded);
  if (unwritten) std::rethrow_exception(unwritten);
  if (!unrecorded.empty()) throw IoError{"--record " + unrecorded};
  const std::vector<std::string> violated = violations(scene.expect, summary);
  for (const std::string& sentence : violated) print_error("{}: {}\n", a.scene, sentence);
  return violated.empty() ? 0 : 3;
}

}  // namespace

void add_run_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& run = *app.add_subcommand("run", "Run one scene; summary and trace into --out, or the summary on stdout");
  add_scene(run, a->scene, a->set);
  add_robot(run, a->robot);
  run.add_option("--out", a->out, "Folder for summary.json and trace.csv");
  run.add_option("--record", a->record,
                 "FILE.mcap: a recording of both sides, for replay, export, Foxglove, PlotJuggler and Python");
  run.add_option("--trace", a->trace, "none or csv")->check(CLI::IsMember({"none", "csv"}))->capture_default_str();
  run.add_option("--trace-every", a->trace_every,
                 "N: one tick in N has a row in the trace; the summary is of all ticks")
      ->check(CLI::Range(std::uint64_t{1}, std::uint64_t{1'000'000'000}))
      ->capture_default_str();
  run.add_option("--verdict", a->verdict,
                 "tail: left alone after the scene's end, beside a twin; plain: from the scene's own run, faster, and "
                 "UNDECIDED more often")
      ->check(CLI::IsMember({"tail", "plain"}))
      ->capture_default_str();
  run.callback([a, &chosen] { chosen = [a] { return run_command(*a); }; });
}

}  // namespace twoport::lab
