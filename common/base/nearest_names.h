#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace twoport {

/// The names that need the fewest single-character edits to hold what was typed, then to be it; at most `most`.
std::vector<std::string> nearest_names(const std::string& typed, const std::vector<std::string>& names,
                                       std::size_t most);

}  // namespace twoport
