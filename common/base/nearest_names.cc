#include "common/base/nearest_names.h"

#include <algorithm>
#include <utility>

namespace twoport {
namespace {

/// Single-character edits that make `typed` the closest part of `name`, and those that make it all of `name`.
std::pair<std::size_t, std::size_t> edit_distance(const std::string& typed, const std::string& name) {
  const auto last_row = [&](std::size_t skipped) {
    std::vector<std::size_t> row(name.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = skipped * j;
    for (std::size_t i = 0; i < typed.size(); ++i) {
      std::size_t diagonal = std::exchange(row[0], i + 1);
      for (std::size_t j = 0; j < name.size(); ++j) {
        const std::size_t replaced = diagonal + (typed[i] == name[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, replaced});
      }
    }
    return row;
  };
  const std::vector<std::size_t> part = last_row(0);
  return {*std::min_element(part.begin(), part.end()), last_row(1).back()};
}

}  // namespace

std::vector<std::string> nearest_names(const std::string& typed, const std::vector<std::string>& names,
                                       std::size_t most) {
  std::vector<std::pair<std::pair<std::size_t, std::size_t>, std::string>> nearest;
  for (const std::string& name : names) nearest.emplace_back(edit_distance(typed, name), name);
  std::sort(nearest.begin(), nearest.end());
  nearest.erase(std::unique(nearest.begin(), nearest.end()), nearest.end());
  std::vector<std::string> all;
  for (std::size_t i = 0; i < std::min(most, nearest.size()); ++i) all.push_back(nearest[i].second);
  return all;
}

}  // namespace twoport
