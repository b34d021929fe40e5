#include "common/base/histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "tests/support/no_alloc.h"

namespace twoport::histogram_test {
namespace {

using namespace std::chrono_literals;

TEST(Histogram, IsEmptyAtFirst) {
  const Histogram h;
  EXPECT_EQ(h.count(), 0U);
  EXPECT_EQ(h.percentile(0.5), 0ns);
  EXPECT_EQ(h.max(), 0ns);
}

TEST(Histogram, GivesOneValueBackAtEveryPercentile) {
  for (std::int64_t ns : {0L, 1L, 127L, 128L, 255L, 256L, 12'345L, 1'000'000'007L, (1L << 40) - 1}) {
    Histogram h;
    h.add(Duration{ns});
    for (double p : {0.001, 0.5, 1.0})
      EXPECT_NEAR(static_cast<double>(h.percentile(p).count()), static_cast<double>(ns),
                  0.004 * static_cast<double>(ns))
          << p;
    EXPECT_EQ(h.max(), Duration{ns});
  }
}

TEST(Histogram, IsExactBelow256ns) {
  Histogram h;
  for (int ns = 0; ns < 256; ++ns) h.add(Duration{ns});
  for (int ns = 0; ns < 256; ++ns) EXPECT_EQ(h.percentile((ns + 1) / 256.0), Duration{ns});
}

TEST(Histogram, IsWithinHalfAPercentOfTheSortedValues) {
  std::mt19937_64 rng{20240611};
  std::lognormal_distribution<double> lateness{std::log(2e4), 2.0};
  Histogram h;
  std::vector<std::int64_t> all;
  for (int k = 0; k < 100'000; ++k) {
    all.push_back(std::llround(lateness(rng)));
    h.add(Duration{all.back()});
  }
  std::sort(all.begin(), all.end());
  for (double p : {0.01, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(all.size())));
    const auto exact = static_cast<double>(all[rank - 1]);
    EXPECT_NEAR(static_cast<double>(h.percentile(p).count()), exact, 0.004 * exact + 0.5) << "p = " << p;
  }
  EXPECT_EQ(h.max(), Duration{all.back()});
  EXPECT_EQ(h.count(), all.size());
}

TEST(Histogram, TakesWhatIsOutOfRangeAsTheNearest) {
  Histogram h;
  h.add(-5ns);
  EXPECT_EQ(h.percentile(1.0), 0ns);
  h.add(Duration::max());
  EXPECT_EQ(h.max(), Duration{(1L << 40) - 1});
  EXPECT_EQ(h.percentile(0.5), 0ns);
  EXPECT_EQ(h.count(), 2U);
}

TEST(Histogram, DoesNotAllocate) {
  const auto h = std::make_unique<Histogram>();
  const NoAlloc guard;
  for (int k = 0; k < 1000; ++k) h->add(Duration{k * 1000});
  EXPECT_GT(h->percentile(0.99), 0ns);
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::histogram_test
