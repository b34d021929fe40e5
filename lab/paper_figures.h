#pragma once

#include <functional>
#include <string>
#include <vector>

#include "lab/plot/picture.h"

namespace twoport::lab {

/// A picture of the paper from simulated data.
struct PaperFigure {
  std::string name, title;
  std::function<Picture()> make;
};
std::vector<PaperFigure> paper_figures();

}  // namespace twoport::lab
