#pragma once

#include <charconv>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace twoport {

/// The whole text as a number; `base`: of an integer, 10 unless given.
template <class Number, class... Base>
std::optional<Number> number_from(std::string_view text, Base... base) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value, base...);
  return error == std::errc{} && stop == end ? std::optional{value} : std::nullopt;
}

/// Without the blanks at both ends.
std::string_view trimmed(std::string_view text);
/// Takes the next line off `rest`: without what follows a #, and without the blanks at both ends.
std::string_view take_line(std::string_view& rest);
/// As a terminal may show it: control characters other than line ends and tabs as a backslash, x and two digits.
std::string printable(std::string_view text);
/// As printable(), in one line: line ends and tabs are blanks.
std::string in_one_line(std::string_view text);
/// As a JSON string, quotes included.
std::string json_string(std::string_view text);

/// The names that need the fewest single-character edits to hold what was typed, then to be it; at most `most`.
std::vector<std::string> nearest_names(const std::string& typed, const std::vector<std::string>& names,
                                       std::size_t most);

}  // namespace twoport
