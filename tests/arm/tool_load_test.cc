#include "common/arm/tool_load.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>
#include <vector>

namespace twoport::tool_load_test {
namespace {

using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

const Vector3d kGravity{0.0, 0.0, -9.81};

ToolLoad gripper() {
  ToolLoad load{.mass_kg = 0.73, .first_moment_kg_m = 0.73 * Vector3d{-0.01, 0.0, 0.03}};
  load.bias << 1.5, -2.0, 0.7, 0.05, -0.08, 0.02;
  return load;
}

std::vector<WristReading> readings(const ToolLoad& load, int count, double noise) {
  std::mt19937_64 rng{7};
  std::normal_distribution<double> normal;
  std::vector<WristReading> all;
  for (int i = 0; i < count; ++i) {
    Eigen::Quaterniond q{normal(rng), normal(rng), normal(rng), normal(rng)};
    const Eigen::Matrix3d R = q.normalized().toRotationMatrix();
    Vector6 error;
    for (int k = 0; k < 6; ++k) error[k] = noise * normal(rng);
    all.push_back({R, load.reading(R, kGravity) + error});
  }
  return all;
}

TEST(ToolLoad, IsIdentifiedExactlyFromThreeAttitudesWithoutNoise) {
  const ToolLoad load = gripper(), found = identify_tool(readings(load, 3, 0.0), kGravity);
  EXPECT_NEAR(found.mass_kg, load.mass_kg, 1e-12);
  EXPECT_LT((found.first_moment_kg_m - load.first_moment_kg_m).norm(), 1e-12);
  EXPECT_LT((found.bias - load.bias).norm(), 1e-11);
}

TEST(ToolLoad, NoiseAveragesOut) {
  const ToolLoad load = gripper(), found = identify_tool(readings(load, 400, 0.1), kGravity);
  // 0.1 N in each of 1200 equations for 4 unknowns: 5 standard deviations of 0.1/√(1200/3) N over 9.81 m/s² and N.
  EXPECT_NEAR(found.mass_kg, load.mass_kg, 5 * 0.1 / 20 / 9.81);
  EXPECT_LT((found.bias - load.bias).head<3>().cwiseAbs().maxCoeff(), 5 * 0.1 / 20);
}

}  // namespace
}  // namespace twoport::tool_load_test
