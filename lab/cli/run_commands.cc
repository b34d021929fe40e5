#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/coupling/layers.h"
#include "common/mcap/bytes.h"
#include "common/record/summary.h"
#include "common/record/trace_channel.h"
#include "common/record/trace_table.h"
#include "common/recording/recording.h"
#include "common/scene/hints.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/engine/recording.h"
#include "lab/plot/pictures.h"
#include "lab/run.h"
#include "lab/study/cells.h"
#include "lab/study/replay.h"

namespace twoport::lab {
namespace {

struct RunArguments {
  std::string scene, out, trace = "csv", verdict = "tail", record, robot;
  std::uint64_t trace_every = 1;
  bool plot = false;
  std::vector<std::string> set;
};

int run_command(const RunArguments& a) {
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
  std::optional<TraceTable> drawn;
  if (a.plot) drawn.emplace(scene.dof, scene.coordinates(), scene.duration_s * scene.master_rate_hz);
  const Summary summary = run(scene, {.trace = trace ? &*trace : nullptr,
                                      .trace_every = a.trace_every,
                                      .verdict = verdict_from(a.verdict),
                                      .gripper_trace = gripper_trace ? &*gripper_trace : nullptr,
                                      .record = record ? &*record : nullptr,
                                      .table = drawn ? &*drawn : nullptr,
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
  if (drawn) {
    const std::string sentence = draw(*drawn, summary, a.out.empty() ? "." : a.out);
    // Without --out the summary alone is on stdout.
    if (a.out.empty()) {
      print_error("{}\n", sentence);
    } else {
      fmt::print("{}\n", sentence);
    }
  }
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

int replay_command(const std::string& file) {
  RecordingReader recording{file};
  const Replayed all = replay(recording);
  if (std::all_of(all.sides.begin(), all.sides.end(),
                  [](const ReplayedSide& each) { return each.ticks == 0 && each.difference.empty(); }))
    throw ConfigError{fmt::format("{}: holds no whole tick to compare", file)};
  if (all.torn) fmt::print("{}: the recording has no end: its program was killed, or it was cut off\n", file);
  for (const ReplayedSide& each : all.sides) {
    if (each.difference.empty() && each.ticks == 0) {
      fmt::print("{}: no whole tick to compare\n", in_one_line(each.side));
    } else if (each.difference.empty()) {
      fmt::print("{}: {} ticks, identical to the bit\n", in_one_line(each.side), each.ticks);
    } else {
      fmt::print("{}: {} ticks identical to the bit, then {}\n", in_one_line(each.side), each.ticks,
                 in_one_line(each.difference));
    }
  }
  return all.identical() ? 0 : 3;
}

struct ExportArguments {
  std::string file, csv, out;
};

int export_command(const ExportArguments& a) {
  std::string csv = a.csv;
  if (csv.empty()) {
    const std::string folder = a.out.empty() ? "." : a.out;
    make_folder(folder);
    csv = folder + "/trace.csv";
  } else if (std::filesystem::is_directory(csv)) {
    csv += "/trace.csv";
  }
  std::error_code error;
  for (const std::string& each : {csv, gripper_csv(csv)})
    if (std::filesystem::equivalent(a.file, each, error))
      throw ConfigError{fmt::format("--csv {}: is the recording itself; give another name", each)};
  const std::string gripper = gripper_csv(csv);
  const bool has_earlier = has_content(gripper);
  RecordingReader recording{a.file};
  const std::vector<ExportedTrace> written = export_trace(recording, csv);
  for (const ExportedTrace& each : written) fmt::print("{}: {} rows\n", each.path, each.rows);
  if (has_earlier && written.size() == 1)
    print_error("{} of an earlier recording is now {}\n", gripper, earlier_file(gripper));
  return 0;
}

}  // namespace

void add_run_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<RunArguments>();
  CLI::App& run = *app.add_subcommand("run", "Run one scene; summary and trace into --out, or the summary on stdout");
  add_scene(run, a->scene, a->set);
  add_robot(run, a->robot);
  run.add_option("--out", a->out, "Folder for summary.json and trace.csv");
  run.add_flag("--plot", a->plot, "Draw run.png and run.svg into --out, or the present folder");
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

void add_recording_commands(CLI::App& app, Chosen& chosen) {
  const auto file = std::make_shared<std::string>();
  CLI::App& replay = *app.add_subcommand(
      "replay", "Feed a recording to the same nodes: exit status 0 if every result is identical to the bit, else 3");
  replay.add_option("recording", *file, "FILE.mcap")->required();
  replay.callback([file, &chosen] { chosen = [file] { return replay_command(*file); }; });

  const auto a = std::make_shared<ExportArguments>();
  CLI::App& export_ = *app.add_subcommand(
      "export", "The trace of a recording as CSV; that of a gripper beside it, into NAME-gripper.csv");
  export_.add_option("recording", a->file, "FILE.mcap")->required();
  export_.add_option("--csv", a->csv, "OUT: a file, or a folder for trace.csv")->expected(0, 1)->required();
  export_.add_option("--out", a->out, "Folder for trace.csv");
  export_.callback([a, &chosen] { chosen = [a] { return export_command(*a); }; });
}

void add_methods_command(CLI::App& app, Chosen& chosen) {
  CLI::App& methods =
      *app.add_subcommand("methods",
                          "List the methods of control.passivity.method over a link, one a line: name, tab, summary. "
                          "The first is the one of a scene that names none");
  const auto layers = std::make_shared<bool>(false);
  methods.add_flag(
      "--layers", *layers,
      "List the layers that control.transparency.layer and control.passivity.layer name: kind, tab, name, "
      "tab, of passivity layers the ports that they bound (none; hand; both; hand, both) and a tab, summary");
  methods.callback([layers, &chosen] {
    chosen = [layers] {
      if (!*layers) {
        for (const MethodName& each : kMethods) fmt::print("{}\t{}\n", each.name, each.summary);
        return 0;
      }
      for (const TransparencyLayerName& each : kTransparencyLayers)
        fmt::print("transparency\t{}\t{}\n", each.name, each.summary);
      for (const PassivityLayerName& each : kPassivityLayers)
        fmt::print("passivity\t{}\t{}\t{}\n", each.name, to_string(*each.claim), each.summary);
      return 0;
    };
  });
}

}  // namespace twoport::lab
