#pragma once

#include <algorithm>
#include <cstdint>

#include "common/base/time.h"

namespace twoport {

/// What a receiver takes for the age of a report.
struct AgeOptions {
  Duration hold_after = std::chrono::milliseconds{100};  ///< control.hold_after_s
  Duration round_trip{0};                                ///< as the scene has it; 0: not known
};

/// Decides whether a report is proven young, from one clock alone. A report that echoes this side's stamp of the time t was made after
/// t, so its age is at most
///
///     a = now - t                    of the stamp that has come back; it may have waited at the other side, which counts hold_after/2
///     young:  a <= R + hold_after    R: round trip known so far
///     a > R:  R rises by 0.2 dt      with each young report, dt since the last one: R follows the upper part of a jitter. At most 5 s,
///                                    or the scene's round trip
///     a < R:  R falls by (R - a) dt/1 s
///     R = the largest age of both    where no report is young in two adjacent windows of hold_after/2, and their least ages a', a''
///                                    differ by less than hold_after/8: the link has another round trip; at most a'' + hold_after
///
/// Ages that change by a quarter of the clock or more do not agree: a dead direction, a slow replay, a queue that drains. When either direction is dead no new stamp
/// comes back: ages grow with the clock, and teach nothing. The clocks of the two sides may differ and drift. What cannot be known: a
/// queue whose delay changes more slowly is a link with this delay.
class ReportAge {
 public:
  explicit ReportAge(const AgeOptions& o = {})
      : o_{o}, window_{std::max(o.hold_after / 2, Duration{1})}, round_trip_{o.round_trip} {}

  /// Of a new session.
  void reset() noexcept { *this = ReportAge{o_}; }

  /// Of a report that echoes nothing yet and was made after the own time `after`, as the session's begin.
  [[nodiscard]] bool admits_first(Duration after, Duration now) const noexcept { return is_young(now - after); }
  /// Of a report that is newer than all before and echoes the own stamp `echo`. `now` must not decrease.
  bool admits(Duration echo, Duration now) noexcept {
    const Duration age = now - echo;
    if (age < Duration{0}) return false;  // nobody has sent this back
    is_answered_ = echo > newest_echo_;
    if (now - window_from_ >= window_) [[unlikely]]
      end_window(now);
    const bool young = is_young(age);
    if (is_answered_) {
      newest_echo_ = echo;
      least_ = std::min(least_, age);
      most_ = std::max(most_, age);
      if (young) learn(age, now);
    }
    learned_at_ = now;
    return young;
  }
  /// Known so far.
  [[nodiscard]] Duration round_trip() const noexcept { return round_trip_; }
  /// Did the last report to be judged send back a newer stamp than those before?
  [[nodiscard]] bool is_answered() const noexcept { return is_answered_; }
  /// Longest time that a stamp may have waited at this side when it is sent back.
  [[nodiscard]] Duration longest_wait() const noexcept { return o_.hold_after / 2; }

 private:
  static constexpr Duration kNever = Duration::max(), kLongest = std::chrono::seconds{5};
  static constexpr Duration kLongestTick = std::chrono::milliseconds{20};
  static constexpr std::int64_t kRise = 5, kFall_us = 1'000'000;

  [[nodiscard]] bool is_young(Duration age) const noexcept { return age <= round_trip_ + o_.hold_after; }

  void learn(Duration age, Duration now) noexcept {
    const Duration dt = std::min(now - learned_at_, kLongestTick);
    if (age > round_trip_)
      round_trip_ = std::min({age, round_trip_ + dt / kRise, std::max(kLongest, o_.round_trip)});
    else
      round_trip_ -= (round_trip_ - age) / kFall_us * (dt / std::chrono::microseconds{1});
  }

  void end_window(Duration now) noexcept {
    const bool adjacent = now - window_from_ < 2 * window_;  // reports came in both
    if (adjacent && least_ != kNever && least_before_ != kNever && !is_young(least_) && least_ <= kLongest) {
      const Duration change = least_ > least_before_ ? least_ - least_before_ : least_before_ - least_;
      if (change < o_.hold_after / 8) round_trip_ = std::min(std::max(most_, most_before_), least_ + o_.hold_after);
    }
    least_before_ = adjacent ? least_ : kNever;
    least_ = kNever;
    most_before_ = most_;
    most_ = Duration{0};
    window_from_ = now;
  }

  AgeOptions o_;
  Duration window_, round_trip_;
  Duration newest_echo_ = Duration::min(), learned_at_{0};
  Duration window_from_{0}, least_ = kNever, least_before_ = kNever, most_{0}, most_before_{0};
  bool is_answered_ = true;
};

}  // namespace twoport
