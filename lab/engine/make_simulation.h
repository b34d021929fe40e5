#pragma once

#include "common/method/passivity/time_domain/time_domain.h"
#include "lab/engine/loops.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {

/// A loop behind the interface.
template <int N, class Loop>
class Compiled final : public Simulation<N> {
 public:
  template <class... Arguments>
  explicit Compiled(const Scene& scene, Arguments... arguments) : loop_{scene, arguments...} {}
  std::uint64_t run_until(Duration end, const typename Simulation<N>::Visit& visit) override {
    return loop_.run(end, visit);
  }
  std::uint64_t run_silently() override {
    if constexpr (requires { loop_.run_silently(); }) {
      return loop_.run_silently();
    } else {
      return Simulation<N>::run_silently();
    }
  }
  [[nodiscard]] std::unique_ptr<Simulation<N>> copy() const override { return std::make_unique<Compiled>(*this); }
  void be_quiet() override { loop_.be_quiet(); }
  Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) override { return loop_.kick(master, slave); }
  [[nodiscard]] Duration end() const override { return loop_.end(); }
  [[nodiscard]] std::int64_t ticks() const override { return loop_.ticks(); }
  [[nodiscard]] Energy initial_energy() const override { return loop_.initial_energy(); }
  [[nodiscard]] Energy granted_energy() const override { return loop_.granted_energy(); }
  [[nodiscard]] std::optional<Energy> mechanical_energy() const override {
    if constexpr (requires { loop_.mechanical_energy(); }) {
      return loop_.mechanical_energy();
    } else {
      return std::nullopt;
    }
  }
  [[nodiscard]] double quiet_from_s() const override { return loop_.quiet_from_s(); }
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const override { return loop_.segment_times(); }
  [[nodiscard]] std::optional<LinkUse> link() const override {
    if constexpr (requires { loop_.link(); }) {
      return loop_.link();
    } else {
      return std::nullopt;
    }
  }

 private:
  Loop loop_;
};

template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, Taps<N>* taps) {
  if constexpr (N != kJointPort) {
    if (scene.control.architecture == Architecture::render)
      return std::make_unique<Compiled<N, RenderLoop<N>>>(scene, taps);
    if (scene.control.architecture == Architecture::uncontrolled)
      return std::make_unique<Compiled<N, BodyLoop<N>>>(scene);
    // One loop for each size does for every method; the controllers that sweeps run most have one of their own, 10 % faster.
    if (scene.control.transparency == kPlainTransparency &&
        scene.control.controller.method != ::twoport::Method::none && scene.schedule.empty())
      return std::make_unique<Compiled<N, LinkLoop<N, TimeDomainPassivity>>>(scene, taps);
  }
  return std::make_unique<Compiled<N, LinkLoop<N>>>(scene, taps);
}

}  // namespace twoport::lab
