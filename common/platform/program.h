#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/base/histogram.h"
#include "common/link/mailbox.h"
#include "common/record/summary.h"
#include "common/scene/scene.h"

namespace twoport {

/// Texts of a live program's command line.
struct ProgramText {
  std::string name, description;
  std::string address_flag, address_default;
  std::string hardware_flag, hardware;  ///< "--device", and what it chooses, in words
  std::string drivers;                  ///< what --list-devices prints
};

/// Arguments of both live programs.
struct LiveArguments {
  std::string scene, address, out, trace = "csv", hardware = "sim";
  std::vector<std::string> set;
  bool realtime = true, spin = true;
};

/// Parses the command line of a live program, runs `body(scene, arguments)`, and converts errors to the exit status and
/// one sentence on stderr: 0 success, 1 failure, 2 invalid usage, scene or override, 3 an expectation was not met.
int live_program(int argc, char** argv, const ProgramText& text,
                 const std::function<int(const Scene&, const LiveArguments&)>& body);

/// Prints what in the scene is probably not meant, to stderr.
void print_hints(const Scene& scene, const LiveArguments& arguments, bool device_is_simulated);

/// Makes the folder of a run where it is missing, removes what an earlier run has left there, and opens the trace; null where
/// none is wanted.
std::unique_ptr<WholeFile> open_trace(const LiveArguments& arguments);

/// Fills what every live summary has, and leaves `trace` and summary where --out says. First the trace: one that finds no room
/// is removed, which leaves room for the summary. Returns the exit status, 1 where one of them could not be written.
int leave_files(const Scene& scene, const LiveArguments& arguments, const std::string& side, WholeFile* trace,
                Summary summary);

/// Prints which of the scene's expectations `summary` does not meet. Returns the exit status: 0 none, 3 some.
int judge(const Scene& scene, const LiveArguments& arguments, const Summary& summary);

Percentiles percentiles(const Histogram& histogram, double unit_ns);

}  // namespace twoport
