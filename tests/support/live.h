#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "proto/summary.pb.h"
#include "tests/support/process.h"

namespace twoport::test {

using Words = std::vector<std::string>;

/// A scene: a hand holds still for 0.2 s, moves 30 mm within 0.5 s, and presses a wall that begins at 20 mm; the link
/// takes 10 ms each way. With `architecture: RENDER` there is no link.
std::string press(int dof = 1, std::string_view architecture = "POSITION_FORCE");
/// The scene of docs/examples/plugin for 2.5 s: two arms of three joints. `examples`: the path of docs/examples.
std::string two_arms(const std::string& examples);

/// Columns of a trace.csv by name. Throws unless it is whole: a header and rows of as many numbers.
struct Trace {
  std::map<std::string, std::vector<double>> columns;
  explicit Trace(const std::string& path);
  [[nodiscard]] const std::vector<double>& operator[](const std::string& name) const { return columns.at(name); }
  [[nodiscard]] std::size_t rows() const { return (*this)["t_s"].size(); }
  /// Largest |value| of a column from one moment to another; -1 where there is no row.
  [[nodiscard]] double peak(const std::string& name, double from_s, double to_s) const;
};

/// summary.json in a folder. Throws unless it is whole and knows no other keys than the schema.
schema::Summary summary_in(const std::string& folder);

/// Has every program of a run kept its ticks? A force that is held beyond its tick, because a busy machine left out the
/// next ones, does what no controller has predicted: what such a run felt like says nothing of the programs.
bool kept_time(const std::vector<schema::Summary>& of_a_run);
/// Every side is stable, and the master's port passive to 1 mJ; not judged, and said, where ticks were not kept.
void expect_sound(const std::vector<schema::Summary>& of_a_run);

/// Waits, up to 30 s, until `condition` holds.
bool comes_true(const std::function<bool()>& condition);

/// The two programs with one scene and one port, each run with a folder of its own.
class Pair {
 public:
  explicit Pair(std::string_view scene = press());

  Process slave(const std::string& out = "slave", const Words& more = {}, const Surroundings& s = {}) const;
  Process master(const std::string& out = "master", const Words& more = {}, const Surroundings& s = {}) const;
  /// A slave that listens: what may begin now will find it.
  Process listening_slave(const std::string& out = "slave", const Words& more = {}, const Surroundings& s = {}) const;

  /// Waits until a side has come to `t_s` of its run, by its trace. A sleep as long would count the start of the programs
  /// too, which takes seconds on a busy machine.
  void await(std::string_view out, double t_s) const;

  /// Gives both a key.
  void share_key();

  [[nodiscard]] std::string at(std::string_view name) const { return folder / name; }
  [[nodiscard]] schema::Summary summary(std::string_view out) const { return summary_in(at(out)); }
  [[nodiscard]] Trace trace(std::string_view out) const { return Trace{at(out) + "/trace.csv"}; }
  [[nodiscard]] std::string address() const { return host + ":" + std::to_string(port); }

  Folder folder;
  std::string host = "127.0.0.1";
  std::uint16_t port = free_udp_port();
  std::string scene;
  Words scheduling = {"--no-spin"};  ///< real time as far as permitted, so that other load does not disturb a run
};

}  // namespace twoport::test
