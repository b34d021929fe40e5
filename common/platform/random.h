#pragma once

#include <cstdint>

namespace twoport {

/// 64 bits from the system's generator, which nobody can predict. No allocation, no lock. Ends the program where the
/// system has no such generator.
std::uint64_t system_random() noexcept;

}  // namespace twoport
