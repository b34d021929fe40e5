#include "lab/study/ranking.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "common/coupling/layers.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/run.h"

namespace twoport::lab {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double positive_or_zero(double value) {
  return value > 0.0 ? value : 0.0;
}
/// What the environment takes, as a mean over the run: one without contact has pressed nothing.
double pressed_force_n(const Summary& s) {
  return positive_or_zero(s.environment_force_mean_n()) * positive_or_zero(s.touching_share());
}

/// Has it a passivity layer that bounds a port's energy, or is it of one piece?
bool claims_a_bound(std::string_view method) {
  const MethodName* const named = find_name(kMethods, method);
  const std::string_view layer = named != nullptr ? named->passivity : method.substr(method.find('+') + 1);
  const PassivityLayerName* const passivity = find_name(kPassivityLayers, layer);
  return passivity == nullptr || passivity->claim->any();
}

template <class May>
std::size_t least_error(const std::vector<Standing>& all, May may) {
  std::size_t found = all.size();
  for (std::size_t m = 0; m < all.size(); ++m)
    if (may(all[m]) && (found == all.size() || all[m].error_n.mean < all[found].error_n.mean)) found = m;
  return found;
}

/// Of a best method that errs less than the default only because the default has drag: it shows a surface that it knows
/// when the hand reaches it, a long round trip before the robot, and the measure compares with what the robot meets.
std::string beside_the_default(const std::vector<Standing>& all, const Standing& best) {
  const auto of_default =
      std::find_if(all.begin(), all.end(), [name = kDefaultMethod](const Standing& s) { return s.method == name; });
  if (of_default == all.end()) return {};
  const Standing& d = *of_default;
  const double more = std::pow(d.error_n.mean, 2) - std::pow(best.error_n.mean, 2);
  if (!d.holds() || !(more > 0.0) || 2.0 * d.drag_n * d.drag_n < more) return {};
  return fmt::format(
      "; it holds a press at {:.2f}. {}, the default, presses {:.0f} %, holds at {:.2f} and errs by {:.2g} N, mostly "
      "drag, {:.2g} N: it shows a known surface before the robot reaches it. Take it where the hand meets a surface at "
      "rest more than once",
      best.held_force_ratio, d.method, 100.0 * d.pressed.mean, d.held_force_ratio, d.error_n.mean, d.drag_n);
}

/// Others that are as good to 5 %; where there is none, the next one.
std::string others(const std::vector<Standing>& all, const Standing& best) {
  const auto text = [](const Standing& s) { return fmt::format("{}, {:.2g} N", s.method, s.error_n.mean); };
  std::vector<std::string> as_good;
  for (const Standing& each : all)
    if (&each != &best && each.may_be_best() && each.error_n.mean <= 1.05 * best.error_n.mean)
      as_good.push_back(text(each));
  if (!as_good.empty()) return fmt::format("; within 5 %: {}", fmt::join(as_good, "; "));
  const std::size_t next = least_error(all, [&](const Standing& s) { return &s != &best && s.may_be_best(); });
  return next < all.size() ? "; next: " + text(all[next]) : std::string{};
}

}  // namespace

bool Standing::may_be_best() const {
  constexpr double kRounding_j = 1e-6, kMostPressed = 1.5;
  return holds() && claims_a_bound(method) && pressed.mean <= kMostPressed &&
         hand_min_energy_j >= -(initial_energy_j + kRounding_j);
}

