#include "sim/operator/path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "tests/support/sizes.h"

namespace twoport::sim::path_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

using Segments = std::vector<SegmentSpec>;
constexpr double kPi = std::numbers::pi;
constexpr double kRounding = 1e-14;  // of numbers up to 1, a few operations

Position<3> at(double x, double y, double z) {
  return Position<3>{Vector3d{x, y, z}};
}
Numbers pose(const Vector3d& p, const Quaterniond& q) {
  return {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
}

/// Where the path is and how fast at t alone: a path only runs forwards.
template <int N>
typename Path<N>::Sample sample(Path<N> path, double t) {
  return path.at(t);
}
/// Distance between two positions, attitude included.
template <int N>
double apart(const Position<N>& a, const Position<N>& b) {
  return (a - b).vec().norm();
}

// --- how a scene writes it -----------------------------------------------------------------------

TEST(PositionOfAScene, FillsWithZerosWhatIsNotWritten) {
  EXPECT_EQ(position<1>({}).translation()[0], 0.0);
  EXPECT_EQ(position<1>({0.2}).translation()[0], 0.2);
  EXPECT_EQ(position<3>({1.0, 2.0}).translation(), Vector3d(1.0, 2.0, 0.0));
  EXPECT_EQ(vector<3>({1.0}), Vector3d(1.0, 0.0, 0.0));
  const Position<6> pose = position<6>({1.0, 2.0, 3.0});
  EXPECT_EQ(pose.translation(), Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(pose.attitude().coeffs(), Quaterniond::Identity().coeffs());
}

TEST(PositionOfAScene, ReadsAnAttitudeAsWxyzOfUnitLength) {
  const Position<6> pose = position<6>({0, 0, 0, 3.0, 0, 0, 4.0});
  EXPECT_NEAR(pose.attitude().w(), 0.6, kRounding);
  EXPECT_NEAR(pose.attitude().z(), 0.8, kRounding);
}

// --- move_to -------------------------------------------------------------------------------------

constexpr double kSpan = 0.8;  // [s]
Path<3> move() {
  return {{MoveToSpec{{0.03, -0.04, 0.12}, kSpan}}, at(0, 0, 0)};
}
constexpr double kLength = 0.13;

TEST(MoveTo, LeavesAndArrivesAtRest) {
  const auto start = sample(move(), 0.0), end = sample(move(), kSpan * (1 - 1e-15)), after = sample(move(), kSpan);
  EXPECT_EQ(apart(start.x, at(0, 0, 0)), 0.0);
  EXPECT_EQ(start.v.vec().norm(), 0.0);
  EXPECT_LT(apart(end.x, at(0.03, -0.04, 0.12)), kRounding);
  EXPECT_LT(end.v.vec().norm(), kRounding);
  EXPECT_EQ(apart(after.x, at(0.03, -0.04, 0.12)), 0.0);
  EXPECT_EQ(after.v.vec().norm(), 0.0);
}

TEST(MoveTo, LeavesAndArrivesWithoutAcceleration) {
  // v = 30 L/T (s² - ...) near the ends: over a thousandth of the way its mean slope is 0.03 of the greatest.
  const double moment = 1e-3 * kSpan, greatest = 5.7735 * kLength / (kSpan * kSpan);
  EXPECT_LT(sample(move(), moment).v.vec().norm() / moment, 0.01 * greatest);
  EXPECT_LT(sample(move(), kSpan - moment).v.vec().norm() / moment, 0.01 * greatest);
}

TEST(MoveTo, IsFastestHalfWayAt1875ThousandthsOfItsMean) {
  const auto middle = sample(move(), 0.5 * kSpan);
  EXPECT_LT(apart(middle.x, at(0.015, -0.02, 0.06)), kRounding);
  EXPECT_NEAR(middle.v.vec().norm(), 1.875 * kLength / kSpan, kRounding);
  Path<3> path = move();
  for (int k = 0; k <= 1000; ++k)
    EXPECT_LE(path.at(k * kSpan / 1000).v.vec().norm(), 1.875 * kLength / kSpan + kRounding);
}

TEST(MoveTo, KeepsToTheStraightLine) {
  Path<3> path = move();
  const Vector3d along = Vector3d{0.03, -0.04, 0.12} / kLength;
  double before = 0.0;
  for (int k = 0; k <= 1000; ++k) {
    const auto s = path.at(k * kSpan / 1000);
    const double way = along.dot(s.x.translation());
    EXPECT_LT((s.x.translation() - way * along).norm(), kRounding);
    EXPECT_GE(way, before);
    before = way;
  }
}

// --- every segment -------------------------------------------------------------------------------

template <int N>
struct Tour {
  Segments segments;
  Position<N> start;
};
template <int N>
Tour<N> tour();
template <>
Tour<1> tour<1>() {
  return {{MoveToSpec{{0.05}, 0.5}, SineSpec{0, 0.02, 3.0, 0.4}, HoldSpec{0.1}, MoveToSpec{{-0.01}, 0.3}},
          Position<1>{Eigen::Matrix<double, 1, 1>{0.02}}};
}
template <>
Tour<3> tour<3>() {
  return {
      {SineSpec{2, 0.02, 1.7, 0.4}, MoveToSpec{{0.05, 0.01, 0.02}, 0.5}, HoldSpec{0.1}, SineSpec{1, 0.03, 2.5, 0.7}},
      at(0.02, 0.0, -0.01)};
}
template <>
Tour<6> tour<6>() {
  const Quaterniond turned = Quaterniond{0.4, -0.3, 0.5, 0.7}.normalized();
  return {{MoveToSpec{pose({0.05, 0.01, 0.02}, turned), 0.5}, SineSpec{4, 0.6, 2.3, 0.4}, HoldSpec{0.1},
           MoveToSpec{{0.0, 0.02, 0.0}, 0.4}, SineSpec{0, 0.03, 1.0, 0.3}},
          {Vector3d{0.01, 0.02, 0.03}, Quaterniond{0.9, 0.1, 0.3, -0.2}.normalized()}};
}

template <int N>
Path<N> path() {
  const Tour<N> t = tour<N>();
  return {t.segments, t.start};
}
double duration_s(const SegmentSpec& spec) {
  return std::visit([](const auto& s) { return s.duration_s; }, spec);
}

template <class Size>
class AnyPath : public ::testing::Test {};
TYPED_TEST_SUITE(AnyPath, test::Sizes, test::SizeName);

TYPED_TEST(AnyPath, StartsWhereItIsTold) {
  constexpr int N = TypeParam::value;
  EXPECT_EQ(apart<N>(path<N>().at(0.0).x, tour<N>().start), 0.0);
}

TYPED_TEST(AnyPath, DoesNotJumpFromSegmentToSegment) {
  constexpr int N = TypeParam::value;
  double t = 0.0;
  for (const SegmentSpec& spec : tour<N>().segments) {
    t += duration_s(spec);
    const auto before = sample<N>(path<N>(), t * (1 - 1e-15)), after = sample<N>(path<N>(), t * (1 + 1e-15));
    EXPECT_LT(apart<N>(before.x, after.x), 1e-13) << "at " << t << " s";  // 1e-15 s at up to 9 rad/s, and rounding
  }
}

TYPED_TEST(AnyPath, MovesAsFastAsItSays) {
  constexpr int N = TypeParam::value;
  // Central differences within the segments, of up to 9 rad/s. Their error: the third derivative, up to 2e3 rad/s³,
  // times h²/6, and the rounding of an attitude, 1e-15, over h.
  constexpr double h = 1e-6;
  double start = 0.0;
  for (const SegmentSpec& spec : tour<N>().segments) {
    const double end = start + duration_s(spec);
    for (int k = 0; k < 50; ++k) {
      const double t = start + 2 * h + (end - start - 4 * h) * k / 49;
      const auto before = sample<N>(path<N>(), t - h), now = sample<N>(path<N>(), t),
                 after = sample<N>(path<N>(), t + h);
      const Eigen::Matrix<double, N, 1> v = ((after.x - now.x).vec() - (before.x - now.x).vec()) / (2 * h);
      EXPECT_LT((v - now.v.vec()).norm(), 5e-9) << "at " << t << " s";
    }
    start = end;
  }
}

TYPED_TEST(AnyPath, HoldsStillAfterItsEnd) {
  constexpr int N = TypeParam::value;
  Path<N> whole = path<N>();
  double end = 0.0;
  for (const SegmentSpec& spec : tour<N>().segments) end += duration_s(spec);
  EXPECT_NEAR(whole.end_s(), end, kRounding);
  const auto last = whole.at(end), later = whole.at(end + 1.0), much_later = whole.at(1e6);
  EXPECT_EQ(apart<N>(last.x, later.x), 0.0);
  EXPECT_EQ(apart<N>(last.x, much_later.x), 0.0);
  EXPECT_EQ(later.v.vec().norm(), 0.0);
}

TYPED_TEST(AnyPath, WithoutSegmentsHoldsItsStart) {
  constexpr int N = TypeParam::value;
  Path<N> none{{}, tour<N>().start};
  EXPECT_EQ(none.end_s(), 0.0);
  EXPECT_EQ(apart<N>(none.at(0.0).x, tour<N>().start), 0.0);
  EXPECT_EQ(apart<N>(none.at(5.0).x, tour<N>().start), 0.0);
  EXPECT_EQ(none.at(6.0).v.vec().norm(), 0.0);
}

// --- hold ----------------------------------------------------------------------------------------

TEST(Hold, StaysWhereTheLastSegmentEnded) {
  const Path<3> way{{MoveToSpec{{0.1, 0, 0}, 0.5}, HoldSpec{0.5}, MoveToSpec{{0.2, 0, 0}, 0.5}}, at(0, 0, 0)};
  for (const double t : {0.5, 0.7, 0.999}) {
    EXPECT_EQ(apart(sample(way, t).x, at(0.1, 0, 0)), 0.0);
    EXPECT_EQ(sample(way, t).v.vec().norm(), 0.0);
  }
  EXPECT_GT(sample(way, 1.25).x.translation().x(), 0.14);
}

TEST(Hold, AtTheEndIsRest) {
  const Path<1> moves{{MoveToSpec{{0.1}, 0.5}}, Position<1>{}},
      holds{{MoveToSpec{{0.1}, 0.5}, HoldSpec{1.0}, HoldSpec{2.0}}, Position<1>{}};
  EXPECT_EQ(holds.end_s(), moves.end_s());
  EXPECT_EQ(holds.end_s(), 0.5);
  std::vector<double> ends_s;
  for (const SegmentTimes& each : holds.segment_times()) ends_s.push_back(each.end_s);
  EXPECT_EQ(ends_s, (std::vector<double>{0.5, 1.5, 3.5}));
}

// --- sine ----------------------------------------------------------------------------------------

TEST(Sine, SwingsAboutThePointWhereItStarts) {
  const Path<3> way{{MoveToSpec{{0.03, 0.01, 0.0}, 1.0}, SineSpec{1, 0.04, 0.5, 4.0}}, at(0, 0, 0)};
  const auto start = sample(way, 1.0), top = sample(way, 1.5), back = sample(way, 2.0), bottom = sample(way, 2.5);
  EXPECT_LT(apart(start.x, at(0.03, 0.01, 0)), kRounding);
  EXPECT_NEAR(start.v[1], 0.04 * kPi, kRounding);
  EXPECT_LT(apart(top.x, at(0.03, 0.05, 0)), kRounding);
  EXPECT_NEAR(top.v[1], 0.0, kRounding);
  EXPECT_LT(apart(back.x, at(0.03, 0.01, 0)), kRounding);
  EXPECT_LT(apart(bottom.x, at(0.03, -0.03, 0)), kRounding);
}

TEST(Sine, EndsWhereItIsWhenItsTimeIsUp) {
  // A quarter of a period: what follows starts at the crest.
  const Path<1> way{{SineSpec{0, 0.04, 0.5, 0.5}, MoveToSpec{{0.0}, 1.0}}, Position<1>{}};
  EXPECT_NEAR(sample(way, 0.5).x.translation()[0], 0.04, kRounding);
  EXPECT_NEAR(sample(way, 1.0).x.translation()[0], 0.02, kRounding);
}

// --- attitudes -----------------------------------------------------------------------------------

TEST(MoveToOfAPose, TurnsAboutOneAxisWithTheSameProfile) {
  const Quaterniond from{Eigen::AngleAxisd{0.4, Vector3d::UnitX()}};
  const Vector3d axis = Vector3d{1.0, -2.0, 2.0} / 3.0;
  const Quaterniond to = Quaterniond{Eigen::AngleAxisd{1.2, axis}} * from;  // 1.2 rad in world axes
  const Path<6> way{{MoveToSpec{pose({0.1, 0, 0}, to), 2.0}}, {Vector3d::Zero(), from}};
  const auto quarter = sample(way, 0.5), middle = sample(way, 1.0), end = sample(way, 2.0);
  const double s = 0.25, share = s * s * s * (10 - 15 * s + 6 * s * s);
  const auto turned = [&](const Position<6>& x) { return rotation_vector(x.attitude() * from.conjugate()); };
  EXPECT_LT((turned(quarter.x) - 1.2 * share * axis).norm(), kRounding);
  EXPECT_NEAR(quarter.x.translation().x(), 0.1 * share, kRounding);
  EXPECT_LT((turned(middle.x) - 0.6 * axis).norm(), kRounding);
  EXPECT_LT((middle.v.vec().tail<3>() - 1.875 * 1.2 / 2.0 * axis).norm(), kRounding);
  EXPECT_LT((turned(end.x) - 1.2 * axis).norm(), kRounding);
}

TEST(MoveToOfAPose, TakesTheShorterWayRound) {
  const Quaterniond to{Eigen::AngleAxisd{1.5 * kPi, Vector3d::UnitZ()}};  // or a quarter turn back
  const Path<6> way{{MoveToSpec{pose(Vector3d::Zero(), to), 1.0}}, Position<6>{}};
  EXPECT_NEAR(rotation_vector(sample(way, 0.5).x.attitude()).z(), -kPi / 4, kRounding);
  EXPECT_NEAR(sample(way, 0.5).v[5], -1.875 * kPi / 2, kRounding);
}

TEST(MoveToOfAPose, KeepsTheAttitudeWhenOnlyAPointIsGiven) {
  const Quaterniond from = Quaterniond{0.4, -0.3, 0.5, 0.7}.normalized();
  const Path<6> way{{MoveToSpec{{0.1, 0, 0}, 1.0}}, {Vector3d::Zero(), from}};
  for (const double t : {0.0, 0.3, 1.0, 2.0}) {
    EXPECT_LT(rotation_vector(sample(way, t).x.attitude() * from.conjugate()).norm(), kRounding);
    EXPECT_LT(sample(way, t).v.vec().tail<3>().norm(), kRounding);
  }
}

TEST(SineOfAnAttitude, TurnsAboutAWorldAxisThroughWhereItStarts) {
  const Quaterniond from{Eigen::AngleAxisd{0.7, Vector3d::UnitX()}};
  const Path<6> way{{SineSpec{5, 0.3, 1.0, 1.0}}, {Vector3d{0.1, 0.2, 0.3}, from}};
  const auto crest = sample(way, 0.25);
  EXPECT_LT((rotation_vector(crest.x.attitude() * from.conjugate()) - 0.3 * Vector3d::UnitZ()).norm(), kRounding);
  EXPECT_EQ(crest.x.translation(), Vector3d(0.1, 0.2, 0.3));
  EXPECT_NEAR(sample(way, 0.0).v[5], 0.3 * 2 * kPi, kRounding);
}

// --- screw ---------------------------------------------------------------------------------------

TEST(Screw, GoesToAndFroAboutAnAxisAndAlongIt) {
  // A quarter turn to either side about a line along z through (0.1, 0, 0), and 20 mm along it.
  const Path<3> way{{ScrewSpec{{0.1, 0, 0}, {0, 0, 1}, kPi / 2, 0.02, 0.5, 4.0}}, at(0.15, 0, 0.01)};
  EXPECT_LT(apart(sample(way, 0.0).x, at(0.15, 0, 0.01)), kRounding);
  EXPECT_LT(apart(sample(way, 0.5).x, at(0.1, 0.05, 0.03)), kRounding);
  EXPECT_LT(apart(sample(way, 1.5).x, at(0.1, -0.05, -0.01)), kRounding);
  EXPECT_LT((sample(way, 0.0).v.vec() - kPi * Vector3d(0, 0.05 * kPi / 2, 0.02)).norm(), kRounding);
  EXPECT_LT(apart(sample(way, 9.0).x, at(0.15, 0, 0.01)), kRounding);
}

TEST(Screw, WithoutAnAngleIsASineAlongItsAxis) {
  const Path<3> screw{{ScrewSpec{{5, 6, 7}, {0, 1, 0}, 0.0, 0.04, 0.5, 4.0}}, at(0.03, 0.01, 0)};
  const Path<3> sine{{SineSpec{1, 0.04, 0.5, 4.0}}, at(0.03, 0.01, 0)};
  for (const double t : {0.0, 0.3, 1.1, 3.9}) {
    EXPECT_LT(apart(sample(screw, t).x, sample(sine, t).x), kRounding);
    EXPECT_LT((sample(screw, t).v.vec() - sample(sine, t).v.vec()).norm(), kRounding);
  }
}

TEST(Screw, TurnsAPoseAlong) {
  const Quaterniond from{Eigen::AngleAxisd{0.7, Vector3d::UnitX()}};
  const Vector3d axis = Vector3d{1.0, -2.0, 2.0} / 3.0;
  const Path<6> way{{ScrewSpec{{0.1, 0, 0}, {1.0 / 3, -2.0 / 3, 2.0 / 3}, 0.4, 0.02, 1.0, 1.0}},
                    {Vector3d{0.1, 0.2, 0.3}, from}};
  const double t = 0.05, h = 1e-5;
  const auto now = sample(way, t);
  const double share = std::sin(2 * kPi * t);
  EXPECT_LT((rotation_vector(now.x.attitude() * from.conjugate()) - 0.4 * share * axis).norm(), kRounding);
  // Central difference: error (2π h)²/6 of the velocity, and rounding 1e-16/h.
  const Eigen::Matrix<double, 6, 1> difference = (sample(way, t + h).x - sample(way, t - h).x).vec() / (2 * h);
  EXPECT_LT((now.v.vec() - difference).norm(), 1e-8);
}

// --- tremor --------------------------------------------------------------------------------------

constexpr TremorSpec kShaking{0.15e-3, 2.0, 12.0};

TEST(TremorOfAHand, HasTheRmsAndTheBandThatTheSceneSays) {
  // Sinusoids of equal size, one in each eighth of the band: rms of the velocity is that of position times their mean
  // square frequency, which lies between those of the lower and the upper edges of the eighths. Over 1000 s what two
  // sinusoids closer than 0.1 Hz do to each other's mean stays below 1/(2π 0.1 Hz 1000 s) = 0.2 % of a sum of eight.
  double lower = 0.0, upper = 0.0;
  for (int j = 0; j < 8; ++j) {
    lower += std::pow(2.0 + 1.25 * j, 2) / 8;
    upper += std::pow(3.25 + 1.25 * j, 2) / 8;
  }
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const Tremor<3> tremor{kShaking, seed};
    Vector3d x2 = Vector3d::Zero(), v2 = x2;
    constexpr int kSamples = 100'000;
    for (int k = 0; k < kSamples; ++k) {
      const auto s = tremor.at(0.01 * k);
      x2 += s.x.vec().cwiseAbs2() / kSamples;
      v2 += s.v.vec().cwiseAbs2() / kSamples;
    }
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(std::sqrt(x2[axis]), 0.15e-3, 0.02 * 0.15e-3);
      const double mean_square_hz = v2[axis] / x2[axis] / (4 * kPi * kPi);
      EXPECT_GT(mean_square_hz, 0.96 * lower);
      EXPECT_LT(mean_square_hz, 1.04 * upper);
    }
  }
}

