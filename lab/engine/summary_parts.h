#pragma once

#include <vector>

#include "common/coupling/registration.h"
#include "common/method/catalogue.h"
#include "common/record/metrics.h"
#include "common/record/summary.h"
#include "common/record/verdict.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"

// Parts of the summary of a run, shared by the laboratory's simulations (lab/run.cc) and the lanes (lab/lanes/).

namespace twoport::lab {

/// A piece of a segment of the hand's path.
struct Part {
  double from_s = 0.0, until_s = 0.0;
  bool late = false;             ///< in the second half of its segment
  bool ends_segment = false;     ///< its end is that of the segment
  bool ends_at_station = false;  ///< its end is a station within the segment
  /// Where its last quarter begins.
  [[nodiscard]] double quarter_s() const { return 0.25 * from_s + 0.75 * until_s; }
  /// From where on what is touched is looked at.
  [[nodiscard]] double looks_from_s() const { return late ? from_s : quarter_s(); }
};

/// The segments of a path and what follows it, up to the run's end, each cut in the middle and at stations, of which at most 16 are
/// taken.
std::vector<Part> parts(const std::vector<sim::SegmentTimes>& segments, double end_s);

/// Takes the verdict of a state held in contact at `at_s` in place of `worst` if it is worse.
void keep_worse(Verdict& worst, const Verdict& held, double at_s);

/// Packets, limits, switches and clock.
void fill_link(Summary& s, const LinkUse& use, const Scene& scene);

/// The metrics of a run of `scene`; `link`: over a link. `trends`: the verdict comes from the run itself.
template <int N>
Metrics<N> metrics_of(const Scene& scene, bool link, double quiet_from_s, double initial_energy_j, bool trends) {
  const bool alone = scene.control.architecture == Architecture::uncontrolled;
  return Metrics<N>{{.rate_hz = alone ? scene.slave_rate_hz : scene.master_rate_hz,
                     .duration_s = scene.duration_s,
                     .quiet_from_s = quiet_from_s,
                     .initial_energy_j = initial_energy_j,
                     .controller = has_controller(scene),
                     .coarse = is_coarse(scene),
                     .link = link,
                     .noise = trends && link ? noise_motion(scene) : NoiseMotion{},  // a tail has none
                     .trends = trends},
                    Registration<N>{scene.control}.to_master(Energy{1.0}).si(),
                    {.hand = !alone,
                     .link = link,
                     .robot = link || alone,
                     .account = keeps_account(scene.control, scene.schedule),
                     .robot_energy = link,
                     .rests = rests(scene)},
                    ToolView<N>{scene}};
}

}  // namespace twoport::lab
