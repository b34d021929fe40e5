#include "common/coupling/setpoint_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace twoport::setpoint_tracker_test {
namespace {

constexpr Seconds kTick{1e-3};

/// A master whose reports reach the tracker at once, or are lost.
class Follower {
 public:
  explicit Follower(double catch_up_m_per_s = 0.05) : tracker_{{.catch_up_m_per_s = catch_up_m_per_s}} {}

  void step(double x, double v, bool arrives) {
    if (arrives) {
      x_rx_ = Position<1>{Position<1>::Vector{x}};
      v_rx_ = Velocity<1>{Velocity<1>::Vector{v}};
    }
    x_d_ = x_d_ + tracker_.step(x_d_, x_rx_, v_rx_, arrives, kTick) * kTick;
  }
  [[nodiscard]] double x() const { return x_d_.translation()[0]; }
  [[nodiscard]] double velocity() const { return tracker_.velocity().vec()[0]; }

 private:
  SetpointTracker<1> tracker_;
  Position<1> x_rx_, x_d_;
  Velocity<1> v_rx_;
};

TEST(SetpointTracker, IsTheReceivedPositionWithoutLoss) {
  Follower f;
  for (int i = 0; i <= 1000; ++i) {
    f.step(1e-6 * i * i, 2e-3 * i, true);
    ASSERT_NEAR(f.x(), 1e-6 * i * i, 1e-12);
  }
}

TEST(SetpointTracker, BridgesAShortGapWithTheLastVelocity) {
  Follower f;
  int i = 0;
  for (; i < 100; ++i) f.step(2e-4 * i, 0.2, true);
  for (; i < 130; ++i) f.step(0, 0, false);
  EXPECT_NEAR(f.x(), 2e-4 * 129, 1e-12);
  f.step(2e-4 * i, 0.2, true);
  EXPECT_NEAR(f.x(), 2e-4 * 130, 1e-12);
}

// However long the silence: 0.38 m/s for 0.05 s are 19 mm.
TEST(SetpointTracker, GoesNoFurtherThanTheBridgeInALongGap) {
  Follower f;
  int i = 0;
  for (; i < 100; ++i) f.step(3.8e-4 * i, 0.38, true);
  for (int k = 0; k < 3000; ++k) f.step(0, 0, false);
  EXPECT_NEAR(f.x() - 3.8e-4 * 99, 0.38 * SetpointTracker<1>::kBridge.si(), 3.8e-4 + 1e-12);
  EXPECT_EQ(f.velocity(), 0.0);
}

// A hand that swings by 20 mm at 4 Hz, over a link that passes a few packets now and then.
TEST(SetpointTracker, GapsThatRecurDoNotAddUp) {
  for (const double on_s : {4e-3, 0.02, 0.05})
    for (const double period_s : {0.25, 0.2437, 0.37, 0.1303}) {
      Follower f;
      double farthest = 0.0;
      for (int i = 0; i < 20000; ++i) {
        const double t = 1e-3 * i, rate = 2.0 * std::numbers::pi * 4.0;
        f.step(0.02 * std::sin(rate * t), 0.02 * rate * std::cos(rate * t), std::fmod(t, period_s) < on_s);
        farthest = std::max(farthest, std::abs(f.x()));
      }
      // The hand's 20 mm, and twice what the bridge adds at its greatest speed.
      EXPECT_LT(farthest, 0.02 + 2.0 * 0.5027 * SetpointTracker<1>::kBridge.si()) << on_s << " s of " << period_s;
    }
}

}  // namespace
}  // namespace twoport::setpoint_tracker_test
