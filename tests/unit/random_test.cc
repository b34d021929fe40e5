#include "common/base/random.h"

#include <gtest/gtest.h>

#include <bitset>
#include <cmath>
#include <cstdint>

namespace twoport {
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

// Φ(z) = p to 4e-16 of p below one half: what erfc of the C library itself is good for, times the condition number.
TEST(Random, InvertsTheNormalDistribution) {
  for (double p : {1e-300, 1e-100, 1e-30, 1e-12, 1e-6, 1e-3, 0.02, 0.07, 0.0750001, 0.2, 0.4, 0.5}) {
    const double z = Random::normal_quantile(p);
    const double condition = 1.0 + z * z;
    EXPECT_NEAR(0.5 * std::erfc(-z / std::sqrt(2.0)) / p, 1.0, 1e-15 * condition) << p;
    if (p > 1e-12) {
      EXPECT_NEAR(Random::normal_quantile(1.0 - p), -z, 1e-15 / p) << p;
    }
  }
}

TEST(Random, NormalNumbersHaveTheMomentsOfANormal) {
  const Random random{kSeed};
  double mean = 0.0, second = 0.0, fourth = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    const double z = random.normal(i);
    mean += z / kDraws;
    second += z * z / kDraws;
    fourth += z * z * z * z / kDraws;
  }
  EXPECT_NEAR(mean, 0.0, 5.0 * std::sqrt(1.0 / kDraws));
  EXPECT_NEAR(second, 1.0, 5.0 * std::sqrt(2.0 / kDraws));
  EXPECT_NEAR(fourth, 3.0, 5.0 * std::sqrt(96.0 / kDraws));
}

}  // namespace
}  // namespace twoport
