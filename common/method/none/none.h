#pragma once

#include <string_view>

#include "common/method/none/master.h"
#include "common/method/none/slave.h"

namespace twoport {

struct NoControl {
  static constexpr std::string_view kNames[] = {"NONE"};
  static constexpr bool kKeepsAccount = false;
  static constexpr std::string_view kSummary = "no passivity control: transparent, and unstable over delay";
  template <int N>
  using Master = NoControlMaster<N>;
  template <int N>
  using Slave = NoControlSlave<N>;
};

}  // namespace twoport
