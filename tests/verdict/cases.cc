#include "tests/verdict/cases.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "tests/theory/oracle.h"

// Truth is an eigenvalue, or passivity. A sampled spring or a link loop is tuned until its spectral radius ρ per tick gives
// the rate σ = ln ρ / T that has been drawn; a loop of passive parts alone is bounded.
namespace twoport::test {

double Draw::about(double low, double high) {
  return low * std::pow(high / low, between(0.0, 1.0));
}

namespace {

using lab::BilateralLoop;
using lab::SampledWall;

/// x in [low, high] with rate(x) = target, by bisection; the nearest end where the target is outside. rate(low) < rate(high).
template <class Rate>
double solve(Rate rate, double target, double low, double high) {
  for (int i = 0; i < 200 && high - low > 1e-15 * std::abs(high); ++i) {
    const double mid = 0.5 * (low + high);
    (rate(mid) < target ? low : high) = mid;
  }
  return 0.5 * (low + high);
}

double rate(const SampledWall& wall) {
  return std::log(spectral_radius(wall)) / wall.period_s;
}
double rate(const BilateralLoop& loop) {
  return std::log(spectral_radius(loop)) / loop.period_s;
}

/// A rate of either sign, with a magnitude in [low, high] 1/s.
double signed_rate(Draw& draw, double low, double high) {
  return draw.coin() ? draw.about(low, high) : -draw.about(low, high);
}

// ---- a mass on a sampled spring or wall

/// Stiffness and all else of a wall whose loop grows with `target`, or as near as it gets.
SampledWall tuned(SampledWall wall, double target) {
  const double critical = critical_stiffness(wall);
  const auto at = [&](double k) {
    SampledWall each = wall;
    each.stiffness_n_per_m = k;
    return rate(each);
  };
  wall.stiffness_n_per_m =
      target > 0.0 ? solve(at, target, critical, 3.0 * critical) : solve(at, target, 0.3 * critical, critical);
  return wall;
}

SampledWall drawn_wall(Draw& draw) {
  const double rate_hz = 500.0 * (1 << draw.one_of(0, 2));
  SampledWall wall{
      .mass_kg = draw.about(0.03, 2.0), .damping_n_s_per_m = draw.about(0.1, 8.0), .period_s = 1.0 / rate_hz};
  if (draw.coin()) wall.wall_damping_n_s_per_m = draw.about(1e-3, 0.3) * wall.mass_kg * rate_hz;
  wall.true_velocity = draw.coin();
  return wall;
}

/// The text of a rendered wall or spring on a device, the mass split between hand and device. `more` may add to the scene.
struct Rendered {
  SampledWall wall;
  int dof = 1;
  double duration_s = 6.0;
  double hand_mass_kg = 0.0, hand_damping_n_s_per_m = 0.0;
  std::string of_operator{}, of_device{}, environment{}, passivity = "method: NONE", scene{};
  bool hand = false;

