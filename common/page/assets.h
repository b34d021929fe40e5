#pragma once

#include <string_view>

namespace twoport {

/// The page: one HTML file, held in the program.
std::string_view page_html();

}  // namespace twoport
