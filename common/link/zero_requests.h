#pragma once

#include <algorithm>
#include <cstdint>

#include "common/link/environment_message.h"

namespace twoport {

/// A master's requests to zero the force sensor of the slave's robot. A number that the slave has not seen grow in this session is of an
/// earlier one: the first is sent when the slave has answered something.
class ZeroRequests {
 public:
  void ask() noexcept { rest_.asked = is_used_ = true; }
  /// Has any been asked for?
  [[nodiscard]] bool is_used() const noexcept { return is_used_; }
  [[nodiscard]] const SensorRest& rest() const noexcept { return rest_; }

  /// In every tick: what the slave has said, and this side says.
  void step(const EnvironmentMessage& heard, EnvironmentMessage& say) noexcept {
    rest_.drift_n = heard.number > 0 ? heard.sensor_drift_n : -1.0;
    if (!rest_.asked || heard.number == 0) return;
    if (!is_sent_) {
      say.zero_number = std::max(say.zero_number, heard.zero_number) + 1;
      is_sent_ = true;
      return;
    }
    if (heard.zero_number < say.zero_number) return;
    is_sent_ = false;
    // The slave has begun a session since: it has taken the number for an earlier one.
    if (heard.zero_answer == ZeroAnswer::none) return;
    rest_.asked = false;
    rest_.answer = heard.zero_answer;
    ++rest_.answered;
    if (rest_.answer == ZeroAnswer::zeroed) ++rest_.zeroed;
  }

 private:
  bool is_used_ = false, is_sent_ = false;
  SensorRest rest_;
};

/// The slave's answers to them.
class ZeroAnswers {
 public:
  /// Of every message with a number: is the sensor to be zeroed?
  [[nodiscard]] bool hear(const EnvironmentMessage& heard, std::uint64_t session) noexcept {
    if (session_ != session) {
      session_ = session;
      taken_ = answered_ = heard.zero_number;
      answer_ = ZeroAnswer::none;
      waits_ = false;
    }
    if (heard.zero_number <= taken_) return false;
    taken_ = heard.zero_number;
    return waits_ = true;
  }
  void say(const SensorRest& rest, EnvironmentMessage& to) noexcept {
    if (waits_ && !rest.asked) {
      waits_ = false;
      answered_ = taken_;
      answer_ = rest.answer;
    }
    to.zero_number = answered_;
    to.zero_answer = answer_;
    to.sensor_drift_n = rest.drift_n;
  }

 private:
  std::uint64_t session_ = 0;
  std::uint32_t taken_ = 0, answered_ = 0;  ///< requests of the session: heard, and answered
  ZeroAnswer answer_ = ZeroAnswer::none;
  bool waits_ = false;
};

}  // namespace twoport
