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

/// Times of the ends of the parts of a run [s]: the ends of the path's segments, or sixteenths of the run where no segment
/// ends before it. Without a path one part: the hand changes nothing between a part's end and the scene's.
std::vector<double> parts(std::vector<double> segment_ends_s, double end_s);

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
                     .trends = trends},
                    Registration<N>{scene.control}.to_master(Energy{1.0}).si(),
                    {.hand = !alone,
                     .link = link,
                     .robot = link || alone,
                     .account = keeps_account(scene.control, scene.schedule),
                     .robot_energy = link,
                     .rests = rests(scene)}};
}

}  // namespace twoport::lab
