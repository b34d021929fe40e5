#pragma once

#include <string>
#include <string_view>

namespace twoport {

/// Without the blanks at both ends.
std::string_view trimmed(std::string_view text);
/// Takes the next line off `rest`: without what follows a #, and without the blanks at both ends.
std::string_view take_line(std::string_view& rest);
/// As a terminal may show it: control characters other than line ends and tabs as \xNN.
std::string printable(std::string_view text);
/// As a JSON string, quotes included.
std::string json_string(std::string_view text);

}  // namespace twoport
