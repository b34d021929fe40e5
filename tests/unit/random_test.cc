#include "common/base/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/base/normal.h"

namespace twoport::random_test {
namespace {

constexpr std::uint64_t kSeed = 20;
constexpr int kDraws = 200'000;

// Written down once: every recorded result depends on these.
TEST(Random, GivesTheNumbersThatItAlwaysGave) {
  const Random random{1};
  EXPECT_EQ(random.bits(0), 0xdce423fc82c0d5b8U);
  EXPECT_EQ(random.bits(12345, 7), 0xdff0e0b1a1721775U);
  EXPECT_EQ(Random{~std::uint64_t{0}}.bits(~std::uint64_t{0} / 16, 15), 0x2dfe1aa565b7ff81U);
}

TEST(Random, DependsOnSeedIndexAndPurposeAndOnNothingElse) {
  const Random one{1}, same{1}, other{2};
  for (std::uint64_t i = 1000; i-- > 0;) {  // in another order
    ASSERT_EQ(one.bits(i, 3), same.bits(i, 3));
    ASSERT_NE(one.bits(i, 3), other.bits(i, 3));
    ASSERT_NE(one.bits(i, 3), one.bits(i, 4));
    ASSERT_NE(one.bits(i, 3), one.bits(i + 1, 3));
  }
}

// Counts within 5 standard deviations of a binomial: 6e-7 of seeds would fail each.
TEST(Random, FillsEachOf64EqualPartsAlikeAndNeighboursAreIndependent) {
  const Random random{kSeed};
  int part[64] = {}, pair[8][8] = {}, purposes[8][8] = {};
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double u = random.uniform(i), next = random.uniform(i + 1), other = random.uniform(i, 1);
    ASSERT_GT(u, 0.0);
    ASSERT_LT(u, 1.0);
    ++part[static_cast<int>(64 * u)];
    ++pair[static_cast<int>(8 * u)][static_cast<int>(8 * next)];
    ++purposes[static_cast<int>(8 * u)][static_cast<int>(8 * other)];
  }
  const double mean = kDraws / 64.0, deviation = std::sqrt(mean * (1.0 - 1.0 / 64));
  for (int i = 0; i < 64; ++i) {
    EXPECT_NEAR(part[i], mean, 5.0 * deviation) << i;
    EXPECT_NEAR(pair[i / 8][i % 8], mean, 5.0 * deviation) << i;
    EXPECT_NEAR(purposes[i / 8][i % 8], mean, 5.0 * deviation) << i;
  }
}

TEST(Random, ChangesHalfOfTheBitsWhenTheSeedOrTheIndexChangesByOneBit) {
  for (int bit = 0; bit < 60; ++bit) {
    double seed_changes = 0.0, index_changes = 0.0;
    constexpr std::uint64_t kTrials = 1000;
    for (std::uint64_t i = 0; i < kTrials; ++i) {
      const std::uint64_t a = Random{i}.bits(i), flip = std::uint64_t{1} << bit;
      seed_changes += static_cast<double>(std::bitset<64>{a ^ Random{i ^ flip}.bits(i)}.count());
      index_changes += static_cast<double>(std::bitset<64>{a ^ Random{i}.bits(i ^ flip)}.count());
    }
    // Mean of 64 fair bits: 32, deviation 4/√trials; 5 deviations.
    EXPECT_NEAR(seed_changes / kTrials, 32.0, 5.0 * 4.0 / std::sqrt(kTrials)) << bit;
    EXPECT_NEAR(index_changes / kTrials, 32.0, 5.0 * 4.0 / std::sqrt(kTrials)) << bit;
  }
}

double normal_probability(double z) {
  return 0.5 * std::erfc(-z / std::sqrt(2.0));
}

// Written down once, as the bits above: from the part of a layer that needs one hash, from one that needs two, from the tail.
TEST(Normal, GivesTheNumbersThatItAlwaysGave) {
  const Random random{1};
  EXPECT_EQ(normal(random, 0), -0.99312399401170415);
  EXPECT_EQ(normal(random, 76), 0.85948945143542066);
  EXPECT_EQ(normal(random, 880), 3.5455590476817407);
}

TEST(Normal, HasTheMomentsOfANormal) {
  const Random random{kSeed};
  double mean = 0.0, second = 0.0, third = 0.0, fourth = 0.0, sixth = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double z = normal(random, i), z2 = z * z;
    mean += z / kDraws;
    second += z2 / kDraws;
    third += z2 * z / kDraws;
    fourth += z2 * z2 / kDraws;
    sixth += z2 * z2 * z2 / kDraws;
  }
  EXPECT_NEAR(mean, 0.0, 5.0 * std::sqrt(1.0 / kDraws));
  EXPECT_NEAR(second, 1.0, 5.0 * std::sqrt(2.0 / kDraws));
  EXPECT_NEAR(third, 0.0, 5.0 * std::sqrt(15.0 / kDraws));
  EXPECT_NEAR(fourth, 3.0, 5.0 * std::sqrt(96.0 / kDraws));
  EXPECT_NEAR(sixth, 15.0, 5.0 * std::sqrt(10170.0 / kDraws));
}

// Kolmogorov and Smirnov: the largest distance of the two distribution functions times √n is above 2.5 for 7e-6 of seeds.
TEST(Normal, HasTheDistributionOfANormalInTheMiddleAndInTheTails) {
  const Random random{kSeed};
  constexpr int kMore = 20 * kDraws;
  std::vector<double> z(kMore);
  for (int i = 0; i < kMore; ++i) z[static_cast<std::size_t>(i)] = normal(random, static_cast<std::uint64_t>(i));
  std::sort(z.begin(), z.end());
  double most = 0.0;
  for (int i = 0; i < kMore; ++i) {
    const double p = normal_probability(z[static_cast<std::size_t>(i)]);
    most = std::max({most, p - static_cast<double>(i) / kMore, static_cast<double>(i + 1) / kMore - p});
  }
  EXPECT_LT(most * std::sqrt(kMore), 2.5);
  // A layer's edge is at 3.44.
  for (const double from : {2.0, 3.0, 3.4426, 4.0, 4.5}) {
    const double expected = kMore * normal_probability(-from);
    const auto below = std::lower_bound(z.begin(), z.end(), -from) - z.begin();
    const auto above = z.end() - std::upper_bound(z.begin(), z.end(), from);
    EXPECT_NEAR(static_cast<double>(below), expected, 5.0 * std::sqrt(expected) + 1.0) << from;
    EXPECT_NEAR(static_cast<double>(above), expected, 5.0 * std::sqrt(expected) + 1.0) << from;
  }
}

TEST(Normal, NeighboursAndPurposesAreIndependentInSignAndSize) {
  const Random random{kSeed};
  double next = 0.0, purpose = 0.0, next_size = 0.0, purpose_size = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double a = normal(random, i), b = normal(random, i + 1), c = normal(random, i, 1);
    next += a * b, purpose += a * c;
    next_size += (a * a - 1.0) * (b * b - 1.0), purpose_size += (a * a - 1.0) * (c * c - 1.0);
  }
  EXPECT_NEAR(next / kDraws, 0.0, 5.0 / std::sqrt(kDraws));
  EXPECT_NEAR(purpose / kDraws, 0.0, 5.0 / std::sqrt(kDraws));
  EXPECT_NEAR(next_size / kDraws, 0.0, 5.0 * 2.0 / std::sqrt(kDraws));
  EXPECT_NEAR(purpose_size / kDraws, 0.0, 5.0 * 2.0 / std::sqrt(kDraws));
}

}  // namespace
}  // namespace twoport::random_test
