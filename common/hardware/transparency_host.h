#pragma once

#include <memory>
#include <string>

#include "common/base/time.h"
#include "common/hardware/transparency_plugin.h"

namespace twoport {

/// Computes the wish of a transparency layer outside the program's own code.
class TransparencyHost {
 public:
  virtual ~TransparencyHost() = default;
  /// False: it has ended, or does not answer. Real time in a live program.
  virtual bool step(const twoport_transparency_reading& in, twoport_transparency_wish& out) noexcept = 0;
};

/// Starts a process that loads the library `file` and computes its wishes. `waits`: step() waits for the answer, for 1 s at most (virtual
/// time); else it returns the last one that has come, and false after 20 ticks without one. Throws ConfigError in one sentence: no such
/// file, not a library, not a transparency layer, of another version, or it cannot open.
std::shared_ptr<TransparencyHost> start_transparency_process(const std::string& file, const std::string& arguments,
                                                             int dof, Seconds period, bool waits);

}  // namespace twoport