  [[nodiscard]] std::string text() const {
    std::string s = fmt::format("dof: {} duration_s: {} rate_hz: {} {}\n", dof, duration_s, 1.0 / wall.period_s, scene);
    if (hand)
      s += fmt::format("operator {{ hand {{ mass_kg: {} damping_n_s_per_m: {} stiffness_n_per_m: {} }} {} }}\n",
                       hand_mass_kg, hand_damping_n_s_per_m, wall.hand_stiffness_n_per_m, of_operator);
    s += fmt::format("device {{ mass_kg: {} damping_n_s_per_m: {} velocity_estimate: {} {} }}\n",
                     wall.mass_kg - hand_mass_kg, wall.damping_n_s_per_m - hand_damping_n_s_per_m,
                     wall.true_velocity ? "TRUE_VELOCITY" : "BACKWARD_DIFFERENCE", of_device);
    return s + fmt::format("control {{ architecture: RENDER passivity {{ {} }} }}\nenvironment {{ {} }}\n", passivity,
                           environment);
  }
  [[nodiscard]] std::string spring() const {
    return fmt::format("spring {{ stiffness_n_per_m: {:.17g} damping_n_s_per_m: {:.17g} anchor_m: {} }}",
                       wall.stiffness_n_per_m, wall.wall_damping_n_s_per_m, dof == 1 ? "[0]" : "[0, 0, 0]");
  }
  /// Where x < 0.
  [[nodiscard]] std::string half_space() const {
    return fmt::format("wall {{ normal: {} stiffness_n_per_m: {:.17g} damping_n_s_per_m: {:.17g} }}",
                       dof == 1 ? "[1]" : "[1, 0, 0]", wall.stiffness_n_per_m, wall.wall_damping_n_s_per_m);
  }
};

std::string words(const SampledWall& w) {
  return fmt::format("sigma {:.3g} 1/s; m {:.3g} b {:.3g} k_h {:.3g} K {:.4g} B {:.3g} T {} {}", rate(w), w.mass_kg,
                     w.damping_n_s_per_m, w.hand_stiffness_n_per_m, w.stiffness_n_per_m, w.wall_damping_n_s_per_m,
                     w.period_s, w.true_velocity ? "true velocity" : "difference");
}

Case of(const Rendered& r, const std::string& more = {}) {
  return {r.text(), rate(r.wall) < 0.0, fmt::format("{}; {:.3g} s{}", words(r.wall), r.duration_s, more), rate(r.wall)};
}

Case held(Draw& draw, double low, double high, double shortest_s, double longest_s) {
  Rendered r{.wall = tuned(drawn_wall(draw), signed_rate(draw, low, high)),
             .duration_s = draw.between(shortest_s, longest_s),
             .of_device = "position_m: [0.001]"};
  r.environment = r.spring();
  return of(r);
}

Case oscillator(Draw& draw) {
  return held(draw, 0.01, 20.0, 1.0, 8.0);
}
/// A thousandth a second, up or down.
Case slow(Draw& draw) {
  return held(draw, 1e-3, 3e-3, 4.0, 20.0);
}

/// So slow that the amplitude changes by a thousandth to a hundred thousandth within the scene.
Case marginal(Draw& draw) {
  const double duration = draw.between(0.5, 8.0);
  return held(draw, 1e-5 / duration, 1e-3 / duration, duration, duration);
}

/// With a hand that holds the handle.
Rendered in_hand(Draw& draw, double low, double high) {
  Rendered r{.wall = drawn_wall(draw), .duration_s = draw.between(3.0, 10.0), .hand = true};
  r.wall.hand_stiffness_n_per_m = draw.about(50.0, 600.0);
  r.hand_mass_kg = draw.between(0.1, 0.6) * r.wall.mass_kg;
  r.hand_damping_n_s_per_m = draw.between(0.1, 0.9) * r.wall.damping_n_s_per_m;
  r.wall = tuned(r.wall, signed_rate(draw, low, high));
  r.of_device = "position_m: [0.001]";
  r.environment = r.spring();
  return r;
}

Case tremor(Draw& draw) {
  Rendered r = in_hand(draw, 0.05, 20.0);
  const double rms = draw.about(1e-6, 3e-4);
  r.of_operator = fmt::format("tremor {{ rms_m: {} }}", rms);
  r.scene = fmt::format("seed: {}", draw.one_of(1, 1000));
  return of(r, fmt::format(", tremor {:.2g} m", rms));
}

/// The path goes on to the end, and would beyond.
Case endless_path(Draw& draw) {
  Rendered r = in_hand(draw, 0.05, 20.0);
  if (draw.coin()) {
    r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: {} }} }}", draw.about(1e-3, 0.05),
                                r.duration_s * draw.between(1.0, 3.0));
  } else {
    r.of_operator = fmt::format("path {{ sine {{ amplitude_m: {} frequency_hz: {} duration_s: {} }} }}",
                                draw.about(1e-4, 0.02), draw.about(0.1, 3.0), 2.0 * r.duration_s);
  }
  return of(r, ", path goes on");
}
Case forced_sine(Draw& draw) {
  Rendered r = in_hand(draw, 0.05, 10.0);
  const double hz = draw.about(3.0, 60.0);
  r.of_operator = fmt::format("path {{ sine {{ amplitude_m: {} frequency_hz: {} duration_s: {} }} }}",
                              draw.about(1e-4, 5e-3), hz, 2.0 * r.duration_s);
  return of(r, fmt::format(", forced at {:.3g} Hz", hz));
}

/// A wall that is pressed for good.
Case preload(Draw& draw) {
  Rendered r = in_hand(draw, 0.1, 3.0);
  r.duration_s = draw.between(4.0, 24.0);
  r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: {} }} }}", -draw.about(2e-3, 0.02),
                              draw.between(0.3, 1.5));
  r.of_device = "position_m: [0]";
  r.environment = r.half_space();
  return of(r, ", pressed");
}
/// The same, and growing fast: the wall is left and met again, a limit cycle that the network feeds.
Case limit_cycle(Draw& draw) {
  Rendered r = in_hand(draw, 5.0, 50.0);
  r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.5 }} }}", -draw.about(3e-3, 0.02));
  r.of_device = "position_m: [0]";
  r.environment = r.half_space();
  return of(r, ", pressed");
}
/// Lengths a thousandth, the same loop; E(0) as it is by default, or of any size.
Case lengths(Draw& draw) {
  Rendered r{.wall = tuned(drawn_wall(draw), signed_rate(draw, 0.02, 10.0)), .duration_s = draw.between(2.0, 8.0)};
  const double scale = draw.coin() ? 1e-3 : draw.about(1e-6, 10.0);
  r.of_device = fmt::format("position_m: [{}]", 1e-3 * scale);
  r.environment = r.spring();
  return of(r, fmt::format(", lengths x {:.2g}", scale));
}
Case initial_energy(Draw& draw) {
  Rendered r = in_hand(draw, 0.02, 10.0);
  const double joules = draw.about(1e-9, 1e3);
  r.passivity += fmt::format(" initial_energy_j: {}", joules);
  return of(r, fmt::format(", E(0) {:.2g} J", joules));
}

