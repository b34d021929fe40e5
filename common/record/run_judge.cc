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
NoiseMotion noise_motion(const Scene& s) {
  if (!s.robot || !s.robot->force_sensor || !s.device || !s.operator_model) return {};
  const HandSpec hand = s.operator_model->hand.value_or(HandSpec{});
  const double sigma = s.control.force_scale * s.robot->force_sensor->noise_n;
  const auto motion = [&](double mass, double damping) {
    return mass > 0.0 && damping > 0.0 ? sigma * std::sqrt(1.0 / (2.0 * s.slave_rate_hz * damping * mass)) : 0.0;
  };
  return {.translation = motion(s.device->mass_kg + hand.mass_kg, s.device->damping_n_s_per_m + hand.damping_n_s_per_m),
          .rotation = motion(s.device->inertia_kg_m2 + hand.inertia_kg_m2,
                             s.device->rotational_damping_n_m_s_per_rad + hand.rotational_damping_n_m_s_per_rad)};
}
bool has_controller(const Scene& scene) {
  const ControlOptions& c = scene.control;
  return c.method_name.empty() ? c.controller.method != Method::none : !is_plain(c);
}

template <int N>
MotionScale RunJudge<N>::scale() const {
  const std::span<const double> speed{sums_.speed}, early = early_ ? speed : std::span<const double>{early_speed_};
  return {.dof = N,
          .rate_hz = known_.rate_hz,
          .source = !known_.link      ? EnergySource::rendering
                    : known_.of_slave ? EnergySource::network
                                      : EnergySource::unknown,
          .reach_m = std::sqrt(sums_.reach2),
          .speed = {speed.begin(), speed.end()},
          .early = {early.begin(), early.end()},
          .noise = known_.noise};
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
bool RunJudge<N>::coupled_at_end() const {
  if (!known_.link || sums_.apart_at_end == 0.0) return true;
  const auto rows = static_cast<double>(rows_);
  const double rest = rows - known_.quiet_from_s * known_.rate_hz;
  return !failed_at_s_ && sums_.apart_at_end <= 0.05 * (rest > 0.0 ? rest : rows);
}

template <int N>
std::string RunJudge<N>::why_not_coupled() const {
  if (failed_at_s_)
    return fmt::format("undecided: a plug-in or a reading failed at {:.2f} s, after which there was no force",
                       *failed_at_s_);
  return fmt::format("undecided: the two sides were not coupled in the last {:.2f} s, which are not judged",
                     sums_.apart_at_end / known_.rate_hz);
}

template <int N>
Verdict RunJudge<N>::at_robot() const {
  const Tail tail{.record = *after_};
  if (after_->enough() && is_driven_by_coupling(tail, scale(), known_.motion_scale))
    return {VerdictKind::unstable, "the robot moves more than the hand, driven by its own coupling"};
  return {VerdictKind::undecided, "undecided: bounded at the slave; the master judges stability"};
}

template <int N>
Verdict RunJudge<N>::verdict() const {
  if (diverged_) return {VerdictKind::unstable, fmt::format("diverged at {:.4g} s", diverged_at_s_)};
  if (const std::string why = not_judged(); !why.empty()) return {VerdictKind::undecided, why};
  if (!after_) return {};
  if (!known_.at_robot && !coupled_at_end()) return {VerdictKind::undecided, why_not_coupled()};
  if (known_.at_robot) return at_robot();
  if (!after_->enough()) {
    const double paid = -(known_.initial_energy_j + energy_j_);
    return {VerdictKind::undecided,
            "undecided: " + (paid > 0.0 ? fmt::format("the hand has been paid {:.4g} J, but ", paid) : std::string{}) +
                (std::isnan(known_.quiet_from_s)
                     ? "when the hand rests is not known"
                     : "the hand moves to the end; a rest at the end of the run would decide it")};
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
