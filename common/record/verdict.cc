#include "common/record/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/vector.h"

namespace twoport {
namespace {

/// From this part of the motion on the twin's difference is not small.
constexpr double kLarge = 0.03;
/// A hand does not notice a motion below this part of the run's largest speed.
constexpr double kNoticed = 0.01;
/// Where a controller acts, a motion below this part counts as rest, even if the network feeds it.
constexpr double kFaint = 1e-4;
constexpr double kDiverged = 1e3;
/// What loses less than this of ln A over a tail is fed, if something feeds it.
constexpr double kSlowDecay = 0.5;
/// A controller that lets the hand's energy pass is watched for this many lengths of the run.
constexpr double kCredit = 8.0;

struct Coordinate {
  std::size_t signal;
  MotionTrend y, d;
  bool far = false;  ///< d is not small, and unclear: y alone decides
};

/// Is it known not to grow?
bool is_settled(const MotionTrend& t) {
  return is_known(t.trend) && t.trend != Trend::grows;
}

/// Do y and d show the same growth or decay, clearly?
bool agree(const MotionTrend& y, const MotionTrend& d) {
  if (y.trend == Trend::rest && d.trend == Trend::rest) return true;
  const bool clear = std::abs(y.slope) > 10.0 * y.error && std::abs(d.slope) > 10.0 * d.error;
  return y.trend == d.trend && (y.trend == Trend::grows || y.trend == Trend::decays) && clear &&
         std::abs(y.slope - d.slope) < 0.02 * std::abs(y.slope);
}

/// The trends of a tail, and what the rules ask of them.
class Judge {
 public:
  Judge(const Tail& tail, const MotionScale& run)
      : tail_{tail},
        run_{run},
        port_{tail.record.energy(0)},
        two_port_{tail.record.energy(1)},
        contact_changes_{tail.record.contact_changes()},
        linear_{!tail.controller_acted && !tail.coarse && contact_changes_ == 0 && !tail.record.limited()} {
    const std::size_t n = tail.has_twin ? tail.record.signals() / 2 : tail.record.signals();
    for (std::size_t i = 0; i < n; ++i) coordinates_.push_back(coordinate(i, n));
    if (tail.record.number_of_energies() > 3)
      into_coupling_ = tail.record.energy(2), into_robot_ = tail.record.energy(3);
  }

  /// Does the sampled coupling, of which no passivity controller knows, give the robot a part of the energy that keeps it moving?
  /// Motion that follows the hand, `following` times its speed, does not count, nor one that decays unless it is `lasting`.
  bool coupling_feeds_robot(double following = 0.0, bool lasting = false) const {
    const double made = -into_coupling_.line.slope;
    const bool steadily = into_coupling_.falls() || falls_in_each_window(2);
    // What the robot does not take goes into the network. One that gives is driven by the environment.
    if (!steadily || made < 0.1 * into_robot_.line.slope || into_robot_.line.slope < -0.1 * made) return false;
    return any([&](const Coordinate& c) {
      const bool decays = c.y.trend == Trend::decays || c.y.trend == Trend::unclear_decay;
      // A loop that is not linear may lose amplitude slowly and yet live on what the coupling gives.
      const bool slowly = !linear_ && kTrendWindows * c.y.slope > -kSlowDecay;
      const bool dies = c.y.trend == Trend::rest || (decays && !slowly);
      return c.signal >= run_.dof && (lasting || !dies) && c.y.rms > kNoticed * run_.largest_of_kind(c.signal) &&
             c.y.rms > following * coordinates_[c.signal - run_.dof].y.rms;
    });
  }
  /// Has it given more than was put into it?
  bool coupling_has_fed() const { return into_coupling_.last < 0.0; }

  bool twin_has_parted() const {
    return tail_.controller_acted && any([](const Coordinate& c) { return c.far; });
  }

