#pragma once

#include <fmt/format.h>

#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/scene/scene.h"
#include "proto/scene.pb.h"

// Checked access to the blocks of a scene message. Internal to common/scene.

namespace twoport {

/// What a number must be, and how an error says it ("must ...").
struct Rule {
  bool (*holds)(double);
  const char* words;
};
// Beyond 1e18 a sum of squares may exceed the range of a double.
inline constexpr Rule kFinite{[](double v) { return std::isfinite(v); }, "be a finite number"};
inline constexpr Rule kPositive{[](double v) { return v > 0.0 && v <= 1e18; }, "be > 0 and at most 1e18"};
inline constexpr Rule kAcute{[](double v) { return v >= 0.0 && v < 90.0; }, "be >= 0 and < 90"};
inline constexpr Rule kNotNegative{[](double v) { return v >= 0.0 && v <= 1e18; }, "be >= 0 and at most 1e18"};
inline constexpr Rule kProbability{[](double v) { return v >= 0.0 && v <= 1.0; }, "be between 0 and 1"};
inline constexpr Rule kRate{[](double v) { return v > 0.0 && v <= 1e5; }, "be > 0 and at most 100000"};
inline constexpr Rule kSpan{[](double v) { return v > 0.0 && v <= 1e6; }, "be > 0 and at most 1000000"};
inline constexpr Rule kMoment{[](double v) { return v >= 0.0 && v <= 60.0; }, "be from 0 to 60"};
inline constexpr Rule kDelay{[](double v) { return v >= 0.0 && v <= 1e6; }, "be between 0 and 1000000"};

/// Allowed lengths of a list: `few`, or `many`, described by `more`.
struct Count {
  int few, many;
  const char* more;
  [[nodiscard]] std::string words() const;
};

/// Common context of the checks of one scene.
struct Context {
  std::string file;
  int dof = 0;

