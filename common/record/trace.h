#pragma once

#include <string>

#include "common/base/built_for.h"
#include "common/base/file.h"
#include "common/record/row.h"

namespace twoport {

/// Writes trace.csv, one row per master tick, into a file that the caller commits.
template <int N>
class Trace {
 public:
  /// Writes the header. `file` must outlive this.
  explicit Trace(WholeFile& file);

  void add(const Row<N>& row);

 private:
  WholeFile* file_;
  std::string line_;
};

TWOPORT_DECLARE(Trace);

}  // namespace twoport
