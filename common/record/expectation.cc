#include "common/record/expectation.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "common/base/check.h"
#include "common/record/figure.h"

namespace twoport {

std::vector<std::string> violations(const ExpectSpec& expect, const Summary& summary) {
  std::vector<std::string> found;
  const bool undecided = summary.verdict_kind() == to_string(VerdictKind::undecided);
  // A scene that expects nothing does not expect this.
  if (undecided && summary.has_coupled_at_end() && !summary.coupled_at_end())
    found.push_back(summary.verdict());
  else if (expect.stable && !summary.has_stable())
    found.push_back(fmt::format("stable is not known of this run, expected {}", *expect.stable));
  else if (expect.stable && undecided)
    found.push_back(fmt::format("stable is undecided, expected {}: {}", *expect.stable, summary.verdict()));
  else if (expect.stable && *expect.stable != summary.stable())
    found.push_back(fmt::format("stable is {}, expected {}{}", summary.stable(), *expect.stable,
                                summary.verdict().empty() ? "" : ": " + summary.verdict()));
  if (expect.stable == true && summary.gripper().has_stable() && !summary.gripper().stable())
    found.push_back(fmt::format("gripper.stable is false, expected stable true: {}", summary.gripper().verdict()));

  for (const MethodVerdict& each : expect.of_method)
    if (each.method == summary.method() && each.verdict_kind != summary.verdict_kind())
      found.push_back(fmt::format("verdict_kind with {} is {}, expected {}: {}", each.method, summary.verdict_kind(),
                                  each.verdict_kind, summary.verdict()));

  const auto check = [&](const Bound& bound, const char* side, double sign, const char* missed) {
    const Figure* const figure = Figure::find(bound.key);
    if (figure == nullptr) throw ConfigError{fmt::format("expect: no number \"{}\" in a summary", bound.key)};
    const std::optional<double> known = figure->known_of(summary);
    if (!known) {
      found.push_back(fmt::format("{} is not known of this run, expected {} {:.9g}", bound.key, side, bound.value));
      return;
    }
    const double value = *known;
    if (sign * value >= sign * bound.value) return;
    std::string sentence = fmt::format("{} is {:.9g}, expected {} {:.9g}", bound.key, value, side, bound.value);
    if (!std::isnan(value)) sentence += fmt::format(": {} by {:.9g}", missed, sign * (bound.value - value));
    found.push_back(std::move(sentence));
  };
  for (const Bound& bound : expect.at_least) check(bound, "at least", 1.0, "short");
  for (const Bound& bound : expect.at_most) check(bound, "at most", -1.0, "over");
  return found;
}

}  // namespace twoport
