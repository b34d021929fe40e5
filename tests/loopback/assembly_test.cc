#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "common/base/file.h"
#include "tests/support/live.h"

// The shipped scene of an arm that brings a peg into a hole, two programs over UDP.
namespace twoport::test::assembly_test {
namespace {

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

/// The scene with its insertion only, in 4.7 seconds, and without promises about the rest.
std::string insertion() {
  std::string text = read_whole(TWOPORT_SCENES "/assembly.textproto");
  replace(text, "../arms", TWOPORT_ARMS);
  replace(text, "duration_s: 14", "duration_s: 4.7");
  replace(text, "duration_s: 1.5", "duration_s: 1");
  replace(text, "duration_s: 3 ", "duration_s: 2 ");
  replace(text, "duration_s: 1.5", "duration_s: 0.8");
  return text.substr(0, text.find("expect {"));
}

TEST(RunAssembly, BringsThePegIntoTheHole) {
  const Pair pair{insertion()};
  Process slave = pair.listening_slave(), master = pair.master();
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  EXPECT_EQ(slave.wait(), Exit{.status = 0}) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.method(), "INTERNAL_MODEL");
  if (!kept_time({m, s})) return;
  // The intended motion goes on: no verdict of the end.
  EXPECT_EQ(m.verdict_kind(), "UNDECIDED") << m.verdict();
  EXPECT_GE(m.min_port_energy_j(), -1e-3);
  EXPECT_GT(m.contact_spring_share(), 0.8);
  // Free before the touch, though the sensor is noisy: a reading that is no contact is no force.
  ASSERT_TRUE(m.has_free_force_rms_n());
  EXPECT_GT(m.free_force_rms_n(), 0.01);
  EXPECT_LT(m.free_force_rms_n(), 0.5);
  const Trace robot = pair.trace("slave");
  const auto& z = robot["slave_x_2"];
  // The hole is 20 mm deep; the hand leads 10 mm beyond its bottom. Above its mouth the peg was 1.8 mm aside, within it 0.2 mm are free and
  // a contact of 3 kN/m yields.
  EXPECT_LT(*std::min_element(z.begin(), z.end()), -0.015);
  EXPECT_GT(*std::min_element(z.begin(), z.end()), -0.025);
  EXPECT_LT(std::hypot(robot["slave_x_0"].back(), robot["slave_x_1"].back()), 1.2e-3);
}

}  // namespace
}  // namespace twoport::test::assembly_test
