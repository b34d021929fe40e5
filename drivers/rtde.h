#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

/// Packages of RTDE, protocol version 2, of the controllers of Universal Robots ("Real-Time Data Exchange Guide"): a size of 16 bits, which
/// counts its own three bytes of header, a kind, and what the kind says; numbers with the highest byte first.
namespace twoport::rtde {

enum class Kind : std::uint8_t {
  protocol = 'V',
  controller = 'v',
  text = 'M',
  data = 'U',
  outputs = 'O',
  inputs = 'I',
  start = 'S',
  pause = 'P'
};
inline constexpr std::size_t kHeader = 3;

using Numbers = std::array<double, 6>;

/// What the controller says in every cycle.
struct State {
  double timestamp_s = 0.0;
  Numbers q{}, qd{};  ///< joints [rad], [rad/s]
  Numbers pose{}, speed{},
      force{};  ///< of the tool's point in axes of the base; rotation vector; force of the environment on the tool
  std::int32_t robot_mode = 0, safety_mode = 0;
  std::uint32_t runtime_state = 0;  ///< of the program
  std::int32_t program = 0;         ///< output register, in which a program of this driver says which one it is
};
/// What the program on the controller reads.
struct SetPoint {
  std::int32_t count = 0;  ///< differs from package to package
  std::int32_t mode = 0;
  Numbers numbers{};
};

// Registers of the upper half; the lower one is that of fieldbuses.
inline constexpr std::string_view kOutputs =
    "timestamp,actual_q,actual_qd,actual_TCP_pose,actual_TCP_speed,actual_TCP_force,robot_mode,safety_mode,"
    "runtime_state,output_int_register_24";
inline constexpr std::string_view kOutputTypes =
    "DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,INT32,INT32,UINT32,INT32";
inline constexpr std::string_view kInputs =
    "input_int_register_24,input_int_register_25,input_double_register_24,input_double_register_25,"
    "input_double_register_26,input_double_register_27,input_double_register_28,input_double_register_29";
inline constexpr std::string_view kInputTypes = "INT32,INT32,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE,DOUBLE";

template <class Number>
void put(std::string& to, Number value) {
  static_assert(std::is_arithmetic_v<Number>);
  std::array<char, sizeof(Number)> bytes;
  std::memcpy(bytes.data(), &value, sizeof(Number));
  if constexpr (std::endian::native == std::endian::little) std::reverse(bytes.begin(), bytes.end());
  to.append(bytes.data(), bytes.size());
}
/// Takes a number off `from`, which has it.
template <class Number>
Number take(std::string_view& from) {
  std::array<char, sizeof(Number)> bytes;
  std::copy_n(from.begin(), bytes.size(), bytes.begin());
  if constexpr (std::endian::native == std::endian::little) std::reverse(bytes.begin(), bytes.end());
  from.remove_prefix(bytes.size());
  Number value;
  std::memcpy(&value, bytes.data(), sizeof(Number));
  return value;
}

inline std::string package(Kind kind, std::string_view payload = {}) {
  std::string all;
  put(all, static_cast<std::uint16_t>(kHeader + payload.size()));
  all += static_cast<char>(kind);
  return all.append(payload);
}
inline std::string request_protocol() {
  std::string payload;
  put(payload, std::uint16_t{2});
  return package(Kind::protocol, payload);
}
inline std::string request_outputs(double rate_hz) {
  std::string payload;
  put(payload, rate_hz);
  return package(Kind::outputs, payload.append(kOutputs));
}
inline std::string request_inputs() {
  return package(Kind::inputs, kInputs);
}
inline std::string set_point(std::uint8_t recipe, const SetPoint& s) {
  std::string payload;
  put(payload, recipe);
  put(payload, s.count);
  put(payload, s.mode);
  for (const double number : s.numbers) put(payload, number);
  return package(Kind::data, payload);
}

/// The first name of `names` whose type in the answer is not that of `types`, with it: "speed: NOT_FOUND"; empty: all are as they must be.
inline std::string first_refused(std::string_view names, std::string_view types, std::string_view answered) {
  const auto next = [](std::string_view& list) {
    const std::string_view one = list.substr(0, list.find(','));
    list.remove_prefix(std::min(one.size() + 1, list.size()));
    return one;
  };
  while (!names.empty()) {
    const std::string_view name = next(names), type = next(types), answer = next(answered);
    if (answer != type) return std::string{name} + ": " + std::string{answer};
  }
  return {};
}

/// A text that is no mere information; else empty.
inline std::string warning(std::string_view payload) {
  constexpr std::uint8_t kInformation = 3;
  const auto next = [&payload] {
    const std::size_t size = payload.empty() ? 0 : take<std::uint8_t>(payload);
    const std::string_view one = payload.substr(0, size);
    payload.remove_prefix(one.size());
    return one;
  };
  const std::string_view text = next();
  next();  // its source
  return payload.empty() || take<std::uint8_t>(payload) >= kInformation ? "" : std::string{text};
}

/// Nothing where the package is of another recipe or length, or has a number that is not finite.
inline std::optional<State> read_state(std::string_view payload, std::uint8_t recipe) {
  constexpr std::size_t kSize = 1 + 8 + 5 * 6 * 8 + 4 * 4;
  if (payload.size() != kSize || take<std::uint8_t>(payload) != recipe) return {};
  State s;
  s.timestamp_s = take<double>(payload);
  double sum = s.timestamp_s;
  for (Numbers* numbers : {&s.q, &s.qd, &s.pose, &s.speed, &s.force})
    for (double& number : *numbers) sum += number = take<double>(payload);
  s.robot_mode = take<std::int32_t>(payload);
  s.safety_mode = take<std::int32_t>(payload);
  s.runtime_state = take<std::uint32_t>(payload);
  s.program = take<std::int32_t>(payload);
  return std::isfinite(sum) ? std::optional{s} : std::nullopt;
}

}  // namespace twoport::rtde
