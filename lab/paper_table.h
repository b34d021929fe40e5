#pragma once

#include <string>
#include <vector>

#include "lab/paper.h"

namespace twoport::lab {

/// Figures of an independent simulation of the same experiments with other seeds; NaN: not reported. Light hand, gain
/// limit 10 N s/m.
struct PaperReported {
  double min_energy_j, direction_rms_deg, direction_max_deg, tip_rms_n, tip_max_n, correction_max_n, pulling_share;
};
PaperReported paper_reported(const PaperCase& which);

struct PaperResult {
  PaperCase which;
  PaperNumbers numbers;
};
struct PaperTable {
  std::vector<PaperResult> results;
  std::vector<AdmittanceRun> admittance;
  std::vector<FrameCheck> frames;

  [[nodiscard]] const PaperNumbers& at(const std::string& experiment, const std::string& hand,
                                       const std::string& sensor, const std::string& method) const;
};

/// A line for each case, everything in SI units, with the overrides that make the scene.
std::string paper_csv(const PaperTable& table);
/// The same as a readable text, with the claims of the paper.
std::string paper_text(const PaperTable& table);

}  // namespace twoport::lab
