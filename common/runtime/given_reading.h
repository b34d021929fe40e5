#pragma once

#include "common/base/time.h"

namespace twoport {

/// Hardware for run_cycle() whose reading is given; commands go nowhere.
template <class Sample>
struct GivenReading {
  Sample sample;
  template <class Clock>
  Sample sense(const Tick<Clock>&) const noexcept {
    return sample;
  }
  static void actuate(const auto&) noexcept {}
};

}  // namespace twoport
