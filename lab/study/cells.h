#pragma once

#include <fmt/format.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/file.h"
#include "lab/study/table.h"

namespace twoport::lab {

/// FNV-1a over a sequence of texts and numbers: distinguishes sweeps and detects edited lines. Not
/// cryptographic.
class Digest {
 public:
  void add(std::string_view text) {
    for (const char c : text) mix(static_cast<unsigned char>(c));
    mix(0xff);  // no text holds it: the next one begins here
  }
  void add(double number) {
    for (auto bits = std::bit_cast<std::uint64_t>(number); bits != 0; bits >>= 8) mix(bits & 0xff);
    mix(0xff);
  }
  [[nodiscard]] std::string text() const { return fmt::format("{:016x}", value_); }

 private:
  void mix(std::uint64_t byte) { value_ = (value_ ^ byte) * 0x100000001b3; }
  std::uint64_t value_ = 0xcbf29ce484222325;
};

/// Definition of a sweep: the first line of cells.jsonl.
struct Plan {
  std::string digest;  ///< of scene, overrides, axes, seeds and version
  Grid grid;
  std::size_t seeds = 0;  ///< as in SweepOptions
  std::vector<std::string> columns;

  /// Start of a cell's row: a value for each path.
  [[nodiscard]] std::vector<std::string> varied_columns(std::size_t cell) const;
  /// The first line of cells.jsonl.
  [[nodiscard]] std::string line() const;
};

/// The finished cells of a sweep in FOLDER/cells.jsonl, JSON by line:
///
///     {"digest": …, "axes": [{"path": …, "log": …, "values": […]}, …], "seeds": …, "columns": […], "check": …}
///     {"cell": 3, "row": ["0.5", "6000", …], "check": …}
///
/// Lines are only appended; an incomplete last line is ignored. `check` is a digest of the rest of the line and of the
/// sweep: a line that was edited, or is of another sweep, is refused. Only where each line begins is in memory.
class CellFile {
 public:
  /// Reads what a folder holds. Throws ConfigError when there is nothing.
  explicit CellFile(const std::string& folder);
  /// To append: creates the folder and the file, or continues one of the same plan. Throws ConfigError for another plan's,
  /// and while another program writes into the folder.
  CellFile(const std::string& folder, const Plan& plan);

  /// Throws IoError when the cell cannot be kept, and for all that follow.
  void append(std::size_t cell, const Values& row);

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const Plan& plan() const { return plan_; }
  [[nodiscard]] bool holds(std::size_t cell) const { return begins_[cell] != kMissing; }
  /// The line of a cell that is held, its newline included, or its row. Throws IoError when it is not there any more.
  std::string line(std::size_t cell);
  Values row(std::size_t cell);

 private:
  bool read();
  bool add(const std::string& line);

  static constexpr std::uint64_t kMissing = ~std::uint64_t{0};
  std::string path_;
  Plan plan_;
  std::vector<std::uint64_t> begins_;  ///< of each cell's line, or kMissing
  std::uint64_t end_ = 0;              ///< of the last whole line
  std::ifstream in_;
  std::optional<FolderLock> lock_;
  std::ofstream out_;
  std::string failure_;  ///< why nothing more is kept; empty: it is
};

/// FOLDER/cells.jsonl.
std::string cells_in(const std::string& folder);

void make_folder(const std::string& folder);

}  // namespace twoport::lab