  Verdict decide() const {
    using enum VerdictKind;
    const bool acted = tail_.controller_acted;
    if (runs_away()) return {unstable, "diverged"};
    if (tail_.run_lengths < 1.0 && !tail_.last) return at_a_glance();
    const bool y_grows = any([](const Coordinate& c) { return c.y.trend == Trend::grows; });
    const bool y_flat = any([](const Coordinate& c) { return c.y.trend == Trend::flat; });
    const bool y_settled = !any([](const Coordinate& c) { return !is_settled(c.y); });
    const bool d_settled = !any([](const Coordinate& c) { return !c.far && !is_settled(c.d); });
    const bool calm = !any([this](const Coordinate& c) { return !dies_away(c); });
    const bool paid = this->paid();
    // All y that decay do so certainly.
    const bool confirmed = !any([this](const Coordinate& c) { return c.y.trend == Trend::decays && !dies_away(c); });
    const bool below = this->below();
    // A live run has but one tail, and it is short: what would need four lengths is taken as it is.
    const bool is_long = tail_.run_lengths >= 4.0 || tail_.last;

    if (coupling_feeds_robot() && (coupling_has_fed() || !tail_.last))
      return coupling_has_fed() ? driven_by_coupling() : marginal();
    if (y_grows && !acted) return grows_by_itself();
    if (!noticed(kFaint) && trembles()) return restless_at("");
    if (acted && noticed()) {
      if (tail_.run_lengths >= 2.0 && leaks())
        return {unstable, "oscillation of " + amplitude() + ", fed past its controller" + paid_so_far()};
      if (!tail_.last && spending()) return marginal();
    }
    if (!acted && on_credit() && paid && (y_flat || (is_long && sustained()))) {
      if (!tail_.last && spending()) return marginal();
      return restless_at("on granted energy that the passivity controller lets go before it acts");
    }
    if (y_flat && paid) {
      if (linear_ && !is_long) return marginal();
      if (acted && !below) return restless_at("on energy that the hand has put in before");
      return {unstable, "sustained oscillation of " + amplitude() + fed_by() + paid_so_far()};
    }
    if (const std::string how = grows_when_touched(calm); !how.empty()) return {unstable, how};
    if (is_long && (paid || (tail_.last && fed())) && (!acted || below) && sustained())
      return {unstable, "unsteady oscillation of " + amplitude() + fed_by() + paid_so_far()};
    if (!tail_.driven) return {stable, "bounded; no force of a controller acts"};
    if (trembles()) return restless_at("");
    if (calm && (d_settled || (acted && tail_.last))) return {stable, "bounded and decaying"};
    if (y_settled) {
      if (acted) return restless_at("kept going by a passive controller");
      if (d_settled && confirmed && (linear_ ? is_long : !pays() || tail_.run_lengths >= kCredit))
        return {stable, "bounded, neither growing nor decaying" + resolution()};
    }
    if (acted && is_long && !calm) {
      if (tail_.run_lengths < 2.0 && noticed() && tail_.initial_energy_j + port_.last < 0.0)
        return {undecided,
                "undecided: little energy passes the controller" + paid_so_far() + "; a longer rest would decide it"};
      if (y_grows && two_port_.falls() && below) return {unstable, "growing" + fed_by() + rate() + paid_so_far()};
      const bool hand_pays = tail_.run_lengths >= kCredit && port_.line.slope > -5.0 * port_.line.error;
      if (tail_.last || !y_grows || hand_pays) return restless_at("unsteady, kept going by a passive controller");
    }
    // An encoder's or dry friction's small motion is irregular, and shows no trend however long it lasts.
    if (tail_.last && tail_.coarse && tail_.run_lengths >= kCredit && dithers()) return restless_at("");
    return marginal();
  }

 private:
  Coordinate coordinate(std::size_t i, std::size_t n) const {
    const double rounding = run_.rounding(i), still = std::max(rounding, 1e-9 * run_.largest_of_kind(i));
    Coordinate c{.signal = i, .y = tail_.record.motion(i, still, linear_), .d = {}};
    if (tail_.twin_parted)
      c.d.trend = c.y.rms > still ? Trend::unclear : Trend::rest, c.d.rms = c.y.rms;
    else if (tail_.has_twin)
      c.d = tail_.record.motion(n + i, rounding, linear_);
    c.far = !is_known(c.d.trend) && c.d.rms >= kLarge * c.y.rms && c.y.rms > still;
    const double error = c.y.error + c.d.error;
    // A run and its twin that agree on a slope show it, however small.
    if (c.y.trend == Trend::flat && c.d.trend == Trend::flat && c.y.turns >= 8 &&
        std::abs(c.y.slope) > 10.0 * c.y.error && std::abs(c.d.slope) > 10.0 * c.d.error &&
        std::abs(c.y.slope - c.d.slope) < 0.1 * std::abs(c.y.slope) + 3.0 * error)
      c.y.trend = c.d.trend = c.y.slope > 0.0 ? Trend::grows : Trend::decays;
    if (tail_.last) {
      if (c.y.trend == Trend::unclear_decay) c.y.trend = Trend::decays;
      if (c.d.trend == Trend::unclear_decay) c.d.trend = Trend::decays;
    }
    return c;
  }

