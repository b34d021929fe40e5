#pragma once

#include "common/link/report.h"

namespace twoport {

/// What a side knows of the link at one tick.
struct Health {
  bool heard;   ///< a report of the other side has arrived within hold_after
  bool silent;  ///< none within release_after
};

/// idle -> coupled on the first report; coupled -> holding when the link falls silent; holding -> coupled when it is
/// heard again, -> released when it stays silent; released -> coupled when it is heard again.
[[nodiscard]] constexpr Mode next_mode(Mode mode, const Health& health) noexcept {
  if (health.heard) return Mode::coupled;
  if (mode == Mode::coupled || mode == Mode::holding) return health.silent ? Mode::released : Mode::holding;
  return mode;
}

/// Does a change from `was` to `mode` begin a coupling? Coming back from holding goes on with the one there is.
[[nodiscard]] constexpr bool begins(Mode was, Mode mode) noexcept {
  return mode != was && mode == Mode::coupled && was != Mode::holding;
}

static_assert(next_mode(Mode::idle, {.heard = false, .silent = true}) == Mode::idle);
static_assert(next_mode(Mode::coupled, {.heard = false, .silent = false}) == Mode::holding);
static_assert(next_mode(Mode::holding, {.heard = false, .silent = true}) == Mode::released);
static_assert(next_mode(Mode::released, {.heard = true, .silent = false}) == Mode::coupled);

}  // namespace twoport
