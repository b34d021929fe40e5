#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/base/text.h"

namespace twoport {

/// What print_error() prints of an argument.
template <class T>
decltype(auto) shown(const T& argument) {
  if constexpr (std::is_convertible_v<const T&, std::string_view>) {
    return printable(argument);
  } else {
    return (argument);
  }
}

/// Prints to stderr; of texts among the arguments what is printable(), whatever file or peer they are from. Where stderr cannot be
/// written, as on a terminal that has gone, nothing happens: what a program has to say must not end it while it holds hardware.
template <class... Args>
void print_error(fmt::format_string<const Args&...> format, const Args&... args) {
  const auto text_of = [&format](const auto&... shown_args) {
    return fmt::vformat(fmt::string_view{format}, fmt::make_format_args(shown_args...));
  };
  const std::string text = text_of(shown(args)...);
  std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace twoport
