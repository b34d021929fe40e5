#pragma once

#include "common/link/environment_message.h"

namespace twoport {

/// The surfaces of a simulated robot's environment, whose stiffness and friction can be changed while it runs. From the cycle's
/// thread; no call allocates or waits.
///
/// A change is spread over kEnvironmentRamp. Stiffness that changes by ΔK at the depth d does the work ΔK d²/2 on whatever presses the
/// surface. That work is no part of the link's account, whose port is the robot; it is added up here.
class AdjustableEnvironment {
 public:
  /// Begins to change the first `count` surfaces. False, and nothing is changed, where a value is out of range.
  virtual bool adjust(const EnvironmentMessage& request) noexcept = 0;
  /// Fills the answer, the surfaces as they are now, the joints of an arm, and the object that its fingers may take.
  virtual void describe(EnvironmentMessage& state) const noexcept = 0;

 protected:
  ~AdjustableEnvironment() = default;
};

inline constexpr double kEnvironmentRamp = 0.1;  // [s]

}  // namespace twoport
