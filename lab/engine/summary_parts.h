#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
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

/// States of a run in contact, to be judged beside its last one; of those that touch the same set of surfaces the one with the
/// largest ∫|f| dt, f the environment's force: an integral, as a robot that bounces presses now and then.
///
/// - Held: the end of a segment in whose second half something was touched; the integral is over the segment.
/// - Passed: a station of a segment; the integral is from the last quarter of the way to it to that of the way to the next one: the robot
///   comes a delay and a lag later. After the last one it ends in the middle of the next segment.
///
/// `At`: a copy of the run.
template <class At>
class ContactStates {
 public:
  static constexpr std::size_t kMost = 8;  ///< sets of surfaces, of each kind; those that were pressed most

  struct State {
    std::uint64_t surfaces;  ///< bit i: surface i, modulo 64
    double pressed;          ///< ∫|f| dt / T
    double at_s;
    std::optional<At> at;  ///< none: the end of the run
  };

  /// The last quarter of a part begins; `touched`: in the part before it. `pressed`: so far in the run.
  void begin_quarter(const Part& part, std::uint64_t touched, double pressed) {
    before_quarter_ = pressed;
    of_part_ = touched;
    if (!part.ends_at_station || !station_) return;
    station_->surfaces |= touched;
    settle(pressed);
  }
  /// A part ends; `touched`: in its last quarter. copy() is the run at its end.
  template <class Copy>
  void end(const Part& part, std::uint64_t touched, double pressed, bool last, Copy copy) {
    if (station_) {
      station_->surfaces |= of_part_ | touched;
      if (is_left_) settle(pressed);
    }
    if (part.late) of_segment_ |= of_part_ | touched;
    if (part.ends_segment) {
      keep(held_, {of_segment_, pressed - before_segment_, part.until_s, {}},
           [&] { return last ? std::optional<At>{} : std::optional<At>{copy()}; });
      before_segment_ = pressed;
      of_segment_ = 0;
      is_left_ = true;
    } else if (part.ends_at_station) {
      station_ = State{touched, before_quarter_, part.until_s, copy()};
      is_left_ = false;
    }
    if (last && station_) settle(pressed);
  }
  /// Is there a station around which something may yet be touched?
  [[nodiscard]] bool waits() const { return station_.has_value(); }
  /// Those to be judged beside the end of the run.
  [[nodiscard]] std::vector<const State*> all() const {
    std::vector<const State*> states;
    for (const auto* kind : {&held_, &passed_})
      for (const State& s : *kind)
        if (s.at) states.push_back(&s);
    return states;
  }

 private:
  /// What was touched since the last quarter before the last station is known.
  void settle(double pressed) {
    keep(passed_, {station_->surfaces, pressed - station_->pressed, station_->at_s, {}},
         [&] { return std::move(station_->at); });
    station_.reset();
  }
  template <class Copy>
  static void keep(std::vector<State>& states, State state, Copy copy) {
    if (state.surfaces == 0 || !(state.pressed > 0.0)) return;
    auto same =
        std::find_if(states.begin(), states.end(), [&](const State& s) { return s.surfaces == state.surfaces; });
    if (same == states.end() && states.size() < kMost) {
      same = states.insert(same, State{0, 0.0, 0.0, {}});
    } else if (same == states.end()) {
      same = std::min_element(states.begin(), states.end(),
                              [](const State& a, const State& b) { return a.pressed < b.pressed; });
    }
    if (state.pressed <= same->pressed) return;
    state.at = copy();
    *same = std::move(state);
  }

  double before_quarter_ = 0.0,
         before_segment_ = 0.0;                 ///< pressed before the last quarter of the part, and the segment
  std::uint64_t of_part_ = 0, of_segment_ = 0;  ///< before the last quarter of the part; all that is late
  std::optional<State> station_;  ///< the last one, until it is known what was touched; `pressed` is what was before it
  bool is_left_ = false;          ///< its segment has ended
  std::vector<State> held_, passed_;
};

}  // namespace twoport::lab
