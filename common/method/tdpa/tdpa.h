#pragma once

#include <string_view>

#include "common/method/tdpa/master.h"
#include "common/method/tdpa/slave.h"

namespace twoport {

struct TimeDomainPassivity {
  static constexpr std::string_view kNames[] = {"CLASSIC", "FORCE_PROJECTED"};
  static constexpr std::string_view kSummary =
      "two-port time domain passivity approach, correction along the velocity (CLASSIC) or along the force";
  template <int N>
  using Master = TdpaMaster<N>;
  template <int N>
  using Slave = TdpaSlave<N>;
};

}  // namespace twoport
