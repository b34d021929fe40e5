#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/base/histogram.h"
#include "common/link/mailbox.h"
#include "common/record/summary.h"
#include "common/scene/scene.h"
#include "common/wire/header.h"

namespace twoport {

/// Arguments of both live programs.
struct LiveArguments {
  std::string scene, address, out, trace = "csv", hardware = "sim";
  std::string key;  ///< --key: file, or folder of a slave; empty: packets are neither encrypted nor authenticated
  double rekey_after_s = 600.0;  ///< --rekey-after, of a master
  bool insecure = false;         ///< --insecure: without a key also beyond this machine
  std::vector<std::string> set;
  std::string record;    ///< --record: the file; empty: nothing is recorded
  std::string foxglove;  ///< of --foxglove: ADDR:PORT; empty: none
  std::string stream;    ///< of --stream: HOST:PORT; empty: none
  double stream_hz = 100.0;
  int stop_port = 0;               ///< --stop-port; 0: none
  int dscp = 0;                    ///< --dscp: of the datagrams to the other side
  std::string page;                ///< of --page: ADDR:PORT; empty: no page
  std::string page_world;          ///< of --page-world: a robot whose world the page draws; empty: the scene's
  bool restartable = false;        ///< --restartable: the page may end the program with status 4
  bool fixed_environment = false;  ///< --fixed-environment: of a slave; no page may change it
  bool measures = false;           ///< no scene: the link is measured (kMeasurementDigest)
  bool realtime = true, spin = true;
  std::uint64_t trace_every = 1;  ///< the trace has one row in so many
  /// --duration: the program ends this long after its start [s].
  double limit_s = std::numeric_limits<double>::infinity();

  /// Readings of a recording are those of mounted hardware: the scene's mount is not applied again.
  [[nodiscard]] bool is_playback() const { return hardware.starts_with("playback:"); }
};

/// Parses the command line of twoport-master or twoport-slave, runs `body(scene, arguments)`, and converts errors to the exit
/// status and one sentence on stderr: 0 success, 1 failure, 2 invalid usage, scene or override, 3 an expectation was not
/// met, 4 the page asks for a run from the beginning (--restartable). `drivers` is what --list-devices prints.
int live_program(int argc, char** argv, Side side, const std::string& drivers,
                 const std::function<int(const Scene&, const LiveArguments&)>& body);

/// "twoport-SIDE VERSION".
std::string program_name(const std::string& side);

/// Prints what in the scene is probably not meant, to stderr.
void print_hints(const Scene& scene, const LiveArguments& arguments, bool device_is_simulated);

/// The folder of --out, which this program has for itself. Nothing where there is none.
struct RunFolder {
  std::unique_ptr<FolderLock> lock;
  std::unique_ptr<WholeFile> trace;  ///< null: none is wanted
};
/// Makes the folder where it is missing and takes it, calls `before_clearing`, opens the trace, and then removes what an earlier
/// run has left there. Call when nothing else can prevent the run. Throws ConfigError.
RunFolder begin_folder(const LiveArguments& arguments, const std::function<void()>& before_clearing);

/// Fills what every live summary has, and leaves `trace` and summary where --out says. First the trace: one that finds no room
/// is cut, which leaves room for the summary. Returns the exit status, 1 where one of them could not be written.
int leave_files(const Scene& scene, const LiveArguments& arguments, const std::string& side, WholeFile* trace,
                Summary summary);

/// Prints which of the scene's expectations `summary` does not meet. Returns the exit status: 0 none, 3 some.
int judge(const Scene& scene, const LiveArguments& arguments, const Summary& summary);

Percentiles percentiles(const Histogram& histogram, double unit_ns);

/// The limits that a side keeps itself.
template <Side kSide>
void fill_own_limits(const LimitCounts& counts, Summary& s) {
  if constexpr (kSide == Side::master) {
    *s.mutable_limits()->mutable_device() = limits_of_device(counts);
  } else {
    *s.mutable_limits()->mutable_robot() = limits_of_robot(counts);
  }
}

}  // namespace twoport
