#pragma once

#include <cstdio>
#include <string>

#include "common/record/row.h"

namespace twoport {

/// trace.csv: one row per master tick, header with units in the names. Written beside its name and renamed by close(),
/// so that a killed run leaves no half a trace. Throws ConfigError with the path and the reason when it cannot write.
template <int N>
class Trace {
 public:
  explicit Trace(std::string path);
  ~Trace();
  Trace(const Trace&) = delete;

  void add(const Row<N>& row);
  /// Throws IoError when not all of it could be written.
  void close();

 private:
  std::string path_, line_;
  std::FILE* file_;
  int error_ = 0;  ///< errno of the first write that failed
};

extern template class Trace<1>;
extern template class Trace<3>;
extern template class Trace<6>;

}  // namespace twoport
