#pragma once

#include <string_view>

#include "common/method/internal_model/master.h"
#include "common/method/internal_model/slave.h"

namespace twoport {

struct InternalModelControl {
  static constexpr std::string_view kNames[] = {"INTERNAL_MODEL"};
  static constexpr std::string_view kSummary =
      "a local model of the surface at the master, corrected by the delayed force and limited by an energy spring";
  template <int N>
  using Master = InternalModelMaster<N>;
  template <int N>
  using Slave = InternalModelSlave<N>;
};

}  // namespace twoport
