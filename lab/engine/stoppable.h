#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "lab/engine/simulation.h"

namespace twoport::lab {

/// What a run throws that has been stopped.
struct Stopped {};

/// A simulation, and its copies, that end by throwing Stopped within kEvery ticks after `stop` has become true.
template <int N>
class Stoppable final : public Simulation<N> {
 public:
  Stoppable(std::unique_ptr<Simulation<N>> simulation, const std::atomic<bool>& stop)
      : simulation_{std::move(simulation)}, stop_{&stop} {}

  std::uint64_t run_until(Duration end, const typename Simulation<N>::Visit& visit) override {
    return simulation_->run_until(end, [&](const Row<N>& row) {
      if (ticks_++ % kEvery == 0 && *stop_) throw Stopped{};
      return visit(row);
    });
  }
  [[nodiscard]] std::unique_ptr<Simulation<N>> copy() const override {
    return std::make_unique<Stoppable>(simulation_->copy(), *stop_);
  }
  void be_quiet() override { simulation_->be_quiet(); }
  Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) override { return simulation_->kick(master, slave); }
  [[nodiscard]] Duration end() const override { return simulation_->end(); }
  [[nodiscard]] std::int64_t ticks() const override { return simulation_->ticks(); }
  [[nodiscard]] Energy initial_energy() const override { return simulation_->initial_energy(); }
  [[nodiscard]] Energy granted_energy() const override { return simulation_->granted_energy(); }
  [[nodiscard]] std::optional<Energy> mechanical_energy() const override { return simulation_->mechanical_energy(); }
  [[nodiscard]] double quiet_from_s() const override { return simulation_->quiet_from_s(); }
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const override { return simulation_->segment_times(); }
  [[nodiscard]] std::optional<LinkUse> link() const override { return simulation_->link(); }

 private:
  static constexpr std::uint64_t kEvery = 256;

  std::unique_ptr<Simulation<N>> simulation_;
  const std::atomic<bool>* stop_;
  std::uint64_t ticks_ = 0;
};

}  // namespace twoport::lab
