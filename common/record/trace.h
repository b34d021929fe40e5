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
  /// Writes the header. `file` must outlive this. `size`: number of coordinates of a port.
  explicit Trace(WholeFile& file, int size = N);

  void add(const Row<N>& row);

 private:
  WholeFile* file_;
  int size_;
  std::string line_;
};

TWOPORT_DECLARE(Trace);

}  // namespace twoport
