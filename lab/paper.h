#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "common/record/row.h"
#include "common/scene/scene.h"
#include "lab/plot/picture.h"

namespace twoport::lab {

/// The experiments of "Time Domain Passivity Control for 6 Degrees of Freedom Haptic Displays" (Preusche, Hirzinger,
/// Ryu, Hannaford), in virtual time: a light hand on a PHANToM-like device against a wall of 5000 N/m at 2 kHz.

/// One row of the table: a scene of scenes/paper/, what is changed in it, and under which names it stands.
struct PaperCase {
  std::string experiment;  ///< point, slide, curved, friction: the scene; with what else is done to it
  std::string hand;        ///< light, medium, firm
  std::string sensor;      ///< ideal, encoder
  std::string method;
  std::vector<std::string> set;  ///< overrides, as --set takes them
};

/// Root mean square and largest of a series, over any number of runs.
struct RmsAndLargest {
  double sum2 = 0.0, max = 0.0;
  std::uint64_t count = 0;
  void add(double x) noexcept {
    sum2 += x * x;
    max = std::max(max, std::abs(x));
    ++count;
  }
  void add(const RmsAndLargest& s) noexcept {
    sum2 += s.sum2;
    max = std::max(max, s.max);
    count += s.count;
  }
  [[nodiscard]] double rms() const noexcept { return count > 0 ? std::sqrt(sum2 / static_cast<double>(count)) : 0.0; }
};

/// Results of a case over all its seeds. Energies are those of the true port: held f times true displacement. Energies,
/// the largest correction and the largest gain count from the start, all else from 0.3 s, when the hand is in contact.
struct PaperNumbers {
  static constexpr double kFrom_s = 0.3;
  static constexpr double kFelt = 0.1;  ///< below it the direction is not evaluated [N]

  double min_energy_j = 0.0;              ///< minimum over time, E(0) = 0: worst over the seeds
  double min_surplus_j = 0.0;             ///< the same of its excess over the energy of an ideal spring
  double min_normal_energy_j = 0.0;       ///< the same of the part along the true normal of the wall
  std::array<double, 3> axis_energy_j{};  ///< at the end, mean of the seeds
  double energy_j = 0.0;                  ///< their sum
  std::array<double, 3> axis_energy_at_1s_j{};
  RmsAndLargest direction_deg;         ///< between felt and rendered force, both > kFelt
  RmsAndLargest normal_direction_deg;  ///< between felt force and true normal, force > kFelt
  RmsAndLargest tip_n;                 ///< of the felt force across the rendered force
  double mean_correction_n = 0.0;      ///< of |f_PC| in contact
  double max_correction_n = 0.0;
  double max_gain_n_s_per_m = 0.0;  ///< α = |f_PC|²/(f_PC·v) of the true velocity, above 1 µN, without saturation
  RmsAndLargest speed_m_per_s;
  double max_depth_m = 0.0;
  std::uint64_t ticks = 0, contact_ticks = 0;
  std::uint64_t pulling_ticks = 0;    ///< in contact, felt force opposite to the rendered one
  std::uint64_t saturated_ticks = 0;  ///< in contact, at the device's limit
  std::uint64_t free_air_ticks = 0;   ///< a correction without contact
  int seeds = 0;

  void add(const PaperNumbers& other);
};

/// Accumulates the numbers of one run, row by row.
class PaperMeter {
 public:
  explicit PaperMeter(const Scene& scene);
  void add(const Row<3>& row);
  [[nodiscard]] const PaperNumbers& numbers() const { return numbers_; }
  /// Energy through the port so far, by axis of the world.
  [[nodiscard]] const Eigen::Vector3d& axis_energy_j() const { return axis_energy_; }
  [[nodiscard]] double normal_energy_j() const { return normal_energy_; }

 private:
  Surface surface_;
  double limit_n_;
  PaperNumbers numbers_;
  Eigen::Vector3d x_ = Eigen::Vector3d::Zero(), f_ = x_, normal_ = x_, axis_energy_ = x_;
  double normal_energy_ = 0.0, sum_correction_ = 0.0;
  bool started_ = false;
};

/// The scene of a case, from the text of scenes/paper/NAME.textproto as the program was built with it.
Scene paper_scene(const PaperCase& which, std::uint64_t seed);
/// By the names of its parts; ConfigError if there is no such case.
PaperCase paper_case(const std::string& experiment, const std::string& hand, const std::string& sensor,
                     const std::string& method);
/// All results of the table.
std::vector<PaperCase> paper_cases();

constexpr int kPaperSeeds = 5;
PaperNumbers measure(const PaperCase& which, int seeds = kPaperSeeds);
std::vector<Row<3>> record(const PaperCase& which, std::uint64_t seed);

/// Both causalities of the paper's Fig. 2. The impedance is the wall. The admittance is its dual: a virtual mass whose
/// sampled velocity is held for a tick generates |Δp|²/(2m) per tick, as the sampled spring K|Δx|²/2.
struct AdmittanceRun {
  std::string method;
  double min_energy_j = 0.0;  ///< of the held velocity and the true force
  double most_speed_m_per_s = 0.0;
  double stopped_at_s = 0.0;    ///< when the speed passed 5 m/s; 0: never
  RmsAndLargest direction_deg;  ///< of the velocity against that of the virtual mass
  RmsAndLargest correction_m_per_s;
};
std::vector<AdmittanceRun> admittance_runs();

/// "The calculation of the energy flow is independent of the choice of the coordinate system [...] The coordinate
/// system can even be changed in each step".
struct FrameCheck {
  std::string method;
  double energy_per_tick_frames = 0.0;  ///< observer and controller in a new frame each tick: energy, relative
  double force_per_tick_frames = 0.0;   ///< and force, of the largest
  double energy_turned_world = 0.0;     ///< the whole scene turned: energy over the run [J]
  double path_turned_world_m = 0.0;     ///< and path, turned back
};
std::vector<FrameCheck> frame_checks();

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

/// A picture of the paper from simulated data.
struct PaperFigure {
  std::string name, title;
  std::function<Picture()> make;
};
std::vector<PaperFigure> paper_figures();

}  // namespace twoport::lab
