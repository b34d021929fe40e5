#include "common/record/run_judge.h"

#include <fmt/format.h>

#include "common/base/built_for.h"

namespace twoport {

bool is_coarse(const Scene& scene) {
  if (scene.device && (scene.device->coulomb_friction_n > 0.0 || scene.device->position_resolution_m > 0.0))
    return true;
  const World world{scene.environment};
  return std::any_of(world.surfaces.begin(), world.surfaces.end(),
                     [](const Surface& s) { return s.material.friction > 0.0; });
}
bool has_controller(const Scene& scene) {
  const ControlOptions& c = scene.control;
  return c.method_name.empty() ? c.controller.method != Method::none : c.method_name != "NONE";
}

template <int N>
MotionScale RunJudge<N>::scale() const {
  const std::span<const double> speed{sums_.speed}, early = early_ ? speed : std::span<const double>{early_speed_};
  return {.dof = N,
          .rate_hz = known_.rate_hz,
          .reach_m = std::sqrt(sums_.reach2),
          .speed = {speed.begin(), speed.end()},
          .early = {early.begin(), early.end()}};
}

template <int N>
std::string RunJudge<N>::not_judged() const {
  if (rows_ == 0) return "undecided: nothing was run";
  if (known_.link && sums_.was_coupled == 0.0) return "undecided: the two sides never met";
  if (std::all_of(std::begin(sums_.speed), std::end(sums_.speed), [](double v) { return v == 0.0; }))
    return "undecided: nothing moved; something must set the loop in motion";
  return {};
}

template <int N>
Verdict RunJudge<N>::verdict() const {
  if (diverged_) return {VerdictKind::unstable, fmt::format("diverged at {:.4g} s", diverged_at_s_)};
  if (const std::string why = not_judged(); !why.empty()) return {VerdictKind::undecided, why};
  if (!after_) return {};
  if (!after_->enough()) {
    const double paid = -(known_.initial_energy_j + energy_j_);
    return {VerdictKind::undecided,
            "undecided: " + (paid > 0.0 ? fmt::format("the hand has been paid {:.4g} J, but ", paid) : std::string{}) +
                "the hand moves to the end; a rest at the end of the run would decide it"};
  }
  const double after_s = static_cast<double>(after_->ticks()) / known_.rate_hz;
  return judge({.record = *after_,
                .has_controller = known_.controller,
                .controller_acted = acted_after_ || (known_.controller && known_.unseen),
                .driven = true,
                .coarse = known_.coarse,
                .initial_energy_j = known_.initial_energy_j,
                .run_lengths = after_s * known_.rate_hz / static_cast<double>(rows_),
                .last = true},
               scale());
}

TWOPORT_COMPILE(RunJudge);

}  // namespace twoport
