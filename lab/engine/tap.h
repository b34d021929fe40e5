#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/base/time.h"
#include "common/recording/recording.h"
#include "common/recording/tick.h"
#include "common/runtime/cycle.h"

namespace twoport::lab {

/// Records the ticks of one node in virtual time.
template <int N>
class SideTap final : public ReportTap<N> {
 public:
  SideTap() = default;
  /// `file` must outlive this.
  SideTap(mcap::Writer& file, const RecordingHeader& header) : side_{RecordingSide{file, header}} {}

  void received(const Report<N>& report) noexcept override { received_.push_back(report); }
  void sent(const Report<N>& report) noexcept override {
    tick_.sends = true;
    tick_.sent = report;
  }

  /// Before a cycle of the node, and after it. By value: what is not seen stays in registers.
  template <class Node, class Clock>
  void begin(const Node& node, Tick<Clock> tick) noexcept {
    tick_.now = tick.now.time_since_epoch();
    tick_.dt = tick.dt, tick_.ended = tick.ended;
    tick_.t_s = to_seconds(tick_.now).si();
    tick_.sends = false;
    if constexpr (requires { node.epoch(); }) tick_.epoch_before = tick_.epoch = node.epoch();
    received_.clear();
  }
  template <class Plant, class Output>
  void end(const Plant& plant, Output out) noexcept {
    tick_.take(plant.sense());
    tick_.take_output(out);
    if (side_) side_->add(tick_, std::span<const Report<N>>{received_});
    ++tick_.number;
  }

 private:
  std::optional<RecordingSide> side_;
  TickRecord<N> tick_;
  std::vector<Report<N>> received_;
};

/// run_cycle, seen by `tap` unless that is null. The plant must still give the reading of the cycle after it.
template <int N, class Node, class Plant, class Mail, class Clock>
inline auto tapped_cycle(SideTap<N>* tap, Node& node, Plant& plant, Mail& mail, const Tick<Clock>& tick) noexcept {
  if (tap != nullptr) [[unlikely]]
    tap->begin(node, tick);
  const auto out = run_cycle(node, plant, mail, tick);
  if (tap != nullptr) [[unlikely]]
    tap->end(plant, out);
  return out;
}

/// Of both sides.
template <int N>
struct Taps {
  SideTap<N> master, slave;
};

/// A pointer that a copy of its owner does not have.
template <class T>
class NotCopied {
 public:
  NotCopied() = default;
  NotCopied(const NotCopied&) noexcept {}
  NotCopied& operator=(const NotCopied&) = delete;
  NotCopied& operator=(T* p) noexcept {
    p_ = p;
    return *this;
  }
  explicit operator bool() const noexcept { return p_ != nullptr; }
  T* operator->() const noexcept { return p_; }

 private:
  T* p_ = nullptr;
};

}  // namespace twoport::lab
