#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>

#include "drivers/force_feedback.h"

namespace twoport {

/// ForceFeedback or Rumble on a thread of ordinary priority: an upload may take milliseconds.
template <class Effect>
class EffectThread {
 public:
  /// `port` must outlive it.
  EffectThread(EffectPort& port, double full_n) : effect_{port, full_n}, works_{effect_.start()} {
    if (works_) thread_ = std::thread{[this] { run(); }};
  }
  ~EffectThread() {
    effect_.let_go();
    going_ = false;
    if (thread_.joinable()) thread_.join();
    effect_.end();
  }
  EffectThread(const EffectThread&) = delete;
  EffectThread& operator=(const EffectThread&) = delete;

  /// False: the device takes no such effect.
  [[nodiscard]] bool works() const noexcept { return works_; }
  [[nodiscard]] Effect& effect() noexcept { return effect_; }
  /// From the end of a round that took `spent` to the next one: a device that is slow to take effects is left alone for half of the time.
  static constexpr Duration pause(Duration spent) noexcept { return std::max(ForceFeedback::kPeriod - spent, spent); }

 private:
  void run() noexcept {
    using std::chrono::steady_clock;
    while (going_ || !effect_.at_rest()) {
      const auto begun = steady_clock::now();
      effect_.round(begun.time_since_epoch());
      std::this_thread::sleep_for(pause(steady_clock::now() - begun));
    }
  }

  Effect effect_;
  bool works_;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

}  // namespace twoport
