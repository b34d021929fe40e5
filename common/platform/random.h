#pragma once

#include <cstdint>

namespace twoport {

/// 64 unpredictable bits from the system's random generator. No allocation, no lock. Ends the program if the system has
/// no such generator.
std::uint64_t system_random() noexcept;

}  // namespace twoport
