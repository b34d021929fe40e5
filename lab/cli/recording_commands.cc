#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/record/trace_channel.h"
#include "common/recording/recording.h"
#include "lab/cli/commands.h"
#include "lab/study/cells.h"
#include "lab/study/replay.h"

namespace twoport::lab {
namespace {

int replay_command(const std::string& file) {
  RecordingReader recording{file};
  const Replayed all = replay(recording);
  if (std::all_of(all.sides.begin(), all.sides.end(),
                  [](const ReplayedSide& each) { return each.ticks == 0 && each.difference.empty(); }))
    throw ConfigError{fmt::format("{}: holds no whole tick to compare", file)};
  if (all.torn) fmt::print("{}: the recording has no end: its program was killed, or it was cut off\n", file);
  for (const ReplayedSide& each : all.sides) {
    if (each.difference.empty() && each.ticks == 0) {
      fmt::print("{}: no whole tick to compare\n", each.side);
    } else if (each.difference.empty()) {
      fmt::print("{}: {} ticks, identical to the bit\n", each.side, each.ticks);
    } else {
      fmt::print("{}: {} ticks identical to the bit, then {}\n", each.side, each.ticks, each.difference);
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

}  // namespace twoport::lab
