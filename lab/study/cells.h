#pragma once

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "lab/study/sweep.h"

namespace twoport::lab {

/// Definition of a sweep: the first line of cells.jsonl.
struct Plan {
  std::string digest;  ///< of scene, overrides, axes, seeds and version
  std::vector<Axis> axes;
  std::size_t seeds = 0;  ///< as in SweepOptions
  std::vector<std::string> columns;

  [[nodiscard]] std::size_t cells() const;
  /// The value of each axis in a cell, the last fastest.
  [[nodiscard]] std::vector<std::string> values(std::size_t cell) const;
  /// Start of a cell's row: a value for each path.
  [[nodiscard]] std::vector<std::string> varied_columns(std::size_t cell) const;
  /// "a=1, b=2" for an error sentence.
  [[nodiscard]] std::string name(std::size_t cell) const;
};

/// Rows by number of cell.
using Cells = std::map<std::size_t, std::vector<std::string>>;

/// The finished cells of a sweep in FOLDER/cells.jsonl, JSON by line:
///
///     {"digest": …, "axes": [{"path": …, "log": …, "values": […]}, …], "seeds": …, "columns": […], "check": …}
///     {"cell": 3, "row": ["0.5", "6000", …], "check": …}
///
/// Lines are only appended; an incomplete last line is ignored. `check` is a digest of the rest of the line and of the
/// sweep: a line that was edited, or is of another sweep, is refused.
class CellFile {
 public:
  /// Creates the folder and the file, or continues one of the same plan. Throws ConfigError for another plan's, and while
  /// another program writes into the folder.
  CellFile(const std::string& folder, const Plan& plan);

  /// Throws IoError when the cell cannot be kept, and for all that follow.
  void append(std::size_t cell, const std::vector<std::string>& row);
  [[nodiscard]] const Cells& kept() const { return kept_; }

 private:
  std::string path_;
  Plan plan_;
  std::optional<FolderLock> lock_;
  std::ofstream file_;
  std::string failure_;  ///< why nothing more is kept; empty: it is
  Cells kept_;
};

/// Plan and cells that a folder holds. Throws ConfigError when there are none.
struct Part {
  std::string path;
  Plan plan;
  Cells cells;
};
Part read_part(const std::string& folder);

/// All at once: complete or not at all.
void write_part(const std::string& folder, const Plan& plan, const Cells& cells);

void make_folder(const std::string& folder);

}  // namespace twoport::lab
