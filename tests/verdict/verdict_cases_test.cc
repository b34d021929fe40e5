#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <optional>
#include <string>

#include "common/base/file.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "tests/verdict/cases.h"

// The laboratory's verdict against what is known without it: a confusion table, kind by kind. TWOPORT_VERDICT_SEED draws
// other cases, TWOPORT_VERDICT_CASES more of each kind;
// TWOPORT_VERDICT_SCENES names a folder for their scenes.
namespace twoport::verdict_cases_test {
namespace {

constexpr std::uint64_t kSeed = 20261122;
constexpr int kCases = 14;  // of each kind

std::uint64_t number_of(const char* variable, std::uint64_t otherwise) {
  const char* const text = std::getenv(variable);
  return text ? std::strtoull(text, nullptr, 10) : otherwise;
}

/// The rate that a verdict gives of a linear loop [1/s], to three digits. The test allows 1 %, half a digit and what the fit
/// of the tail leaves, and 1e-7 per window of the shortest tail, a 32nd of the scene.
std::optional<double> growth_in(const std::string& verdict) {
  const std::string before = "growing by itself, ";
  const std::size_t at = verdict.find(before), end = verdict.find(" 1/s");
  if (at == std::string::npos || end == std::string::npos || verdict.find("about") != std::string::npos) return {};
  return std::stod(verdict.substr(at + before.size()));
}

class VerdictOfKnownTruth : public testing::TestWithParam<test::Kind> {};

TEST_P(VerdictOfKnownTruth, IsNeverWrongAndRarelyUndecided) {
  const test::Kind& kind = GetParam();
  std::uint64_t seed = number_of("TWOPORT_VERDICT_SEED", kSeed);
  for (const char* c = kind.name; *c != '\0'; ++c) seed = seed * 131 + static_cast<unsigned char>(*c);
  test::Draw draw{seed};
  const int cases = static_cast<int>(number_of("TWOPORT_VERDICT_CASES", kCases));
  int right[2] = {}, wrong[2] = {}, undecided[2] = {}, restless = 0;
  double cost = 0.0;
  for (int i = 0; i < cases; ++i) {
    const test::Case c = kind.draw(draw);
    if (const char* folder = std::getenv("TWOPORT_VERDICT_SCENES"))
      write_whole(fmt::format("{}/{}_{}.textproto", folder, kind.name, i), "# " + c.why + "\n" + c.scene);
    const Scene scene = parse_scene(c.scene, kind.name);
    const auto [s, ticks] = lab::run_counted(scene);
    cost += static_cast<double>(ticks) / s.steps() / cases;
    const bool is_undecided = s.verdict_kind() == "UNDECIDED";
    ++(is_undecided ? undecided : s.stable() == c.stable ? right : wrong)[c.stable];
    restless += s.verdict_kind() == "RESTLESS";
    if (const std::optional<double> growth = growth_in(s.verdict()); growth && c.rate > 0.0) {
      EXPECT_NEAR(*growth, c.rate, 0.01 * c.rate + 1e-7 * 32.0 / scene.duration_s)
          << s.verdict() << " (" << c.why << ")";
    }
    if (is_undecided || s.stable() != c.stable)
      fmt::print("  {} {}: {}, in truth {}: {} ({})\n", kind.name, i, is_undecided ? "undecided" : "WRONG",
                 c.stable ? "stable" : "unstable", s.verdict(), c.why);
  }
  fmt::print(
      "| {:<20} | {:>3} stable: {:>3} right, {} wrong, {} undecided | {:>3} unstable: {:>3} right, {} wrong, {} "
      "undecided | {:>2} "
      "restless | {:.1f} plain runs |\n",
      kind.name, right[1] + wrong[1] + undecided[1], right[1], wrong[1], undecided[1],
      right[0] + wrong[0] + undecided[0], right[0], wrong[0], undecided[0], restless, cost);
  EXPECT_EQ(wrong[0] + wrong[1], 0);
  EXPECT_LE(undecided[0] + undecided[1], (cases + 9) / 10);
}

INSTANTIATE_TEST_SUITE_P(Kinds, VerdictOfKnownTruth, testing::ValuesIn(test::kinds()),
                         [](const auto& each) { return std::string{each.param.name}; });

}  // namespace
}  // namespace twoport::verdict_cases_test