/// Seen for a quarter of a period, or little more.
Case quarter_period(Draw& draw) {
  const double omega = 2.0 * std::numbers::pi * draw.about(0.1, 1.5), mass = draw.about(0.5, 20.0);
  const double sigma = signed_rate(draw, 0.02, 0.2) * omega, period = 1e-3;
  SampledWall wall{
      .mass_kg = mass, .stiffness_n_per_m = mass * omega * omega, .period_s = period, .true_velocity = true};
  const double rough = wall.stiffness_n_per_m * 0.5 * period - 2.0 * mass * sigma;  // of device and wall together
  wall.damping_n_s_per_m = std::max(0.0, rough);
  wall.wall_damping_n_s_per_m = std::min(0.0, rough);
  if (wall.wall_damping_n_s_per_m < 0.0) {  // a wall cannot push: let its delay do so
    wall.wall_damping_n_s_per_m = 0.0;
    wall.period_s = std::min(0.02, 4.0 * sigma / (omega * omega));
  }
  Rendered r{.wall = wall,
             .duration_s = draw.between(0.2, 0.4) * 2.0 * std::numbers::pi / omega,
             .of_device = "position_m: [0.01]"};
  r.environment = r.spring();
  return of(r, fmt::format(", period {:.3g} s", 2.0 * std::numbers::pi / omega));
}

Case light_or_heavy(Draw& draw) {
  SampledWall wall = drawn_wall(draw);
  wall.mass_kg = draw.coin() ? draw.about(1e-3, 0.03) : draw.about(5.0, 200.0);
  wall.damping_n_s_per_m = wall.mass_kg * draw.about(0.3, 30.0);
  wall.wall_damping_n_s_per_m = 0.0;
  Rendered r{.wall = tuned(wall, signed_rate(draw, 0.02, 10.0)),
             .duration_s = draw.between(2.0, 8.0),
             .of_device = "position_m: [0.001]"};
  r.environment = r.spring();
  return of(r);
}

/// A device that can give no more than some force.
Case saturation(Draw& draw) {
  Rendered r{.wall = tuned(drawn_wall(draw), signed_rate(draw, 0.3, 20.0)), .duration_s = draw.between(3.0, 8.0)};
  const double start = draw.about(3e-4, 3e-3), limit = r.wall.stiffness_n_per_m * draw.about(5e-4, 5e-3);
  r.of_device = fmt::format("position_m: [{}] max_force_n: {}", start, limit);
  r.environment = r.spring();
  return of(r, fmt::format(", limit {:.3g} N", limit));
}

/// A wall that is passive by Colgate and Schenkel, b > K T/2 + B: whatever meets it comes to rest.
Case bouncing(Draw& draw) {
  SampledWall wall = drawn_wall(draw);
  wall.true_velocity = false;
  wall.wall_damping_n_s_per_m *= 0.1;
  wall.hand_stiffness_n_per_m = draw.about(20.0, 300.0);
  wall.stiffness_n_per_m = draw.about(200.0, 5000.0);
  wall.damping_n_s_per_m =
      draw.between(1.05, 2.0) * (0.5 * wall.stiffness_n_per_m * wall.period_s + wall.wall_damping_n_s_per_m);
  Rendered r{.wall = wall, .duration_s = draw.between(1.0, 4.0), .hand = true};
  r.hand_mass_kg = 0.3 * wall.mass_kg;
  r.of_operator = "path { hold { duration_s: 0.1 } }";
  r.of_device = fmt::format("position_m: [{}] velocity_m_per_s: [{}]", draw.between(0.0, 0.01), -draw.about(0.05, 0.5));
  r.environment = r.half_space();
  Case c = of(r, ", passive wall");
  c.stable = true;
  return c;
}

/// Three axes: a wall that is pressed along x, and the hand moves along it to the end.
Case behind_a_slide(Draw& draw) {
  Rendered r = in_hand(draw, 0.2, 5.0);
  r.dof = 3;
  r.of_operator = fmt::format(
      "path {{ move_to {{ position_m: [{}, 0, 0] duration_s: 0.5 }} }} "
      "path {{ sine {{ axis: 1 amplitude_m: {} frequency_hz: {} duration_s: 100 }} }}",
      -draw.about(3e-3, 0.02), draw.about(0.01, 0.1), draw.about(0.3, 2.0));
  r.of_device = "position_m: [0, 0, 0]";
  r.environment = r.half_space();
  return of(r, ", sliding along");
}

/// Truth by energy where no eigenvalue tells: the loop goes on for forty lengths of its scene, left alone. It is unstable when
/// the hand's port has paid, from the fourth to the eighth length, more than four times the ripple of its energy, and what
/// was neither put in nor granted; stable when it has paid less than its ripple after all forty.
enum class Paid : unsigned char { no, for_ever, unclear };
Paid paid_by_hand(const std::string& text) {
  const Scene scene = parse_scene(text, "case");
  const auto simulation = lab::make_simulation<1>(scene);
  double energy = 0.0, least = 0.0, most = 0.0;
  const auto run_to = [&](int lengths) {
    least = most = energy;
    simulation->run_until(lengths * simulation->end(), [&](const Row<1>& row) {
      energy = row.master_energy_j;
      least = std::min(least, energy);
      most = std::max(most, energy);
      return std::isfinite(energy);
    });
    return energy + simulation->initial_energy().si();
  };
  run_to(1);
  simulation->be_quiet();
  const double at_4 = run_to(4), at_7 = run_to(7), at_8 = run_to(8);
  const double ripple = std::max(0.0, most - least - std::abs(at_8 - at_7));
  if (at_4 - at_8 > 4.0 * ripple && at_8 < -4.0 * ripple && at_8 < 0.0 && at_4 - at_8 > 0.01 * std::abs(at_8))
    return Paid::for_ever;
  return run_to(40) >= -ripple ? Paid::no : Paid::unclear;
}

