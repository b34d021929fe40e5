#include "lab/study/zwidth.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "common/base/check.h"

namespace twoport::lab::zwidth_test {
namespace {

ZWidthOptions scene(const std::string& name = "z_width") {
  return {.scene = std::string{TWOPORT_SCENES} + "/" + name + ".textproto",
          .set = {},
          .damping = "0,30,120,250,290",
          .stiffness = "500:500000:25:log",
          .jobs = 2,
          .out = {}};
}

// The laboratory's verdict of a run and the eigenvalues of the same loop, which share no code.
TEST(ZWidth, WithoutAControllerIsBoundedByTheEigenvalues) {
  const ZWidth z = z_width(scene());
  ASSERT_EQ(z.methods.front(), "NONE");
  const auto column = static_cast<std::size_t>(std::find(z.table.columns.begin(), z.table.columns.end(), "stable") -
                                               z.table.columns.begin());
  int inside = 0, outside = 0;
  for (const auto& row : z.table.rows) {
    if (row[2] != "NONE") continue;
    const double b = std::stod(row[0].text()), k = std::stod(row[1].text());
    const auto at = static_cast<std::size_t>(std::find(z.damping.begin(), z.damping.end(), b) - z.damping.begin());
    if (std::abs(k / z.critical[at] - 1.0) < 0.01) continue;
    EXPECT_EQ(row[column] == "1", k < z.critical[at]) << "B " << b << ", K " << k << ", theory " << z.critical[at];
    ++(k < z.critical[at] ? inside : outside);
  }
  EXPECT_GT(inside, 50);
  EXPECT_GT(outside, 20);
}

TEST(ZWidth, IsWidenedByAControllerWhereDampingIsMissingAndNotWhereItIsTooMuch) {
  const ZWidth z = z_width(scene());
  for (std::size_t m = 1; m < z.methods.size(); ++m) {
    EXPECT_GT(z.displayed[m][0], 50.0 * z.displayed[0][0]) << z.methods[m];
    // A held damper beyond 2m/T is unstable itself: what the controller adds is one more.
    EXPECT_EQ(z.displayed[m][4], z.displayed[0][4]) << z.methods[m];
  }
  EXPECT_DOUBLE_EQ(z.passive[0], 2.0 * 0.5 * 2000.0);
  EXPECT_EQ(z.passive[1], 0.0);
}

TEST(ZWidth, WarnsOfASetThatHasNoEffect) {
  ZWidthOptions o = scene();
  o.damping = std::string{"0"};
  o.stiffness = std::string{"500"};
  o.methods = std::string{"NONE"};
  o.set = {"duration_s=0.1", "environment[0].spring.stiffness_n_per_m=7"};
  testing::internal::CaptureStderr();
  z_width(o);
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "warning: --set environment[0].spring.stiffness_n_per_m=7 has no effect: "
            "environment[0].spring.stiffness_n_per_m is varied\n");
}

TEST(ZWidth, RefusesWhatTheoryDoesNotKnow) {
  for (const char* name : {"render_wall_none", "one_axis_wall", "encoder_30um"})
    EXPECT_THROW(z_width(scene(name)), ConfigError) << name;
  ZWidthOptions o = scene();
  o.set = {"device.coulomb_friction_n=0.1"};
  EXPECT_THROW(z_width(o), ConfigError);
}

}  // namespace
}  // namespace twoport::lab::zwidth_test