Standing standing_of(const std::string& method, const std::vector<Summary>& runs, double reference_n,
                     double initial_energy_j) {
  Standing of;
  of.method = method;
  of.reference_n = reference_n;
  of.initial_energy_j = initial_energy_j;
  std::vector<double> pressed, error;
  for (const Summary& s : runs) {
    const std::string& kind = s.verdict_kind();
    ++(kind == "STABLE"     ? of.stable
       : kind == "RESTLESS" ? of.restless
       : kind == "UNSTABLE" ? of.unstable
                            : of.undecided);
    if (kind != "STABLE") continue;
    const double force = pressed_force_n(s);
    // What is missing, and its share, are known beside a reference only.
    if (!(reference_n > 0.0)) continue;
    pressed.push_back(force / reference_n);
    error.push_back(std::sqrt(
        std::pow(positive_or_zero(s.felt_force_error_rms_n()), 2) + std::pow(positive_or_zero(reference_n - force), 2) +
        std::pow(positive_or_zero(s.free_force_rms_n()), 2) + std::pow(positive_or_zero(s.chatter_rms_n()), 2)));
  }
  // Less pressed is worse; any other name has the largest value as the worst.
  of.pressed = pressed.empty() ? Spread{kNone, kNone, kNone} : spread("environment_force_mean_n", pressed);
  of.error_n = error.empty() ? Spread{kNone, kNone, kNone} : spread("error", error);
  const auto spread_of = [&](const char* figure) { return spread(Figure::named(figure), runs); };
  of.drag_n = spread_of("free_force_rms_n").mean;
  of.held_force_ratio = spread_of("held_force_ratio").mean;
  of.hand_min_energy_j = spread_of("hand_min_energy_j").worst;
  return of;
}

Energy shared_initial_energy(const Scene& scene, Seconds round_trip) {
  if (scene.control.initial_energy.si() != default_initial_energy(scene.control).si())
    return scene.control.initial_energy;
  ControlOptions there = scene.control;
  choose_method(there, kDefaultMethod);
  there.known.round_trip = round_trip;
  return default_initial_energy(there);
}

double reference_force_n(Scene scene, const std::atomic<bool>* stop, const HostedRobot* robot) {
  scene.to_slave = scene.to_master = {};
  scene.transmission_to_slave = scene.transmission_to_master = {};
  const Summary s = run(scene, {.verdict = VerdictFrom::plain, .stop = stop, .robot = robot});
  return s.verdict_kind() == "UNSTABLE" ? kNone : pressed_force_n(s);
}

std::size_t best_of(const std::vector<Standing>& all) {
  return least_error(all, [](const Standing& s) { return s.may_be_best(); });
}

Recommendation recommend(const std::vector<Standing>& all) {
  const std::size_t found = best_of(all);
  if (found == all.size()) {
    if (!all.empty() && !(all[0].reference_n > 0.0))
      return {"none",
              "without delay, loss and control the scene presses nothing or is unstable: there is no force to "
              "compare with"};
    const std::size_t held = least_error(all, [](const Standing& s) { return s.holds(); });
    return {"none",
            "no method that bounds the energy of a port is stable and quiet here with at least half of the force "
            "pressed, and at most half of it more" +
                (held < all.size() ? "; " + all[held].method +
                                         " is, but bounds no energy, pays the hand more than E(0), or presses more"
                                   : std::string{})};
  }
  const Standing& best = all[found];
  const auto count = [&](auto is) { return std::count_if(all.begin(), all.end(), is); };
  const auto unstable = count([](const Standing& s) { return s.unstable > 0; });
  return {best.method,
          fmt::format(
              "stable and quiet in {} run{}, presses {:.0f} % of the {:.2g} N without delay, least error: {:.2g} N{}; "
              "{} of {} methods hold here, {} {} unstable{}; with control.passivity.initial_energy_j: {:.4g}{}",
              best.runs(), best.runs() == 1 ? "" : "s", 100.0 * best.pressed.mean, best.reference_n, best.error_n.mean,
              others(all, best), count([](const Standing& s) { return s.holds(); }), all.size(), unstable,
              unstable == 1 ? "is" : "are", best.good() ? "" : "; not good: an error of half the force or more",
              best.initial_energy_j, beside_the_default(all, best))};
}

std::string in_a_line(const Recommendation& best) {
  return fmt::format("best: {}: {}\n", best.method, best.why);
}

}  // namespace twoport::lab