/// What the hand has got from the network by the end of the scene [J].
double spent_by_network(const std::string& text) {
  const auto simulation = lab::make_simulation<1>(parse_scene(text, "case"));
  double energy = 0.0;
  simulation->run([&](const Row<1>& row) {
    energy = row.master_energy_j;
    return std::isfinite(energy);
  });
  return -energy;
}

/// Pressed, then let go: how it was while pressed counts. A loop whose eigenvalues are within the circle may still go on
/// bouncing for ever; then it is the energy that tells.
Case let_go(Draw& draw) {
  for (;;) {
    Rendered r = in_hand(draw, 0.5, 30.0);
    const double depth = draw.about(3e-3, 0.02), hold_s = draw.between(0.3, 0.7) * r.duration_s;
    r.of_device = fmt::format("position_m: [{}]", depth);
    r.environment = r.half_space();
    r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.5 }} }}", -depth);
    const Paid paid = paid_by_hand(r.text());
    if ((paid == Paid::no) != (rate(r.wall) < 0.0)) continue;
    r.of_operator += fmt::format(
        " path {{ hold {{ duration_s: {} }} }} path {{ move_to {{ position_m: {} duration_s: 0.4 }} }}", hold_s, depth);
    return of(r, ", pressed and let go");
  }
}

/// A passive controller renders a wall or spring that would be unstable without it.
Case passive_rendering(Draw& draw) {
  for (;;) {
    Rendered r = in_hand(draw, 1.0, 30.0);
    r.wall = tuned(r.wall, draw.about(1.0, 50.0));
    r.passivity = draw.coin() ? "method: CLASSIC" : "method: FORCE_PROJECTED";
    r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.5 }} }}", -draw.about(3e-3, 0.02));
    r.of_device = "position_m: [0]";
    r.environment = r.half_space();
    const Paid paid = paid_by_hand(r.text());
    if (paid == Paid::unclear) continue;
    Case c = of(r, ", " + r.passivity);
    c.stable = paid == Paid::no;
    return c;
  }
}

/// Rests on a wall, then presses a soft one on the other side harder; the soft loop is stable. What the first wall does counts.
Case two_walls(Draw& draw) {
  for (;;) {
    Rendered r = in_hand(draw, 0.5, 30.0);
    Rendered soft = r;
    soft.wall.stiffness_n_per_m = draw.between(0.003, 0.03) * r.wall.stiffness_n_per_m;
    soft.wall.wall_damping_n_s_per_m = 0.1 * soft.wall.damping_n_s_per_m;
    if (rate(soft.wall) > -0.5) continue;
    const double depth = draw.about(1e-3, 0.01), hold_s = draw.between(1.0, 4.0);
    r.of_device = fmt::format("position_m: [{}]", depth);
    r.environment = r.half_space();
    r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.3 }} }}", -depth);
    const Paid paid = paid_by_hand(r.text());
    if ((paid == Paid::no) != (rate(r.wall) < 0.0)) continue;
    const double deep = draw.between(0.2, 0.4);
    r.environment += fmt::format(
        " }} environment {{ wall {{ normal: [-1] offset_m: -0.05 stiffness_n_per_m: {} damping_n_s_per_m: {} }}",
        soft.wall.stiffness_n_per_m, soft.wall.wall_damping_n_s_per_m);
    r.of_operator += fmt::format(
        " path {{ hold {{ duration_s: {} }} }} path {{ move_to {{ position_m: {} duration_s: 0.6 }} }} path {{ hold {{ "
        "duration_s: 2 }} }}",
        hold_s, deep);
    r.duration_s = hold_s + 3.0;
    if (draw.coin()) {
      r.of_operator += " path { move_to { position_m: 0.02 duration_s: 0.5 } } path { hold { duration_s: 1 } }";
      r.duration_s += 1.5;
    }
    return of(r, fmt::format(", then a soft wall, K {:.3g}", soft.wall.stiffness_n_per_m));
  }
}

/// A controller that has been granted more energy than an unstable wall spends in the run.
Case unspent_energy(Draw& draw) {
  for (;;) {
    Rendered r = in_hand(draw, 1.0, 30.0);
    r.wall.wall_damping_n_s_per_m = 0.0;
    r.wall = tuned(r.wall, draw.about(3.0, 15.0));
    r.duration_s = draw.about(1.0, 5.0);
    r.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.3 }} }}", -draw.about(2e-3, 0.01));
    r.of_device = "position_m: [0]";
    r.environment = r.half_space();
    const auto with = [&](double joules) {
      r.passivity = fmt::format("method: CLASSIC initial_energy_j: {}", joules);
      return r.text();
    };
    const double spent = spent_by_network(with(1e6));
    if (!(spent > 1e-3)) continue;
    const double joules = spent * draw.about(1.5, 100.0);
    // Of controllers that let nothing pass once they act.
    if (paid_by_hand(with(0.0)) != Paid::no || paid_by_hand(with(joules)) != Paid::no) continue;
    Case c = of(r, fmt::format(", CLASSIC, E(0) {:.3g} J of which {:.3g} J are spent", joules, spent));
    c.stable = true;
    return c;
  }
}

// ---- bodies that nobody drives, and devices that glide