  /// The verdict of a tail shorter than the run: only what is clear.
  Verdict at_a_glance() const {
    const auto clearly = [](const MotionTrend& t) { return t.slope * (kTrendWindows - 3); };
    // What is not linear goes from rest to rest through stretches that grow: such a motion must be seen.
    if (!tail_.controller_acted && (linear_ || noticed()) &&
        any([&](const Coordinate& c) { return c.y.trend == Trend::grows && clearly(c.y) > 3.0; }))
      return grows_by_itself();
    // A linear loop and its twin that agree on every slope show its dominant mode.
    if (linear_ && !any([](const Coordinate& c) { return !agree(c.y, c.d); })) {
      if (any([](const Coordinate& c) { return c.y.trend == Trend::grows; })) return grows_by_itself();
      return {VerdictKind::stable, "bounded and decaying"};
    }
    const auto gone = [&](const MotionTrend& t) {
      return t.trend == Trend::rest || (t.trend == Trend::decays && clearly(t) < -3.0);
    };
    if (tail_.run_lengths >= 0.5 && trembles()) return restless_at("");
    if (!any([&](const Coordinate& c) { return !gone(c.y) || !gone(c.d); }))
      return {VerdictKind::stable, "bounded and decaying"};
    return marginal();
  }

  /// What remains is too small to be noticed, and nothing rises.
  bool dithers() const {
    return !noticed() &&
           !any([](const Coordinate& c) { return c.y.trend == Trend::grows || c.y.trend == Trend::unclear_growth; }) &&
           (!noticed(kFaint) || !(paid() && below()));
  }
  /// The same where a controller acts.
  bool trembles() const { return tail_.controller_acted && dithers(); }

  /// Is there a controller that waits until the hand's energy is used up?
  bool on_credit() const { return tail_.has_controller && tail_.initial_energy_j + port_.last >= 0.0; }
  /// A passivity controller lets a motion grow until the hand's energy is used up: undecided until then.
  Verdict grows_by_itself() const {
    if (!on_credit()) return {VerdictKind::unstable, "growing by itself" + rate()};
    // The hand's energy does not limit what the coupling gives.
    if (into_coupling_.last < -tail_.initial_energy_j)
      return {VerdictKind::unstable, "growing, fed by the robot's own coupling" + rate()};
    return {VerdictKind::undecided,
            "undecided: growing, and the passivity controller has not had to act yet; a longer run would decide it"};
  }

  template <class Test>
  bool any(Test test) const {
    return std::any_of(coordinates_.begin(), coordinates_.end(), test);
  }

  bool runs_away() const {
    if (tail_.diverged) return true;
    // A speed a thousand times that of the hand, and of the robot at the beginning, is not caused by them.
    double own = 0.0;
    for (std::size_t i = 0; i < run_.dof; ++i) own = std::max(own, run_.speed[i]);
    if (!(own > 0.0)) return false;
    for (std::size_t i = run_.dof; i < run_.early.size(); ++i) own = std::max(own, run_.early[i]);
    return any([&](const Coordinate& c) { return c.y.trend != Trend::decays && c.y.rms > kDiverged * own; });
  }

  /// Does the twin leave the run? In words; empty: no.
  std::string grows_when_touched(bool calm) const {
    bool grows = false, over = false, far = false;
    for (const Coordinate& c : coordinates_) {
      if (c.far || c.d.trend != Trend::grows) continue;
      grows = true;
      if (c.d.rms > c.y.rms) {
        over = true;
        far = far || c.d.rms > 1e-3 * run_.largest_of_kind(c.signal);
      }
    }
    const bool alone = !tail_.controller_acted && (contact_changes_ <= 4 || over);
    if (!grows || on_credit() || !(alone || (calm && far))) return {};
    return "growing when touched" + rate();
  }

