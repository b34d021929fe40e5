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

/// Calls see(field...) with all fields of a struct. C++20 has no bindings of any number, so there is a
/// branch for each.
template <class T, class See>
void with_fields(T& of, See see) {
  static_assert(kFields<T> >= 1 && kFields<T> <= 40);
#define TWOPORT_BRANCH(z, count, unused)         \
  if constexpr (kFields<T> == count) {           \
    auto& [BOOST_PP_ENUM_PARAMS(count, v)] = of; \
    return see(BOOST_PP_ENUM_PARAMS(count, v));  \
  }
  BOOST_PP_REPEAT_FROM_TO(1, 41, TWOPORT_BRANCH, )
#undef TWOPORT_BRANCH
}

// A scene as bytes, so that a core without Protobuf has it: all fields in their order, numbers little-endian (doubles
// of 64 bits), a list after its length, a choice after its index. Both sides are built from the same sources. A scene with a mesh,
// a recorded hand or a plug-in of a method cannot be packed.

/// Is it one of these? Their content is not packed.
template <class T>
inline constexpr bool kLeftOut = std::is_same_v<T, SceneSource> || std::is_same_v<T, TransparencyHost>;
template <class T>
inline constexpr bool kRefused = std::is_same_v<T, RecordedHand> || std::is_same_v<T, DistanceField>;

class Packer {
 public:
  template <class T>
  void operator()(const T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      const auto* bytes = reinterpret_cast<const char*>(&value);
      bytes_.append(bytes, sizeof value);
      if constexpr (std::endian::native == std::endian::big) std::reverse(bytes_.end() - sizeof value, bytes_.end());
    } else {
      pack(value);
    }
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void count(std::size_t n) { (*this)(static_cast<std::uint32_t>(n)); }
  void pack(const std::string& s) {
    count(s.size());
    bytes_ += s;
  }
  template <class T>
  void pack(const std::vector<T>& list) {
    count(list.size());
    for (const T& each : list) (*this)(each);
  }
  template <class T>
  void pack(const std::optional<T>& value) {
    (*this)(value.has_value());
    if (value) (*this)(*value);
  }
  template <class... T>
  void pack(const std::variant<T...>& choice) {
    count(choice.index());
    std::visit([this](const auto& value) { (*this)(value); }, choice);
  }
  template <class T>
  void pack(const std::shared_ptr<T>& value) {
    if constexpr (kRefused<std::remove_const_t<T>>) {
      throw ConfigError{"a mesh or a recorded hand"};
    } else if constexpr (!kLeftOut<std::remove_const_t<T>>) {
      (*this)(value != nullptr);
      if (value) (*this)(*value);
    }
  }
  template <class Kind>
  void pack(const Scalar<Kind>& value) {
    (*this)(value.si());
  }
  void pack(const Eigen::Quaterniond& q) { (*this)(Eigen::Vector4d{q.coeffs()}); }
  template <int Rows, int Columns>
  void pack(const Eigen::Matrix<double, Rows, Columns>& m) {
    for (int i = 0; i < Rows * Columns; ++i) (*this)(m.data()[i]);
  }
  /// As its corners, exactly those that it was made from: every chain ends on the axis by a segment across it, and one that comes from
  /// infinity comes across it too.
  void pack(const Profile& p) {
    const auto& segments = p.segments();
    const bool endless = !std::isfinite(segments.front().from);
    std::vector<Eigen::Vector2d> corners;
    if (endless) corners.emplace_back(2.0 * segments.front().origin.x(), segments.front().origin.y());
    for (const Profile::Segment& s : segments)
      if (!endless || &s != &segments.front()) corners.push_back(s.origin);
    corners.emplace_back(0.0, segments.back().origin.y());
    (*this)(endless);
    (*this)(corners);
  }
  template <class T>
  void pack(const T& value) requires std::is_class_v<T> {
    if constexpr (std::is_base_of_v<Revolved, T> && !std::is_same_v<T, Revolved>) {
      (*this)(static_cast<const Revolved&>(value));
    } else {
      with_fields(value, [this](const auto&... fields) { ((*this)(fields), ...); });
    }
  }

  std::string bytes_;
};

/// On a little-endian machine, as WebAssembly is.
class Unpacker {
 public:
  explicit Unpacker(const char* bytes) : at_{bytes} {}
  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      std::memcpy(&value, at_, sizeof value);
      at_ += sizeof value;
    } else {
      unpack(value);
    }
  }

 private:
  template <class T>
  T get() {
    T value{};
    (*this)(value);
    return value;
  }
  std::size_t count() { return get<std::uint32_t>(); }
  void unpack(std::string& s) {
    const std::size_t size = count();
    s.assign(at_, size);
    at_ += size;
  }
  template <class T>
  void unpack(std::vector<T>& list) {
    list.resize(count());
    for (T& each : list) (*this)(each);
  }
  template <class T>
  void unpack(std::optional<T>& value) {
    value.reset();
    if (get<bool>()) (*this)(value.emplace());
  }
  template <class... T>
  void unpack(std::variant<T...>& choice) {
    std::size_t index = count();
    ((index-- == 0 ? (*this)(choice.template emplace<T>()) : void()), ...);
  }
  template <class T>
  void unpack(std::shared_ptr<T>& value) {
    using Value = std::remove_const_t<T>;
    value = nullptr;
    if constexpr (std::is_same_v<Value, Profile>) {
      if (!get<bool>()) return;
      const bool endless = get<bool>();
      value = std::make_shared<const Profile>(get<std::vector<Eigen::Vector2d>>(), endless);
    } else if constexpr (!kRefused<Value> && !kLeftOut<Value>) {
      if (!get<bool>()) return;
      const auto made = std::make_shared<Value>();
      (*this)(*made);
      value = made;
    }
  }
  template <class Kind>
  void unpack(Scalar<Kind>& value) {
    value = Scalar<Kind>{get<double>()};
  }
  void unpack(Eigen::Quaterniond& q) {
    Eigen::Vector4d c;
    (*this)(c);
    q.coeffs() = c;
  }
  template <int Rows, int Columns>
  void unpack(Eigen::Matrix<double, Rows, Columns>& m) {
    for (int i = 0; i < Rows * Columns; ++i) (*this)(m.data()[i]);
  }
  template <class T>
  void unpack(T& value) requires std::is_class_v<T> {
    if constexpr (std::is_base_of_v<Revolved, T> && !std::is_same_v<T, Revolved>) {
      (*this)(static_cast<Revolved&>(value));
    } else {
      with_fields(value, [this](auto&... fields) { ((*this)(fields), ...); });
    }
  }

  const char* at_;
};

}  // namespace twoport::playground