Case free_body(Draw& draw) {
  const int dof = draw.one_of(0, 2) == 0 ? 1 : draw.coin() ? 3 : 6;
  const auto list = [&](double scale) {
    std::string all = fmt::format("{}", scale * draw.between(-1.0, 1.0));
    for (int i = 1; i < dof; ++i) all += fmt::format(", {}", scale * draw.between(-1.0, 1.0));
    return "[" + all + "]";
  };
  const std::string motion = "velocity_m_per_s: " + list(draw.about(0.01, 30.0));
  const double duration = draw.between(0.5, 20.0);
  if (dof != 6 && draw.coin())
    return {fmt::format("dof: {} duration_s: {} device {{ mass_kg: {} damping_n_s_per_m: {} {} }}\n"
                        "control {{ architecture: RENDER passivity {{ method: NONE }} }}",
                        dof, duration, draw.about(0.01, 10.0), draw.coin() ? 0.0 : draw.about(1e-3, 1.0), motion),
            true, "a device that nobody holds glides", 0.0};
  std::string environment;
  const char* zeros = dof == 1 ? "[0]" : "[0, 0, 0]";
  if (draw.coin())
    environment =
        fmt::format("environment {{ spring {{ stiffness_n_per_m: {} anchor_m: {} }} }}", draw.about(1.0, 1e4), zeros);
  return {
      fmt::format("dof: {} duration_s: {} robot {{ mass_kg: {} {} {} }}\ncontrol {{ architecture: UNCONTROLLED }}\n{}",
                  dof, duration, draw.about(0.01, 10.0), motion,
                  dof == 6 ? fmt::format("inertia_kg_m2: [{}, {}, {}]", draw.between(0.011, 0.02),
                                         draw.between(0.011, 0.02), draw.between(0.011, 0.02))
                           : "",
                  environment),
      true, "a body that nobody drives", 0.0};
}

// ---- loops over a link

struct Linked {
  BilateralLoop loop;
  int dof = 1;
  double duration_s = 5.0;
  std::string of_operator{}, of_device = "velocity_m_per_s: [0.02]", of_link{}, of_robot{}, passivity = "method: NONE",
                             scene{}, environment{};
  double delay_to_slave_s = 0.0, delay_to_master_s = 0.0;
  bool linear = true;  ///< no ramp, and a tracker that follows at any speed

  [[nodiscard]] std::string text() const {
    const char* const architecture = loop.architecture == Architecture::position_force      ? "POSITION_FORCE"
                                     : loop.architecture == Architecture::position_position ? "POSITION_POSITION"
                                                                                            : "POSITION_MEASURED_FORCE";
    std::string s = fmt::format("dof: {} duration_s: {} rate_hz: {} {}\n", dof, duration_s, 1.0 / loop.period_s, scene);
    s += fmt::format("operator {{ hand {{ stiffness_n_per_m: {} }} {} }}\n", loop.hand_stiffness_n_per_m, of_operator);
    s += fmt::format("device {{ mass_kg: {} damping_n_s_per_m: {} {} {} }}\n", loop.master_mass_kg,
                     loop.master_damping_n_s_per_m, of_device,
                     loop.backward_difference ? "velocity_estimate: BACKWARD_DIFFERENCE" : "");
    s += fmt::format(
        "control {{ architecture: {} force_scale: {:.17g} virtual_coupling {{ stiffness_n_per_m: {:.17g} "
        "damping_n_s_per_m: "
        "{:.17g} {} }} passivity {{ {} }} {} }}\n",
        architecture, loop.force_scale, loop.coupling_stiffness_n_per_m, loop.coupling_damping_n_s_per_m,
        linear ? "catch_up_m_per_s: 1e6" : "", passivity, linear ? "engage_s: 0" : "");
    const double to_slave = delay_to_slave_s > 0.0 ? delay_to_slave_s : loop.to_slave_ticks * loop.period_s;
    const double to_master = delay_to_master_s > 0.0 ? delay_to_master_s : loop.to_master_ticks * loop.period_s;
    s += fmt::format("to_slave {{ delay_ms: {} {} }} to_master {{ delay_ms: {} {} }}\n", 1e3 * to_slave, of_link,
                     1e3 * to_master, of_link);
    s += fmt::format("robot {{ mass_kg: {} damping_n_s_per_m: {} force_sensor {{ {} }} }}\n", loop.robot_mass_kg,
                     loop.robot_damping_n_s_per_m, of_robot);
    if (!environment.empty()) return s + "environment { " + environment + " }\n";
    return s + fmt::format("environment {{ spring {{ stiffness_n_per_m: {} damping_n_s_per_m: {} anchor_m: [0] }} }}\n",
                           loop.environment_stiffness_n_per_m, loop.environment_damping_n_s_per_m);
  }
};

std::string words(const BilateralLoop& l) {
  return fmt::format(
      "sigma {:.3g} 1/s; {} m {:.3g}|{:.3g} b {:.3g}|{:.3g} k_h {:.3g} k_e {:.3g} K {:.4g} B {:.3g} s_f {:.3g} d {}+{} "
      "T {}",
      rate(l), static_cast<int>(l.architecture), l.master_mass_kg, l.robot_mass_kg, l.master_damping_n_s_per_m,
      l.robot_damping_n_s_per_m, l.hand_stiffness_n_per_m, l.environment_stiffness_n_per_m,
      l.coupling_stiffness_n_per_m, l.coupling_damping_n_s_per_m, l.force_scale, l.to_slave_ticks, l.to_master_ticks,
      l.period_s);
}