TEST(TremorOfAHand, MovesAsItsVelocitySays) {
  const Tremor<3> tremor{kShaking, 1};
  const double h = 1e-5;  // central difference: (2π 12 Hz h)²/6 = 1e-7 of 10 mm/s
  for (const double t : {0.0, 0.7, 33.3})
    EXPECT_LT((tremor.at(t).v.vec() - (tremor.at(t + h).x - tremor.at(t - h).x).vec() / (2 * h)).norm(), 1e-8);
}

TEST(TremorOfAHand, IsDrawnFromTheSeedAlone) {
  const Tremor<3> one{kShaking, 1}, again{kShaking, 1}, other{kShaking, 2};
  EXPECT_EQ(one.at(0.4).x.vec(), again.at(0.4).x.vec());
  EXPECT_GT((one.at(0.4).x.vec() - other.at(0.4).x.vec()).norm(), 1e-6);
  EXPECT_NE(one.at(0.4).x[0], one.at(0.4).x[1]);
}

TEST(TremorOfAHand, ShakesThePathAndNeverEnds) {
  const Segments way{MoveToSpec{{0.1, 0, 0}, 1.0}};
  const Path<3> steady{way, Position<3>{}}, shaking{way, Position<3>{}, Tremor<3>{kShaking, 1}};
  for (const double t : {0.0, 0.5, 7.0}) {
    const auto a = sample(steady, t), b = sample(shaking, t);
    const auto s = Tremor<3>{kShaking, 1}.at(t);
    EXPECT_EQ((a.x + s.x).translation(), b.x.translation());
    EXPECT_EQ((a.v + s.v).vec(), b.v.vec());
  }
  EXPECT_EQ(steady.end_s(), 1.0);
  EXPECT_EQ(shaking.end_s(), std::numeric_limits<double>::infinity());
}

TEST(TremorOfAHand, LeavesTheAttitudeAlone) {
  const Tremor<6> tremor{kShaking, 1};
  EXPECT_GT(tremor.at(0.4).x.vec().head<3>().norm(), 1e-6);
  EXPECT_EQ(tremor.at(0.4).x.vec().tail<3>(), Vector3d::Zero());
}

}  // namespace
}  // namespace twoport::sim::path_test
