#pragma once

#include <functional>
#include <string>
#include <vector>

namespace twoport::lab {

/// A picture of the paper from simulated data: NAME.dat, NAME.gp and, where gnuplot is installed, NAME.png and
/// NAME.svg.
struct PaperFigure {
  std::string name, title;
  std::function<void(const std::string& folder)> write;  ///< NAME.dat and NAME.gp
};
std::vector<PaperFigure> paper_figures();

}  // namespace twoport::lab
