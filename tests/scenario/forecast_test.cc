#include <gtest/gtest.h>

#include "lab/study/many_runs.h"

namespace twoport::lab::forecast_test {
namespace {

/// A study in its own time: runs of a kind take what they take.
struct Study {
  Forecast forecast;
  double now_s = 0.0;
  void run(const char* kind, int count, double cost_s) {
    forecast.begin(kind, now_s);
    for (int i = 0; i < count; ++i) forecast.ran(now_s += cost_s);
  }
};

TEST(Forecast, IsRightFromTheFirstOnWhereTheSamplesAre) {
  Study study{Forecast{130}};
  study.forecast.expect("cheap", 100, 4);
  study.forecast.expect("dear", 30, 2);
  study.run("cheap", 4, 0.1);
  EXPECT_FALSE(study.forecast.left_s()) << "nobody knows what the others cost";
  study.run("dear", 1, 10.0);
  EXPECT_FALSE(study.forecast.left_s());
  study.run("dear", 1, 10.0);
  ASSERT_TRUE(study.forecast.left_s());
  EXPECT_NEAR(*study.forecast.left_s(), 96 * 0.1 + 28 * 10.0, 1e-9);
  study.run("cheap", 96, 0.1);
  EXPECT_NEAR(*study.forecast.left_s(), 280.0, 1e-9);
  study.forecast.drop("dear", 8);
  EXPECT_NEAR(*study.forecast.left_s(), 200.0, 1e-9);
  study.run("dear", 20, 10.0);
  EXPECT_NEAR(*study.forecast.left_s(), 0.0, 1e-9);
}

TEST(Forecast, TakesRunsOfNoKindYetForTheMeanOfOthersAndAddsTheReading) {
  Study study{Forecast{400}};
  study.forecast.read(100, 5.0);
  study.forecast.expect("cheap", 75, 5);
  study.forecast.expect("dear", 25, 5);
  EXPECT_FALSE(study.forecast.left_s());
  study.run("cheap", 75, 0.1);
  study.run("dear", 5, 1.0);
  // Each 100 runs take 7.5 + 25 s and 5 s of reading.
  EXPECT_NEAR(*study.forecast.left_s(), 20.0 + 3 * (7.5 + 25.0 + 5.0), 1e-9);
  // A second round of the same kinds is believed at once.
  study.run("dear", 20, 1.0);
  study.forecast.read(300, 15.0);
  study.forecast.expect("cheap", 225, 5);
  study.forecast.expect("dear", 75, 5);
  EXPECT_NEAR(*study.forecast.left_s(), 3 * (7.5 + 25.0), 1e-9);
}

}  // namespace
}  // namespace twoport::lab::forecast_test