  /// The first window left out.
  bool falls_in_each_window(std::size_t energy) const {
    if (energy >= tail_.record.number_of_energies()) return false;
    const WindowMeans means = tail_.record.energies(energy);
    return std::is_sorted(means.rbegin(), means.rend() - 1) && means.back() < means[1];
  }

  bool paid() const { return port_.falls() || two_port_.falls(); }
  /// Is there an unsteady motion with many turning points?
  bool sustained() const {
    return any([](const Coordinate& c) {
      return (c.y.trend == Trend::unclear || c.y.trend == Trend::unclear_growth) && c.y.turns >= 40;
    });
  }
  /// Has the hand got more energy than it was granted, and does it get more from window to window?
  bool fed() const { return tail_.initial_energy_j + port_.last < 0.0 && falls_in_each_window(0); }
  /// Does the port's energy fall, if only by little against its ripple?
  bool pays() const {
    return port_.line.slope < -10.0 * port_.line.error || two_port_.line.slope < -10.0 * two_port_.line.error;
  }
  /// Once the twin has parted from the run, a decay is not trusted while the network feeds energy or contacts change.
  bool dies_away(const Coordinate& c) const {
    if (c.y.trend == Trend::rest) return true;
    if (c.y.trend != Trend::decays) return false;
    return !c.far || (c.y.slope < -10.0 * c.y.error && !paid() && contact_changes_ == 0) || tail_.last;
  }
  /// Does the hand's energy fall steadily though it is used up?
  bool leaks() const { return tail_.initial_energy_j + port_.last < 0.0 && port_.line.slope < -8.0 * port_.line.error; }
  /// Does a controller let the hand's energy go, so that it will soon be gone, or has just been used up?
  bool spending() const {
    const double left = tail_.initial_energy_j + port_.last, slope = port_.line.slope;
    if (left < 0.0) return slope < -2.0 * port_.line.error;
    const double to_come = kTrendWindows * (kCredit / tail_.run_lengths - 1.0);
    return slope < -5.0 * port_.line.error && left + to_come * slope < 0.0;
  }
  bool noticed(double part = kNoticed) const {
    return any([&](const Coordinate& c) {
      const double noise = run_.rotates(c.signal) ? run_.noise.rotation : run_.noise.translation;
      return c.y.rms > std::max(part * run_.largest_of_kind(c.signal), noise);
    });
  }
  /// Has the hand got more than it has put in and was granted?
  bool below() const { return tail_.initial_energy_j + port_.last < -2.0 * port_.ripple; }

  Verdict driven_by_coupling() const {
    return {VerdictKind::unstable, "oscillation of " + amplitude() + ", fed by the robot's own coupling"};
  }
  Verdict restless_at(const std::string& why) const {
    if (!noticed()) return {VerdictKind::stable, "bounded; a residual motion remains: " + amplitude()};
    if (coupling_has_fed() && coupling_feeds_robot(0.0, true)) return driven_by_coupling();
    return {VerdictKind::restless, "bounded and passive, but not quiet: " + amplitude() + ", " + why};
  }

  Verdict marginal() const {
    if (tail_.last && coupling_has_fed() && coupling_feeds_robot(0.0, true)) return driven_by_coupling();
    std::string which = "no coordinate shows a clear trend";
    for (const Coordinate& c : coordinates_) {
      if (is_known(c.y.trend) && (c.far || is_known(c.d.trend))) continue;
      which = fmt::format("{} {} shows no clear trend within {} turning points", name(c.signal).first,
                          name(c.signal).second, std::max(c.y.turns, c.d.turns));
      break;
    }
    return {VerdictKind::undecided, "undecided: " + which + "; a longer run would decide it"};
  }