BilateralLoop tuned(BilateralLoop loop, double target) {
  const bool exchanged = loop.architecture == Architecture::position_position;
  const auto with = [&](double x) {
    BilateralLoop each = loop;
    (exchanged ? each.coupling_stiffness_n_per_m : each.force_scale) = x;
    return each;
  };
  const double critical = exchanged ? critical_coupling_stiffness(loop) : critical_force_scale(loop);
  const auto at = [&](double x) { return rate(with(x)); };
  // Modes may cross further away: only where the rate still rises.
  const double x =
      target > 0.0 ? solve(at, target, critical, 1.3 * critical) : solve(at, target, 0.5 * critical, critical);
  return with(x);
}

BilateralLoop drawn_loop(Draw& draw) {
  constexpr Architecture kAll[] = {Architecture::position_force, Architecture::position_measured_force,
                                   Architecture::position_position};
  for (;;) {
    const BilateralLoop loop{.architecture = kAll[draw.one_of(0, 2)],
                             .master_mass_kg = draw.about(0.07, 1.0),
                             .master_damping_n_s_per_m = draw.about(0.5, 10.0),
                             .hand_stiffness_n_per_m = draw.about(50.0, 800.0),
                             .robot_mass_kg = draw.about(0.2, 3.0),
                             .robot_damping_n_s_per_m = draw.about(1.0, 20.0),
                             .environment_stiffness_n_per_m = draw.about(100.0, 5000.0),
                             .coupling_stiffness_n_per_m = draw.about(300.0, 3000.0),
                             .coupling_damping_n_s_per_m = draw.about(10.0, 60.0),
                             .period_s = draw.coin() ? 1e-3 : 5e-4,
                             .to_slave_ticks = draw.one_of(1, 15),
                             .to_master_ticks = draw.one_of(1, 15),
                             .backward_difference = draw.one_of(0, 4) == 0};
    const bool exchanged = loop.architecture == Architecture::position_position;
    const double critical = exchanged ? critical_coupling_stiffness(loop) : critical_force_scale(loop);
    if (critical > 1e-3 && critical < (exchanged ? 1e5 : 50.0)) return loop;
  }
}

Case of(const Linked& l, const std::string& more = {}) {
  return {l.text(), rate(l.loop) < 0.0, fmt::format("{}; {:.3g} s{}", words(l.loop), l.duration_s, more), rate(l.loop)};
}

Case link(Draw& draw) {
  return of({.loop = tuned(drawn_loop(draw), signed_rate(draw, 0.01, 10.0)), .duration_s = draw.between(2.0, 8.0)});
}
Case link_marginal(Draw& draw) {
  const double duration = draw.between(2.0, 8.0);
  return of(
      {.loop = tuned(drawn_loop(draw), signed_rate(draw, 1e-5 / duration, 1e-3 / duration)), .duration_s = duration});
}
Case link_slow(Draw& draw) {
  return of({.loop = tuned(drawn_loop(draw), signed_rate(draw, 1e-3, 5e-3)), .duration_s = draw.between(4.0, 12.0)});
}
/// Nothing is heard to the end of the scene.
Case blackout(Draw& draw) {
  Linked l{.loop = tuned(drawn_loop(draw), signed_rate(draw, 0.5, 10.0)), .duration_s = draw.between(3.0, 8.0)};
  const double last = draw.about(0.2, 2.0);
  l.of_link = fmt::format("blackout {{ start_s: {} duration_s: {} }}", l.duration_s - last, last + 1.0);
  return of(l, fmt::format(", blackout of the last {:.2g} s", last));
}
/// Jitter and loss change the delay from packet to packet: the loop is well on one side for every delay there is.
Case jitter_and_loss(Draw& draw) {
  for (;;) {
    Linked l{.loop = drawn_loop(draw), .duration_s = draw.between(3.0, 8.0)};
    const bool stable = draw.coin();
    l.loop = tuned(l.loop, stable ? -10.0 : 8.0);
    const double jitter = draw.between(0.1, 0.6) * l.loop.period_s, loss = draw.between(0.0, 0.1);
    BilateralLoop early = l.loop, late = l.loop;
    early.to_slave_ticks = std::max(1, early.to_slave_ticks - 2),
    early.to_master_ticks = std::max(1, early.to_master_ticks - 2);
    late.to_slave_ticks += 5, late.to_master_ticks += 5;
    const auto clear = [&](const BilateralLoop& each) { return stable ? rate(each) < -0.5 : rate(each) > 1.0; };
    if (!clear(l.loop) || !clear(early) || !clear(late)) continue;
    l.of_link = fmt::format("jitter_ms: {} loss: {}", 1e3 * jitter, loss);
    l.scene = fmt::format("seed: {}", draw.one_of(1, 1000));
    Case c = of(l, fmt::format(", jitter {:.2g} ms, loss {:.2g}", 1e3 * jitter, loss));
    c.rate = 0.0;
    return c;
  }
}
/// A noisy force sensor and a tremor, over a link.
Case link_noise(Draw& draw) {
  Linked l{.loop = tuned(drawn_loop(draw), signed_rate(draw, 0.2, 10.0)), .duration_s = draw.between(3.0, 8.0)};
  l.of_robot = fmt::format("noise_n: {}", draw.about(1e-3, 0.3));
  l.of_operator = fmt::format("tremor {{ rms_m: {} }}", draw.about(1e-6, 1e-4));
  return of(l, ", noise and tremor");
}
/// Three axes: a robot that presses a wall along x, and the hand moves along it. The other axes have no environment.
Case link_behind_a_slide(Draw& draw) {
  for (;;) {
    Linked l{.loop = drawn_loop(draw), .dof = 3, .duration_s = draw.between(4.0, 8.0)};
    l.loop = tuned(l.loop, signed_rate(draw, 0.3, 5.0));
    BilateralLoop across = l.loop;
    across.environment_stiffness_n_per_m = 0.0;
    if (rate(across) > -0.3) continue;
    l.of_device = "velocity_m_per_s: [0, 0, 0]";
    l.of_operator = fmt::format(
        "path {{ move_to {{ position_m: [{}, 0, 0] duration_s: 0.5 }} }} "
        "path {{ sine {{ axis: 1 amplitude_m: {} frequency_hz: {} duration_s: 100 }} }}",
        -draw.about(0.01, 0.03), draw.about(0.01, 0.1), draw.about(0.3, 2.0));
    l.environment =
        fmt::format("wall {{ normal: [1, 0, 0] stiffness_n_per_m: {} }}", l.loop.environment_stiffness_n_per_m);
    return of(l, ", sliding along");
  }
}

