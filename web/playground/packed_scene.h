#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <boost/preprocessor/repetition/enum_params.hpp>
#include <boost/preprocessor/repetition/repeat_from_to.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "common/arm/parameters.h"
#include "common/base/check.h"
#include "common/base/scalar.h"
#include "common/scene/scene.h"

namespace twoport::playground {

/// Stands for any value when the fields of a struct are counted.
struct AnyValue {
  template <class T>
  operator T() const noexcept;  // NOLINT(google-explicit-constructor)
};
template <class T, class... Values>
consteval std::size_t count_fields() {
  if constexpr (requires { T{Values{}..., AnyValue{}}; }) {
    return count_fields<T, Values..., AnyValue>();
  } else {
    return sizeof...(Values);
  }
}
/// Number of fields of a struct without a base class.
template <class T>
inline constexpr std::size_t kFields = count_fields<T>();
/// It is no aggregate. A wrong number does not compile.
template <>
inline constexpr std::size_t kFields<Scene> = 29;

/// Calls see(field...) with all fields of a struct. C++20 has no bindings of any number, so there is a
/// branch for each.
template <class T, class See>
void with_fields(T& of, See see) {
  static_assert(kFields<T> >= 1 && kFields<T> <= 48);
#define TWOPORT_BRANCH(z, count, unused)         \
  if constexpr (kFields<T> == count) {           \
    auto& [BOOST_PP_ENUM_PARAMS(count, v)] = of; \
    return see(BOOST_PP_ENUM_PARAMS(count, v));  \
  }
  BOOST_PP_REPEAT_FROM_TO(1, 49, TWOPORT_BRANCH, )
#undef TWOPORT_BRANCH
}

// A scene as bytes, so that a core without Protobuf has it: all fields in their order, numbers little-endian (doubles
// of 64 bits), a list after its length, a choice after its index. Both sides are built from the same sources. A scene with a mesh,
// a recorded hand or a plug-in of a method cannot be packed.

/// Is it one of these? Their content is not packed.
template <class T>
inline constexpr bool kLeftOut =
    std::is_same_v<T, SceneSource> || std::is_same_v<T, TransparencyHost> || std::is_same_v<T, ArmModel>;
template <class T>
inline constexpr bool kRefused = std::is_same_v<T, RecordedHand> || std::is_same_v<T, DistanceField>;

/// Writes a scene to bytes, or reads it from them: one walk for both, so that they cannot differ.
template <bool kWrites>
class Archive {
 public:
  /// Reads; on a little-endian machine, as WebAssembly is.
  explicit Archive(const char* bytes = nullptr) : at_{bytes} {}

  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      pass(&value, sizeof value);
      if constexpr (kWrites && std::endian::native == std::endian::big)
        std::reverse(bytes_.end() - sizeof value, bytes_.end());
    } else {
      walk(value);
    }
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void pass(void* data, std::size_t size) {
    if constexpr (kWrites) {
      bytes_.append(static_cast<const char*>(data), size);
    } else {
      std::memcpy(data, at_, size);
      at_ += size;
    }
  }
  /// Of what is written; what is read may be another one.
  template <class T>
  T passed(T value) {
    (*this)(value);
    return value;
  }
  std::size_t count(std::size_t n) { return passed(static_cast<std::uint32_t>(n)); }

  void walk(std::string& s) {
    s.resize(count(s.size()));
    pass(s.data(), s.size());
  }
  template <class T>
  void walk(std::vector<T>& list) {
    list.resize(count(list.size()));
    for (T& each : list) (*this)(each);
  }
  template <class T>
  void walk(std::optional<T>& value) {
    const bool is_there = passed(value.has_value());
    if (!kWrites) value.reset();
    if (is_there) (*this)(kWrites ? *value : value.emplace());
  }
  template <class... T>
  void walk(std::variant<T...>& choice) {
    [[maybe_unused]] std::size_t index = count(choice.index());
    if constexpr (!kWrites) ((index-- == 0 ? static_cast<void>(choice.template emplace<T>()) : void()), ...);
    std::visit(*this, choice);
  }
  template <class T>
  void walk(std::shared_ptr<T>& value) {
    using Value = std::remove_const_t<T>;
    if constexpr (kWrites && kRefused<Value>) {
      throw ConfigError{"a mesh or a recorded hand"};
    } else if constexpr (kRefused<Value> || kLeftOut<Value>) {
      if (!kWrites) value = nullptr;
    } else if (!passed(value != nullptr)) {
      value = nullptr;
    } else if constexpr (std::is_same_v<Value, Profile>) {
      walk_profile(value);
    } else {
      if constexpr (!kWrites) value = std::make_shared<Value>();
      (*this)(const_cast<Value&>(*value));
    }
  }
  /// As its corners, exactly those that it was made from: every chain ends on the axis by a segment across it, and one that comes from
  /// infinity comes across it too.
  void walk_profile(std::shared_ptr<const Profile>& value) {
    std::vector<Eigen::Vector2d> corners;
    bool endless = false;
    if constexpr (kWrites) {
      const auto& segments = value->segments();
      endless = !std::isfinite(segments.front().from);
      if (endless) corners.emplace_back(2.0 * segments.front().origin.x(), segments.front().origin.y());
      for (const Profile::Segment& s : segments)
        if (!endless || &s != &segments.front()) corners.push_back(s.origin);
      corners.emplace_back(0.0, segments.back().origin.y());
    }
    (*this)(endless);
    (*this)(corners);
    if constexpr (!kWrites) value = std::make_shared<const Profile>(std::move(corners), endless);
  }
  template <class Kind>
  void walk(Scalar<Kind>& value) {
    value = Scalar<Kind>{passed(value.si())};
  }
  void walk(Eigen::Quaterniond& q) { walk(q.coeffs()); }
  template <int Rows, int Columns>
  void walk(Eigen::Matrix<double, Rows, Columns>& m) {
    for (int i = 0; i < Rows * Columns; ++i) (*this)(m.data()[i]);
  }
  void walk(Eigen::Array<double, kJointPort, 1>& a) {
    for (double& each : a) (*this)(each);
  }
  template <class T>
  void walk(T& value) requires std::is_class_v<T> {
    if constexpr (std::is_base_of_v<Revolved, T> && !std::is_same_v<T, Revolved>) {
      (*this)(static_cast<Revolved&>(value));
    } else {
      with_fields(value, [this](auto&... fields) { ((*this)(fields), ...); });
    }
  }

  std::string bytes_;
  const char* at_;
};
using Packer = Archive<true>;
using Unpacker = Archive<false>;

}  // namespace twoport::playground
