#include "common/page/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "common/coupling/claim.h"
#include "common/method/catalogue.h"
#include "common/record/run_judge.h"

namespace twoport {
namespace {

constexpr double kSettling = 0.5;   // of the loop, after what has moved it [s]
constexpr double kShortest = 1.5;   // of a tail [s]
constexpr double kLongest = 20.0;   // older motion says little of the present [s]
constexpr double kRounding = 1e-6;  // [J]

double length(const PageSample::Vector& v) {
  return std::hypot(v[0], v[1], v[2]);
}
std::string joules(double j) {
  return j >= 1.0 ? fmt::format("{:.2f} J", j) : fmt::format("{:.3g} mJ", 1e3 * j);
}

}  // namespace

std::string_view to_string(PageVerdict::Kind kind) {
  constexpr std::string_view kNames[] = {"passive", "not passive", "restless", "unstable"};
  return kNames[static_cast<std::size_t>(kind)];
}

std::vector<double> initial_energies_j(const Scene& scene) {
  std::vector<double> all{scene.control.initial_energy.si()};
  for (const ScheduledControl& entry : scene.schedule) all.push_back(entry.control.initial_energy.si());
  return all;
}

PageJudge::PageJudge(const Scene& scene, double rate_hz, bool rests)
    : initial_j_{initial_energies_j(scene)}, coarse_{is_coarse(scene)}, rests_{rests} {
  const auto add = [this](const ControlOptions& o) {
    controlled_.push_back(keeps_account(o, {}));
    const double grants = o.architecture == Architecture::render ? 0.0 : stated_claim(o).grants();
    both_initial_j_.push_back(grants > 0.0 ? grants * o.initial_energy.si() : -1.0);
  };
  add(scene.control);
  for (const ScheduledControl& entry : scene.schedule) add(entry.control);
  scale_.dof = 3;
  scale_.rate_hz = rate_hz;
  scale_.speed.assign(6, 0.0);
  scale_.early.assign(6, 0.0);
}

void PageJudge::disturb() noexcept {
  disturbed_s_ = t_s_;
  moved_ = true;
}

void PageJudge::add(const PageSample& s) {
  t_s_ = s.t_s;
  const auto epoch = static_cast<std::size_t>(s.epoch) % initial_j_.size();
  if (epoch != epoch_) debt_j_ = std::max(0.0, -s.hand_energy_j), switched_s_ = t_s_;
  // The robot's side follows a round trip later.
  if (t_s_ <= switched_s_ + kSettling + 1e-3 * s.round_trip_ms)
    both_debt_j_ = std::max(0.0, -s.hand_energy_j - s.robot_port_j);
  if (epoch != epoch_ || !begun_) disturb();
  epoch_ = epoch;
  begun_ = true;
  const double energy_j = s.hand_energy_j + debt_j_;
  left_j_ = initial_j_[epoch_] + energy_j;
  std::array<double, 6> v{};
  std::copy(s.hand_v_m_per_s.begin(), s.hand_v_m_per_s.end(), v.begin());
  std::copy(s.robot_v_m_per_s.begin(), s.robot_v_m_per_s.end(), v.begin() + 3);
  for (std::size_t i = 0; i < v.size(); ++i) scale_.speed[i] = std::max(scale_.speed[i], std::abs(v[i]));
  scale_.reach_m = std::max({scale_.reach_m, length(s.hand_x_m), length(s.robot_x_m)});
  // Where the sides are not coupled, no loop is closed.
  if (s.mode != static_cast<double>(Mode::coupled) || s.slave_mode != s.mode) disturb();
  const bool acts = s.dissipated_j > std::exchange(dissipated_j_, s.dissipated_j);
  if (!rests_ || t_s_ < disturbed_s_ + kSettling) return;
  if (std::exchange(moved_, false) || t_s_ > disturbed_s_ + kLongest) {
    tail_.emplace(6, 2);
    acted_ = false;
    if (t_s_ > disturbed_s_ + kLongest) disturbed_s_ = t_s_ - kSettling;
  }
  acted_ = acted_ || acts;
  const double wanted = length(s.unlimited_n);
  tail_->add(v, std::array{energy_j, energy_j},
             {.touching = length(s.environment_n) > 0.0, .limited = !acts && length(s.felt_n) < wanted * (1.0 - 1e-9)});
}

PageVerdict PageJudge::verdict() const {
  using enum PageVerdict::Kind;
  PageVerdict out;
  if (tail_ && !moved_ && tail_->enough() && static_cast<double>(tail_->ticks()) > kShortest * scale_.rate_hz) {
    const double tail_s = static_cast<double>(tail_->ticks()) / scale_.rate_hz;
    const Verdict v = judge({.record = *tail_,
                             .has_controller = controlled_[epoch_],
                             .controller_acted = acted_ || controlled_[epoch_],
                             .driven = true,
                             .coarse = coarse_,
                             .initial_energy_j = initial_j_[epoch_],
                             .run_lengths = tail_s / std::max(t_s_, tail_s),
                             .last = true},
                            scale_);
    if (v.kind == VerdictKind::unstable) return {unstable, v.text};
    if (v.kind == VerdictKind::restless) out = {restless, v.text};
    if (v.kind == VerdictKind::stable) out.reason = v.text;
  }
  if (left_j_ < -kRounding)
    return {not_passive, fmt::format("the hand has got {} more than it has put in and E(0)", joules(-left_j_))};
  if (out.reason.empty())
    out.reason = rests_ ? "the hand has got no more energy than it has put in and E(0); the motion is judged when hand "
                          "and sliders have rested for two seconds"
                        : "the hand has got no more energy than it has put in and E(0); the motion is not judged, as "
                          "nobody knows when this hand rests";
  return out;
}

}  // namespace twoport
