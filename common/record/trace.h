#pragma once

#include <string>

#include "common/base/file.h"
#include "common/record/row.h"

namespace twoport {

/// trace.csv: one row per master tick. It appears under its name when close() has written all of it, so that a killed run
/// leaves no half a trace. Throws ConfigError with the path and the reason when it cannot be opened.
template <int N>
class Trace {
 public:
  explicit Trace(const std::string& path);

  void add(const Row<N>& row);
  /// Throws IoError when not all of it could be written.
  void close() { file_.commit(); }

 private:
  WholeFile file_;
  std::string line_;
};

extern template class Trace<1>;
extern template class Trace<3>;
extern template class Trace<6>;

}  // namespace twoport
