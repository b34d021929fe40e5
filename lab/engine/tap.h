#pragma once

#include <cstdint>
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

  /// run_cycle, recorded.
  template <class Node, class Plant, class Mail, class Clock>
  auto cycle(Node& node, Plant& plant, Mail& mail, const Tick<Clock>& tick) noexcept {
    tick_.now = tick.now.time_since_epoch();
    tick_.dt = tick.dt, tick_.ended = tick.ended;
    tick_.t_s = to_seconds(tick_.now).si();
    tick_.sends = false;
    if constexpr (requires { node.epoch(); }) tick_.epoch_before = tick_.epoch = node.epoch();
    received_.clear();
    Reading<Plant> reading{plant, tick_};
    const auto out = run_cycle(node, reading, mail, tick);
    tick_.take_output(out);
    write();
    return out;
  }

 private:
  template <class Plant>
  struct Reading {
    Plant& plant;
    TickRecord<N>& into;
    template <class Clock>
    auto sense(const Tick<Clock>& tick) noexcept {
      const auto sample = plant.sense(tick);
      into.take(sample);
      return sample;
    }
    void actuate(const auto& command) noexcept { plant.actuate(command); }
  };

  void write() noexcept {
    if (side_) side_->add(tick_, std::span<const Report<N>>{received_});
    ++tick_.number;
  }

  std::optional<RecordingSide> side_;
  TickRecord<N> tick_;
  std::vector<Report<N>> received_;
};

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
struct Nothing {};

}  // namespace twoport::lab
