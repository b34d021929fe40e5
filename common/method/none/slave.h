#pragma once

#include "common/method/coupling_slave.h"

namespace twoport {

/// No passivity control: the force of the virtual coupling acts unchanged.
template <int N>
class NoControlSlave : public CouplingSlave<N> {
 public:
  explicit NoControlSlave(const ControlOptions& o) : CouplingSlave<N>{o}, measured_{returns_measured_force(o)} {}

  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    const auto wanted = this->want(in);
    SlaveOutput<N> out = this->act(in, wanted.f, wanted.v, wanted.v);
    if (measured_) out.f_back = in.robot.f_environment;
    return out;
  }

 private:
  bool measured_;
};

}  // namespace twoport
