#pragma once

#include <cstdint>

namespace twoport {

/// What a driver says of a reading.
enum class HardwareStatus : std::uint8_t {
  ok,
  stale,  ///< nothing newer has arrived since the last tick; this is the last reading again
  fault,  ///< the hardware has failed or stopped itself; the program releases it and ends
};

}  // namespace twoport
