#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace twoport {

/// What has become of a request to zero the robot's force sensor (SensorZero).
enum class ZeroAnswer : std::uint8_t { none, zeroed, no_sensor, joints, moves, presses, changes, too_large };
inline constexpr std::size_t kZeroAnswers = 8;

/// The answer in words; empty before the first one.
constexpr std::string_view sentence(ZeroAnswer answer) {
  constexpr std::string_view kSentences[kZeroAnswers] = {
      "",
      "the force sensor is zeroed",
      "the force sensor is not zeroed: the robot has none",
      "the force sensor is not zeroed: with space JOINTS the torques of the joints are measured",
      "the force sensor is not zeroed: the robot moved by more than 25 mm or 0.1 rad within 0.5 s; hold it still",
      "the force sensor is not zeroed: the coupling presses with more than 0.3 N or 0.03 N m; let go of the handle; a "
      "robot that obeys "
      "positions only is zeroed before a master pairs",
      "the force sensor is not zeroed: its reading changed by more than 0.3 N or 0.03 N m within 0.5 s; touch nothing",
      "the force sensor is not zeroed: it reads more than 10 N or 1 N m, which is no drift; touch nothing, or set "
      "robot_mount"};
  return kSentences[static_cast<std::size_t>(answer)];
}

/// A force sensor while nothing is pressed, and the requests to zero it.
struct SensorRest {
  ZeroAnswer answer = ZeroAnswer::none;  ///< to the newest request
  bool asked = false;                    ///< a request waits for its answer
  std::uint32_t answered = 0;            ///< requests so far that have an answer
  std::uint32_t zeroed = 0;              ///< those that were granted
  double taken_n = 0.0;                  ///< force that the newest of them has taken away
  double drift_n = -1.0;                 ///< force read when nothing was pressed last; negative: not known yet
};

/// What each drift that is larger than before is said at [N]: as much as counts as a contact.
inline constexpr double kSensorDriftSaid_n = 0.3;

}  // namespace twoport
