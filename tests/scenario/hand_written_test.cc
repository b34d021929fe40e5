#include "tests/support/hand_written.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/scene/load.h"
#include "lab/engine/simulation.h"

namespace twoport::hand_written_test {
namespace {

template <int N>
auto along_x(double x) {
  if constexpr (N == 6) {
    return Position<6>{x * Eigen::Vector3d::UnitX(), Eigen::Quaterniond::Identity()};
  } else {
    return typename Position<N>::Vector{x * Position<N>::Vector::Unit(0)};
  }
}
template <int N>
double apart(const Position<N>& x, const typename Position<N>::Vector& y) {
  return (x.translation() - y).norm();
}
double apart(const Position<6>& x, const Position<6>& y) {
  return (x.translation() - y.translation()).norm();
}

/// Largest distance between chain and loop, on either side, over the whole run [m].
template <int N, class Loop>
double largest_distance() {
  const bench::WallParameters p;
  const auto chain = lab::make_simulation<N>(parse_scene(bench::wall_scene(N), "wall"));
  Loop loop{p};
  double worst = 0.0, deepest = -1.0;
  int tick = 0;
  chain->run([&](const Row<N>& row) {
    worst = std::max({worst, apart(row.master_x, loop.master()), apart(row.slave_x, loop.slave())});
    deepest = std::max(deepest, row.slave_x.translation()[0] - p.wall_at);
    loop.step(along_x<N>(p.intended(++tick)));
    return true;
  });
  EXPECT_EQ(tick, 16'000);
  EXPECT_GT(deepest, 1e-4) << "the wall was not pressed";
  return worst;
}

// The chain, with its ports, packets, modes and telemetry, is the textbook's loop and nothing else.
TEST(Chain, IsTheHandWrittenLoopOnOneAxis) {
  EXPECT_LT((largest_distance<1, bench::HandWritten<1>>()), 1e-12);
}
TEST(Chain, IsTheHandWrittenLoopOnThreeAxes) {
  EXPECT_LT((largest_distance<3, bench::HandWritten<3>>()), 1e-12);
}
TEST(Chain, IsTheHandWrittenLoopOnSixAxes) {
  EXPECT_LT((largest_distance<6, bench::HandWritten6>()), 1e-12);
}

}  // namespace
}  // namespace twoport::hand_written_test
