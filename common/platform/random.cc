#include "common/platform/random.h"

#include <sys/random.h>

#include <cstdlib>

namespace twoport {

std::uint64_t system_random() noexcept {
  std::uint64_t number = 0;
  if (getentropy(&number, sizeof number) != 0) std::abort();
  return number;
}

}  // namespace twoport
