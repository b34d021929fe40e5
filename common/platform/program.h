#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/histogram.h"
#include "common/link/mailbox.h"
#include "common/scene/scene.h"
#include "common/scene/summary.h"

namespace twoport {

/// What both live programs are told.
struct LiveArguments {
  std::string scene, address, out, trace = "csv";
  std::vector<std::string> set;
  bool realtime = true, spin = true;
};

/// Parses the command line of a live program, runs `body(scene, arguments)`, and turns what goes wrong into the exit
/// status and one sentence on stderr: 0 done, 1 failed, 2 bad usage, scene or override, 3 a promise was broken.
/// `address_flag` is "--listen" or "--peer".
int live_program(int argc, char** argv, const std::string& name, const std::string& description,
                 const std::string& address_flag, const std::string& address_default,
                 const std::function<int(const Scene&, const LiveArguments&)>& body);

/// Folder of a run, made where it is missing; and the path of its trace, empty where none is wanted.
std::string trace_path(const LiveArguments& arguments);

/// Fills what every live summary has, writes it where --out says and checks the scene's promises when `judged`.
/// Returns the exit status.
int conclude(const Scene& scene, const LiveArguments& arguments, const std::string& side, Summary summary, bool judged);

Percentiles percentiles(const Histogram& histogram, double unit_ns);

}  // namespace twoport
