#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/record/summary.h"

namespace twoport {

/// Every number of the schema as (name, value), in its order; no value where it is not known.
inline std::vector<std::pair<std::string, std::optional<double>>> known_numbers(const schema::Summary& summary) {
  std::vector<std::pair<std::string, std::optional<double>>> all;
  for (const Figure& figure : Figure::all()) all.emplace_back(figure.name(), figure.known_of(summary));
  return all;
}

}  // namespace twoport