/// Part of the ticks in which something is touched.
double touched(const std::string& text) {
  double ticks = 0.0, touching = 0.0;
  lab::make_simulation<1>(parse_scene(text, "case"))->run([&](const Row<1>& row) {
    ++ticks;
    touching += row.env_f.squared_norm() > 0.0;
    return std::isfinite(row.master_energy_j);
  });
  return touching / ticks;
}
/// A hand that swings slowly touches a wall at one side of its way, and ends beside it: what the loop would do there counts.
Case link_tapping(Draw& draw) {
  for (;;) {
    Linked l{.loop = drawn_loop(draw), .duration_s = draw.between(4.0, 8.0)};
    l.loop = tuned(l.loop, signed_rate(draw, 0.5, 8.0));
    BilateralLoop beside = l.loop;
    beside.environment_stiffness_n_per_m = 0.0;
    if (rate(beside) > -0.3) continue;
    const double amplitude_m = draw.about(0.01, 0.05), swings = draw.one_of(1, 4),
                 swing_s = 0.75 * l.duration_s / swings;
    l.of_device = "velocity_m_per_s: [0]";
    l.environment = fmt::format("wall {{ normal: [1] offset_m: {} stiffness_n_per_m: {} }}",
                                -draw.between(0.2, 0.6) * amplitude_m, l.loop.environment_stiffness_n_per_m);
    l.of_operator = fmt::format("path {{ move_to {{ position_m: {} duration_s: {} }} }}", -amplitude_m, 0.25 * swing_s);
    const Paid held = paid_by_hand(l.text());
    if (held != (rate(l.loop) < 0.0 ? Paid::no : Paid::for_ever)) continue;
    l.of_operator = fmt::format("path {{ sine {{ axis: 0 amplitude_m: {} frequency_hz: {} duration_s: {} }} }}",
                                amplitude_m, 1.0 / swing_s, swings * swing_s);
    // Leaving and touching a wall can make a loop grow that does not in contact.
    if (touched(l.text()) < 0.1 || (held == Paid::no && paid_by_hand(l.text()) != Paid::no)) continue;
    return of(l, fmt::format(", tapping {:.2g} times", swings));
  }
}

