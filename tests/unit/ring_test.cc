#include "common/base/ring.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <thread>

#include "tests/support/no_alloc.h"

namespace twoport::ring_test {
namespace {

/// Wide enough to be seen half written.
struct Row {
  std::array<std::uint64_t, 8> words{};
};
Row row(std::uint64_t k) {
  Row r;
  r.words.fill(k);
  return r;
}

TEST(Ring, KeepsOrder) {
  Ring<int> ring{4};
  int out = 0;
  EXPECT_FALSE(ring.try_pop(out));
  for (int k = 0; k < 100; ++k) {
    ASSERT_TRUE(ring.try_push(2 * k));
    ASSERT_TRUE(ring.try_push(2 * k + 1));
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out, 2 * k);
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out, 2 * k + 1);
  }
  EXPECT_FALSE(ring.try_pop(out));
}

TEST(Ring, DropsTheNewestWhenFullAndCountsIt) {
  Ring<int> ring{3};
  ASSERT_EQ(ring.capacity(), 4U);
  for (int k = 0; k < 7; ++k) EXPECT_EQ(ring.try_push(k), k < 4);
  EXPECT_EQ(ring.dropped(), 3U);
  int out = -1;
  for (int k = 0; k < 4; ++k) {
    ASSERT_TRUE(ring.try_pop(out));
    EXPECT_EQ(out, k);
  }
  EXPECT_FALSE(ring.try_pop(out));
  EXPECT_TRUE(ring.try_push(9));
  EXPECT_EQ(ring.dropped(), 3U);
}

TEST(Ring, DoesNotAllocate) {
  Ring<Row> ring{64};
  Row out;
  const NoAlloc guard;
  for (std::uint64_t k = 0; k < 1000; ++k) {
    ring.try_push(row(k));
    if (k % 3 != 0) ring.try_pop(out);
  }
  EXPECT_EQ(guard.seen(), 0);
}

TEST(Ring, HandsRowsWholeAndInOrderFromThreadToThread) {
  constexpr std::uint64_t kRows = 200'000;
  Ring<Row> ring{16};
  std::thread producer{[&] {
    for (std::uint64_t k = 1; k <= kRows;) {
      if (ring.try_push(row(k)))
        ++k;
      else
        std::this_thread::yield();
    }
  }};
  std::uint64_t expected = 1, torn = 0, astray = 0;
  Row out;
  while (expected <= kRows) {
    if (!ring.try_pop(out)) {
      std::this_thread::yield();
      continue;
    }
    for (std::uint64_t w : out.words) torn += w != out.words[0];
    astray += out.words[0] != expected;
    ++expected;
  }
  producer.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_EQ(astray, 0U);
}

TEST(Ring, LosesNothingUncounted) {
  constexpr std::uint64_t kRows = 100'000;
  Ring<Row> ring{8};
  std::atomic<bool> done{false};
  std::thread producer{[&] {
    for (std::uint64_t k = 1; k <= kRows; ++k) ring.try_push(row(k));
    done.store(true, std::memory_order_release);
  }};
  std::uint64_t got = 0, last = 0, backwards = 0;
  Row out;
  for (bool last_round = false;;) {
    while (ring.try_pop(out)) {
      ++got;
      backwards += out.words[0] <= last;
      last = out.words[0];
    }
    if (last_round) break;
    last_round = done.load(std::memory_order_acquire);
    std::this_thread::yield();
  }
  producer.join();
  EXPECT_EQ(backwards, 0U);
  EXPECT_EQ(got + ring.dropped(), kRows);
}

}  // namespace
}  // namespace twoport::ring_test
