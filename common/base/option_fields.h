#pragma once

#include <optional>

namespace twoport {

/// Sets an option from a field of its block: an optional one where it is `given`, another one from the value or the schema's default.
template <class T>
void set_option(std::optional<T>& option, bool given, const auto& value) {
  if (given) option = value;
}
template <class T>
void set_option(T& option, bool, const auto& value) {
  option = static_cast<T>(value);
}

// In a struct of options: the names of its members that are fields of its block in the schema, and read(block), which sets them. A field
// that the block lacks does not compile.
#define TWOPORT_OPTIONS_OF_BLOCK(...)                   \
  static constexpr const char* kOfBlock = #__VA_ARGS__; \
  void read(const auto& block) {                        \
    TWOPORT_AGAIN_3(TWOPORT_READ_OPTIONS(__VA_ARGS__))  \
  }
#define TWOPORT_READ_OPTIONS(NAME, ...)                          \
  ::twoport::set_option(NAME, block.has_##NAME(), block.NAME()); \
  __VA_OPT__(TWOPORT_READ_MORE TWOPORT_PARENTHESES(__VA_ARGS__))
#define TWOPORT_READ_MORE() TWOPORT_READ_OPTIONS
#define TWOPORT_PARENTHESES ()
// Each scan reads one option more: up to 40.
#define TWOPORT_AGAIN_3(...) TWOPORT_AGAIN_2(TWOPORT_AGAIN_2(TWOPORT_AGAIN_2(__VA_ARGS__)))
#define TWOPORT_AGAIN_2(...) TWOPORT_AGAIN_1(TWOPORT_AGAIN_1(TWOPORT_AGAIN_1(__VA_ARGS__)))
#define TWOPORT_AGAIN_1(...) TWOPORT_AGAIN_0(TWOPORT_AGAIN_0(TWOPORT_AGAIN_0(__VA_ARGS__)))
#define TWOPORT_AGAIN_0(...) __VA_ARGS__

}  // namespace twoport