/// Six degrees of freedom, positions exchanged, nobody holds the handle's position: translation and rotation are two loops
/// that know nothing of each other. One is tuned, the other glides or spins.
Case link_six(Draw& draw) {
  const bool rotation = draw.coin();
  const double period = 1e-3;
  const auto loop = [&](double mass, double stiffness, double damping, double hand, double own) {
    return BilateralLoop{.architecture = Architecture::position_position,
                         .master_mass_kg = mass,
                         .master_damping_n_s_per_m = own,
                         .hand_stiffness_n_per_m = hand,
                         .robot_mass_kg = 2.0 * mass,
                         .robot_damping_n_s_per_m = own,
                         .environment_stiffness_n_per_m = 0.0,
                         .coupling_stiffness_n_per_m = stiffness,
                         .coupling_damping_n_s_per_m = damping,
                         .period_s = period,
                         .to_slave_ticks = draw.one_of(2, 8),
                         .to_master_ticks = draw.one_of(2, 8)};
  };
  for (;;) {
    BilateralLoop judged =
        loop(draw.about(0.2, 1.0), 500.0, draw.about(3.0, 10.0), draw.about(50.0, 300.0), draw.about(0.5, 3.0));
    const double scale = rotation ? 1e-2 : 1.0;  // inertias are smaller
    judged = tuned(judged, signed_rate(draw, 0.3, 3.0));
    BilateralLoop other = judged;
    other.hand_stiffness_n_per_m = 0.0;
    other.coupling_stiffness_n_per_m = 0.3 * judged.coupling_stiffness_n_per_m;
    other.master_damping_n_s_per_m = other.robot_damping_n_s_per_m = 0.0;
    // It glides for ever; whatever else it does must die away.
    BilateralLoop held = other;
    held.hand_stiffness_n_per_m = 1e-3;
    if (rate(held) > 1e-4) continue;
    const BilateralLoop& t = rotation ? other : judged;
    const BilateralLoop& r = rotation ? judged : other;
    const double to_r = rotation ? scale : 1e-2;
    const double fast = draw.about(0.1, 2.0), small = rotation ? draw.about(0.01, 0.1) : draw.about(1e-3, 0.02);
    const std::string twist =
        rotation ? fmt::format("[{}, 0, 0, 0, 0, {}]", fast, small) : fmt::format("[{}, 0, 0, 0, 0, {}]", small, fast);
    const std::string text = fmt::format(
        "dof: 6 duration_s: {} rate_hz: {}\n"
        "operator {{ hand {{ stiffness_n_per_m: {} rotational_stiffness_n_m_per_rad: {} }} }}\n"
        "device {{ mass_kg: {} damping_n_s_per_m: {} inertia_kg_m2: {} rotational_damping_n_m_s_per_rad: {} "
        "velocity_m_per_s: {} }}\n"
        "control {{ architecture: POSITION_POSITION engage_s: 0 virtual_coupling {{ stiffness_n_per_m: {:.17g} "
        "damping_n_s_per_m: {} rotational_stiffness_n_m_per_rad: {:.17g} rotational_damping_n_m_s_per_rad: {} "
        "catch_up_m_per_s: 1e6 }} passivity {{ method: NONE }} }}\n"
        "to_slave {{ delay_ms: {} }} to_master {{ delay_ms: {} }}\n"
        "robot {{ mass_kg: {} damping_n_s_per_m: {} inertia_kg_m2: [{}] rotational_damping_n_m_s_per_rad: {} "
        "velocity_m_per_s: {} }}\n",
        draw.between(3.0, 8.0), 1.0 / period, t.hand_stiffness_n_per_m, to_r * r.hand_stiffness_n_per_m,
        t.master_mass_kg, t.master_damping_n_s_per_m, to_r * r.master_mass_kg, to_r * r.master_damping_n_s_per_m, twist,
        t.coupling_stiffness_n_per_m, t.coupling_damping_n_s_per_m, to_r * r.coupling_stiffness_n_per_m,
        to_r * r.coupling_damping_n_s_per_m, 1e3 * judged.to_slave_ticks * period,
        1e3 * judged.to_master_ticks * period, t.robot_mass_kg, t.robot_damping_n_s_per_m, to_r * r.robot_mass_kg,
        to_r * r.robot_damping_n_s_per_m, twist);
    return {text, rate(judged) < 0.0,
            words(judged) + (rotation ? ", of the rotation, behind a glide" : ", of the translation, behind a spin"),
            rate(judged)};
  }
}

/// A passive controller over a link whose loop would be unstable without it: bounded.
Case link_passive(Draw& draw) {
  Linked l{
      .loop = tuned(drawn_loop(draw), draw.about(2.0, 30.0)), .duration_s = draw.between(4.0, 8.0), .linear = false};
  l.passivity = "method: FORCE_PROJECTED";
  l.delay_to_slave_s = draw.about(2e-3, 0.05);
  l.delay_to_master_s = draw.about(2e-3, 0.05);
  if (draw.coin()) l.of_link = fmt::format("loss: {}", draw.between(0.0, 0.05));
  l.of_device = "position_m: [0]";
  l.of_operator =
      fmt::format("path {{ move_to {{ position_m: {} duration_s: 0.7 }} }} path {{ hold {{ duration_s: 1 }} }}{}",
                  -draw.about(5e-3, 0.03), draw.coin() ? " path { move_to { position_m: 0 duration_s: 0.5 } }" : "");
  l.environment = fmt::format("wall {{ normal: [1] stiffness_n_per_m: {} }}", l.loop.environment_stiffness_n_per_m);
  Case c = of(l, ", FORCE_PROJECTED");
  c.stable = true;
  return c;
}

}  // namespace

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> kAll{{"oscillator", oscillator},
                                      {"slow", slow},
                                      {"marginal", marginal},
                                      {"tremor", tremor},
                                      {"endless_path", endless_path},
                                      {"forced_sine", forced_sine},
                                      {"preload", preload},
                                      {"limit_cycle", limit_cycle},
                                      {"let_go", let_go},
                                      {"two_walls", two_walls},
                                      {"unspent_energy", unspent_energy},
                                      {"lengths", lengths},
                                      {"initial_energy", initial_energy},
                                      {"quarter_period", quarter_period},
                                      {"light_or_heavy", light_or_heavy},
                                      {"saturation", saturation},
                                      {"bouncing", bouncing},
                                      {"behind_a_slide", behind_a_slide},
                                      {"passive_rendering", passive_rendering},
                                      {"free_body", free_body},
                                      {"link", link},
                                      {"link_slow", link_slow},
                                      {"link_marginal", link_marginal},
                                      {"blackout", blackout},
                                      {"jitter_and_loss", jitter_and_loss},
                                      {"link_noise", link_noise},
                                      {"link_behind_a_slide", link_behind_a_slide},
                                      {"link_tapping", link_tapping},
                                      {"link_six", link_six},
                                      {"link_passive", link_passive}};
  return kAll;
}

}  // namespace twoport::test
