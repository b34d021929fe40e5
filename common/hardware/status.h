#pragma once

#include <cstdint>

namespace twoport {

/// Status of a reading.
enum class HardwareStatus : std::uint8_t {
  ok,
  stale,    ///< no new reading since the last tick; this is the last one again
  fault,    ///< failure; the program releases the hardware and ends
  stopped,  ///< emergency stop; both sides release their hardware until both programs have ended
};

}  // namespace twoport
