#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/histogram.h"
#include "common/link/mailbox.h"
#include "common/record/summary.h"
#include "common/scene/scene.h"

namespace twoport {

/// What a live program says of itself on its command line.
struct ProgramText {
  std::string name, description;
  std::string address_flag, address_default;
  std::string hardware_flag, hardware;  ///< "--device", and what it chooses, in words
  std::string drivers;                  ///< what --list-devices prints
};

/// What both live programs are told.
struct LiveArguments {
  std::string scene, address, out, trace = "csv", hardware = "sim";
  std::vector<std::string> set;
  bool realtime = true, spin = true;
};

/// Parses the command line of a live program, runs `body(scene, arguments)`, and turns what goes wrong into the exit
/// status and one sentence on stderr: 0 done, 1 failed, 2 bad usage, scene or override, 3 an expectation was not met.
int live_program(int argc, char** argv, const ProgramText& text,
                 const std::function<int(const Scene&, const LiveArguments&)>& body);

/// Folder of a run, made where it is missing and rid of what an earlier run has left there; returns the path of its trace,
/// empty where none is wanted.
std::string trace_path(const LiveArguments& arguments);

/// Fills what every live summary has, writes it where --out says and checks what the scene expects when `judged`.
/// Returns the exit status.
int conclude(const Scene& scene, const LiveArguments& arguments, const std::string& side, Summary summary, bool judged);

Percentiles percentiles(const Histogram& histogram, double unit_ns);

}  // namespace twoport
