#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace twoport {

/// Prints to stderr. Where that cannot be written, as on a terminal that has gone, nothing happens: what a program has to say must not
/// end it while it holds hardware.
template <class... Args>
void print_error(fmt::format_string<Args...> format, Args&&... args) {
  const std::string text = fmt::format(format, std::forward<Args>(args)...);
  std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace twoport