  [[nodiscard]] Count point() const { return dof == 1 ? Count{1, 1, ""} : Count{3, 3, ""}; }
  [[nodiscard]] Count pose() const { return dof == 6 ? Count{3, 7, "with the attitude w x y z"} : point(); }
  [[nodiscard]] Count twist() const { return dof == 6 ? Count{3, 6, "with the rotation"} : point(); }
};

/// A field of the schema: its name in the text, and how generated code reads it. Made by FIELD only.
template <class Value, class Present>
struct Field {
  std::string_view name;
  Value value;      ///< of a message: the field's value, the schema's default where it is absent
  Present present;  ///< of a message: is the field given, or the list not empty?
};
template <class Value, class Present>
Field(std::string_view, Value, Present) -> Field<Value, Present>;

/// The field NAME of whatever block it is read from. A name that the block lacks does not compile. (The generator
/// appends an underscore to a C++ keyword: FIELD(operator_) is the field "operator".)
#define FIELD(NAME)                                                                                \
  ::twoport::Field {                                                                               \
    ::twoport::text_name(#NAME), [](const auto& block) -> decltype(auto) { return block.NAME(); }, \
        [](const auto& block) {                                                                    \
          if constexpr (requires { block.has_##NAME(); }) {                                        \
            return block.has_##NAME();                                                             \
          } else {                                                                                 \
            return !block.NAME().empty();                                                          \
          }                                                                                        \
        }                                                                                          \
  }
constexpr std::string_view text_name(std::string_view accessor) {
  return accessor.ends_with('_') ? accessor.substr(0, accessor.size() - 1) : accessor;
}

/// One block of a scene and where it stands: what does not depend on the block's type. Every error is a ConfigError that
/// names file, path, value and what is allowed. The context and the message must outlive it.
class AnyBlock {
 public:
  [[nodiscard]] const Context& context() const { return context_; }
  [[nodiscard]] int dof() const { return context_.dof; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::string path_of(std::string_view name) const;
  [[noreturn]] void fail(const std::string& words) const;

 protected:
  AnyBlock(const Context& context, const google::protobuf::Message& message, std::string path)
      : context_{context}, message_{message}, path_{std::move(path)} {}

  [[noreturn]] void refuse_field(std::string_view name, const std::string& words) const;
  [[noreturn]] void refuse_missing(std::string_view name, std::string_view words) const;
  [[noreturn]] void refuse_without_rotation(std::string_view name) const;
  [[noreturn]] void refuse_empty() const;
  [[nodiscard]] double checked(std::string_view name, double value, const Rule& rule) const;
  [[nodiscard]] Numbers checked(std::string_view name, Numbers values, const Count& count) const;

 private:
  const Context& context_;
  const google::protobuf::Message& message_;
  std::string path_;
};

template <class Message>
class Block : public AnyBlock {
 public:
  Block(const Context& context, const Message& message, std::string path = "")
      : AnyBlock{context, message, std::move(path)}, message_{message} {}

  [[nodiscard]] const Message& message() const { return message_; }
  [[nodiscard]] bool has(const auto& field) const { return field.present(message_); }

  /// A number, the schema's default where it is absent.
  [[nodiscard]] double number(const auto& field, const Rule& rule) const {
    static_assert(std::same_as<ValueOf<decltype(field)>, double>);
    return checked(field.name, field.value(message_), rule);
  }
  [[nodiscard]] double required(const auto& field, const Rule& rule) const {
    require(field, rule.words);
    return number(field, rule);
  }
  [[nodiscard]] double number_or(const auto& field, const Rule& rule, double absent) const {
    return has(field) ? number(field, rule) : absent;
  }
  [[nodiscard]] std::optional<double> number_if_given(const auto& field, const Rule& rule) const {
    return has(field) ? std::optional{number(field, rule)} : std::nullopt;
  }
  [[nodiscard]] int integer(const auto& field) const {
    static_assert(std::same_as<ValueOf<decltype(field)>, std::int32_t>);
    return field.value(message_);
  }
  [[nodiscard]] std::uint64_t count(const auto& field) const {
    static_assert(std::same_as<ValueOf<decltype(field)>, std::uint64_t>);
    return field.value(message_);
  }
  [[nodiscard]] bool flag(const auto& field) const {
    static_assert(std::same_as<ValueOf<decltype(field)>, bool>);
    return field.value(message_);
  }
  [[nodiscard]] std::string text(const auto& field) const { return field.value(message_); }
  /// The plain enum that counts as the schema's does.
  template <class Enum>
  [[nodiscard]] Enum choice(const auto& field) const {
    static_assert(std::is_enum_v<ValueOf<decltype(field)>>);
    return static_cast<Enum>(field.value(message_));
  }
  /// A list of finite numbers; empty where it is absent.
  [[nodiscard]] Numbers list(const auto& field, const Count& count) const {
    const auto& values = field.value(message_);
    return checked(field.name, Numbers(values.begin(), values.end()), count);
  }
  /// A block within; one of defaults where it is absent.
  [[nodiscard]] auto block(const auto& field) const {
    return Block<ValueOf<decltype(field)>>{context(), field.value(message_), path_of(field.name)};
  }
  [[nodiscard]] auto blocks(const auto& field) const {
    std::vector<Block<typename ValueOf<decltype(field)>::value_type>> all;
    for (const auto& each : field.value(message_))
      all.emplace_back(context(), each, fmt::format("{}[{}]", path_of(field.name), all.size()));
    return all;
  }

  void require(const auto& field, std::string_view words) const {
    if (!has(field)) refuse_missing(field.name, words);
  }
  /// Refuses a rotational field if dof is not 6.
  void only_with_rotation(const auto&... fields) const {
    const auto check = [this](const auto& field) {
      if (dof() != 6 && has(field)) refuse_without_rotation(field.name);
    };
    (check(fields), ...);
  }
  [[noreturn]] void refuse(const auto& field, const std::string& words) const {
    static_cast<void>(field.value(message_));  // it must be a field of this block
    refuse_field(field.name, words);
  }
  /// Refuses the block: it must hold one of several kinds and holds none.
  using AnyBlock::refuse_empty;

 private:
  template <class F>
  using ValueOf = std::remove_cvref_t<decltype(std::declval<const F&>().value(std::declval<const Message&>()))>;

  const Message& message_;
};

/// The direction of `values`, of unit length; empty where they are all zero.
Numbers normalized(Numbers values);

/// A direction, made of unit length. It must be given.
template <class Message>
Numbers direction(const Block<Message>& of, const auto& field) {
  of.require(field, of.context().point().words());
  Numbers unit = normalized(of.list(field, of.context().point()));
  if (unit.empty()) of.refuse(field, "not be zero: it is a direction");
  return unit;
}

/// Makes the attitude of a pose (7 numbers: position, quaternion w x y z) of unit length, and returns the length it had;
/// 1 for a position without one.
double normalize_attitude(Numbers& pose);

/// A position; with an attitude, that one made of unit length.
template <class Message>
Numbers pose(const Block<Message>& of, const auto& field) {
  Numbers values = of.list(field, of.context().pose());
  if (const double length = normalize_attitude(values); !(std::abs(length - 1.0) <= 1e-3))
    of.refuse(field, fmt::format("end in a unit quaternion w x y z, whose length is 1 and not {:.9g}", length));
  return values;
}

}  // namespace twoport
