#pragma once

#include <fmt/format.h>

#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/scene/scene.h"
#include "proto/scene.pb.h"

// Access to the blocks of a scene message, and its checks. Internal to common/scene.

namespace twoport {

/// Common context of the checks of one scene.
struct Context {
  std::string file;
  int dof = 0;
  bool joints = false;  ///< are joints the ports?

  [[noreturn]] void fail(const std::string& words) const;
};

/// A field of the schema: its name in the text, and how generated code reads it. Made by FIELD only.
template <class Value>
struct Field {
  std::string_view name;
  Value value;  ///< of a message
};
template <class Value>
Field(std::string_view, Value) -> Field<Value>;

/// The field NAME of whatever block it is asked of. A name that the block lacks does not compile. (The generator appends an underscore
/// to a C++ keyword: FIELD(operator_) is the field "operator".)
#define FIELD(NAME)                                                                               \
  ::twoport::Field {                                                                              \
    ::twoport::text_name(#NAME), [](const auto& block) -> decltype(auto) { return block.NAME(); } \
  }
constexpr std::string_view text_name(std::string_view accessor) {
  return accessor.ends_with('_') ? accessor.substr(0, accessor.size() - 1) : accessor;
}
/// The value of field NAME of a block, nothing where it is absent.
#define GIVEN(BLOCK, NAME) ((BLOCK)->has_##NAME() ? std::optional{(BLOCK)->NAME()} : std::nullopt)

/// One block of a scene and where it stands: what does not depend on the block's type. Every error is a ConfigError that
/// names file, path, value and what is allowed. The context and the message must outlive it.
class AnyBlock {
 public:
  AnyBlock(const Context& context, const google::protobuf::Message& message, std::string path)
      : context_{context}, message_{message}, path_{std::move(path)} {}

  [[nodiscard]] const Context& context() const { return context_; }
  [[nodiscard]] int dof() const { return context_.dof; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::string path_of(std::string_view name) const;
  [[noreturn]] void fail(const std::string& words) const { context_.fail(words); }
  /// Refuses the block: it must hold one of several kinds and holds none.
  [[noreturn]] void refuse_empty() const;
  /// Refuses what is given against the options of its field (proto/field.proto), here and in all blocks within but a gripper.
  void check_fields() const;

 protected:
  [[noreturn]] void refuse_field(std::string_view name, std::string_view words) const;
  [[nodiscard]] bool has_field(std::string_view name) const;
  void require_field(std::string_view name, std::string_view words) const;
  void check_length(std::string_view name, int length, int wanted) const;

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
  const Message* operator->() const { return &message_; }

  [[nodiscard]] bool has(const auto& field) const {
    static_cast<void>(field.value(message_));  // it must be a field of this block
    return has_field(field.name);
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

  /// Refuses the block without the field, which must be what its options say, or `words`.
  void require(const auto& field, std::string_view words = {}) const {
    static_cast<void>(field.value(message_));
    require_field(field.name, words);
  }
  /// A list is empty or has this length.
  void need_length(const auto& field, int length) const {
    check_length(field.name, field.value(message_).size(), length);
  }
  [[noreturn]] void refuse(const auto& field, std::string_view words) const {
    static_cast<void>(field.value(message_));
    refuse_field(field.name, words);
  }

 private:
  template <class F>
  using ValueOf = std::remove_cvref_t<decltype(std::declval<const F&>().value(std::declval<const Message&>()))>;

  const Message& message_;
};

using List = google::protobuf::RepeatedField<double>;

inline Numbers numbers(const List& list) {
  return {list.begin(), list.end()};
}
template <int N>
Eigen::Matrix<double, N, 1> vector(const List& list) {
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  for (int i = 0; i < N && i < list.size(); ++i) v[i] = list[i];
  return v;
}
/// Of unit length. It must not be zero.
Numbers direction(const List& list);
/// A pose, the attitude made of unit length.
Numbers pose(const List& list);
/// A unit quaternion w x y z; that of no rotation where the list is empty.
Eigen::Quaterniond attitude(const List& list);

}  // namespace twoport
