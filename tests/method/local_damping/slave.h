#pragma once

#include <tuple>

#include "common/link/payload.h"
#include "common/method/layers.h"

namespace twoport {

/// What the slave's half tells the master's.
struct LocalDampingReport {
  Latest<double> robot_speed_m_per_s;
  auto fields() { return std::tie(robot_speed_m_per_s); }
};

/// The virtual coupling. It tells the robot's speed, but under POSITION_POSITION, where the coupling tells the position.
template <int N>
class LocalDampingSlave final : public Copyable<LocalDampingSlave<N>, SlaveTransparency<N>> {
  using Base = Copyable<LocalDampingSlave<N>, SlaveTransparency<N>>;

 public:
  using Base::Base;
  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    report_.robot_speed_m_per_s.value = in.robot.v.vec().norm();
    const auto wanted = this->want(in);
    return {.f = wanted.f, .v = wanted.v};
  }
  [[nodiscard]] bool has_payload() const noexcept override { return true; }
  void write_payload(Words& words, const Registration<N>& worlds) const noexcept override {
    if (this->coupling_.tells_position()) return Base::write_payload(words, worlds);
    write(report_, words);
  }

 private:
  LocalDampingReport report_;
};

}  // namespace twoport
