#pragma once

#include "common/base/time.h"
#include "common/link/payload.h"

namespace twoport {

/// Mailbox of a node without a link.
struct NoReport {};
struct NoMail {
  NoReport nothing;
  const NoReport& collect(Duration) const noexcept { return nothing; }
  void post(NoReport&, Duration) const noexcept {}
};

/// One control period: sense, collect, step, actuate, post. The live programs, the
/// laboratory and a replay use this one function.
template <class Node, class Plant, class Mail, class Clock>
inline auto run_cycle(Node& node, Plant& plant, Mail& mail, const Tick<Clock>& tick) noexcept {
  auto sensed = plant.sense(tick);
  const auto& arrived = mail.collect(tick.now.time_since_epoch());
  auto out = node.step(tick, sensed, arrived);
  plant.actuate(out.command);
  if constexpr (requires(Words & words) { node.write_payload(words); }) {
    if (node.has_payload()) [[unlikely]] {
      Words words;
      node.write_payload(words);
      mail.post(out.report, words, tick.now.time_since_epoch());
      return out;
    }
  }
  mail.post(out.report, tick.now.time_since_epoch());
  return out;
}

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
