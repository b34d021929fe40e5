#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/page/channel.h"
#include "common/record/verdict.h"
#include "common/scene/scene.h"

namespace twoport {

/// What the page shows of a run that goes on.
struct PageVerdict {
  enum class Kind : unsigned char {
    passive,      ///< the hand has got no more energy than it has put in and E(0)
    not_passive,  ///< it has
    restless,     ///< VerdictKind of the motion, where nobody has moved anything for a while
    unstable,
  };
  Kind kind = Kind::passive;
  std::string reason;
};
std::string_view to_string(PageVerdict::Kind kind);

/// Judges a run from the page's samples, by the rules of a live run's summary (judge()), as if the run ended now. The energy
/// through the hand's port is judged always, the motion (translations) only while nothing moves the loop from outside.
class PageJudge {
 public:
  /// `rate_hz`: of the samples. `rests`: disturb() reports all that moves the loop; else only the energy is judged.
  PageJudge(const Scene& scene, double rate_hz, bool rests);

  /// The hand has moved, or the loop was changed.
  void disturb() noexcept;
  void add(const PageSample& sample);
  [[nodiscard]] PageVerdict verdict() const;
  /// E(0) of the method in use, and what the hand had got beyond its own under earlier ones, which is not held against it [J].
  [[nodiscard]] double initial_energy_j() const { return initial_j_[epoch_]; }
  [[nodiscard]] double earlier_debt_j() const { return debt_j_; }
  /// The same of hand and robot together. E(0) is negative where the method in use does not bound the robot's port.
  [[nodiscard]] double both_initial_energy_j() const { return both_initial_j_[epoch_]; }
  [[nodiscard]] double both_earlier_debt_j() const { return both_debt_j_; }

 private:
  std::vector<double> initial_j_, both_initial_j_;
  std::vector<bool> controlled_;  ///< does the method have a passivity controller?
  bool coarse_, rests_;
  MotionScale scale_;
  std::optional<TrendRecord> tail_;  ///< since the last disturbance and kSettling
  std::size_t epoch_ = 0;
  double disturbed_s_ = 0.0, t_s_ = 0.0, left_j_ = 0.0, debt_j_ = 0.0, dissipated_j_ = 0.0, both_debt_j_ = 0.0,
         switched_s_ = -HUGE_VAL;
  bool begun_ = false, moved_ = true, acted_ = false;
};

/// E(0) of each configuration of a scene: its first control, then its schedule [J].
std::vector<double> initial_energies_j(const Scene& scene);

}  // namespace twoport