  std::pair<std::string, std::string> name(std::size_t signal) const {
    return {signal < run_.dof ? "the master's" : "the slave's",
            run_.dof == kJointPort
                ? fmt::format("joint {}", signal % run_.dof)
                : fmt::format("{} {}", run_.rotates(signal) ? "rotation" : "translation", signal % run_.dof % 3)};
  }
  [[nodiscard]] double windows_per_s() const {
    return kTrendWindows * run_.rate_hz / static_cast<double>(std::max<std::size_t>(tail_.record.ticks(), 1));
  }
  /// The fastest growth. Of a linear loop it is the rate of a mode, else the mean over the tail.
  std::string rate() const {
    double most = 0.0;
    for (const Coordinate& c : coordinates_)
      for (const MotionTrend* t : {&c.y, &c.d})
        if (t->trend == Trend::grows) most = std::max(most, t->slope * windows_per_s());
    return linear_ ? fmt::format(", {:.3g} 1/s", most) : fmt::format(", about {:.2g} 1/s", most);
  }
  /// What rate may have been missed.
  std::string resolution() const {
    double most = 0.0;
    for (const Coordinate& c : coordinates_)
      if (c.y.trend == Trend::flat) most = std::max(most, (std::abs(c.y.slope) + 3.0 * c.y.error) * windows_per_s());
    return fmt::format(" by more than {:.1g} 1/s", most);
  }
  /// What creates energy, where that is known.
  std::string fed_by() const {
    if (run_.source == EnergySource::unknown) return {};
    return run_.source == EnergySource::network ? ", fed by the network" : ", fed by the rendering";
  }
  std::string amplitude() const {
    double translation = 0.0, rotation = 0.0;
    for (const Coordinate& c : coordinates_) {
      double& most = run_.rotates(c.signal) ? rotation : translation;
      most = std::max(most, c.y.rms);
    }
    if (rotation > 0.0) return fmt::format("{:.3g} mm/s and {:.3g} rad/s rms", 1e3 * translation, rotation);
    return fmt::format("{:.3g} mm/s rms", 1e3 * translation);
  }
  std::string paid_so_far() const {
    return fmt::format(": port energy falls below {:.4g} J", tail_.initial_energy_j + port_.last);
  }

  const Tail& tail_;
  const MotionScale& run_;
  EnergyTrend port_, two_port_, into_coupling_, into_robot_;
  std::size_t contact_changes_;
  /// Nothing acted that is not linear.
  bool linear_;
  std::vector<Coordinate> coordinates_;
};

}  // namespace

std::string_view to_string(VerdictKind kind) {
  constexpr std::string_view kNames[] = {"STABLE", "RESTLESS", "UNSTABLE", "UNDECIDED"};
  return kNames[static_cast<std::size_t>(kind)];
}

double MotionScale::largest(bool rotation) const {
  double most = 0.0;
  for (std::size_t i = 0; i < speed.size(); ++i)
    if (rotates(i) == rotation) most = std::max(most, speed[i]);
  return most;
}

double MotionScale::rounding(std::size_t signal) const {
  return 16.0 * std::numeric_limits<double>::epsilon() * rate_hz * (rotates(signal) ? 1.0 : reach_m) + 1e-300;
}

Verdict judge_body(const Tail& tail) {
  if (tail.diverged) return {VerdictKind::unstable, "diverged"};
  if (!tail.record.enough() || tail.run_lengths < 1.0) return {VerdictKind::undecided, "undecided: too short"};
  WindowMeans held = tail.record.energies(0);
  if (!(*std::max_element(held.begin(), held.end()) > 0.0))
    return {VerdictKind::stable, "bounded: a body at rest that nobody drives"};
  for (double& each : held) each = std::log(std::max(each, 1e-300));
  const Line line = fit_line(held);
  if (line.slope > 5.0 * line.error && line.slope * (kTrendWindows - 1) > 1e-3)
    return {VerdictKind::unstable,
            "the mechanical energy of a body that nobody drives grows: its integrator adds to it"};
  return {VerdictKind::stable, "bounded: nobody drives the body, and its mechanical energy does not grow"};
}

bool is_driven_by_coupling(const Tail& tail, const MotionScale& run, double motion_scale) {
  constexpr double kFaster = 3.0;
  const Judge all{tail, run};
  return all.coupling_has_fed() && all.coupling_feeds_robot(kFaster * motion_scale);
}

bool twin_has_parted(const Tail& tail, const MotionScale& run) {
  return tail.has_twin && tail.record.enough() && Judge{tail, run}.twin_has_parted();
}

Verdict judge(const Tail& tail, const MotionScale& run) {
  if (tail.diverged) return {VerdictKind::unstable, "diverged"};
  if (!tail.record.enough())
    return {VerdictKind::undecided, "undecided: too short to see a trend; a longer run would decide it"};
  return Judge{tail, run}.decide();
}

}  // namespace twoport
