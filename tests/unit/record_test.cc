#include "common/secure/record.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/no_alloc.h"

namespace twoport::record_test {
namespace {

using Bytes = std::vector<std::byte>;

RecordKeys keys(std::uint8_t first = 1) {
  RecordKeys k;
  for (auto& b : k.key) b = first++;
  for (auto& b : k.iv) b = first++;
  return k;
}
Bytes bytes_of(std::span<const std::byte> from) {
  return {from.begin(), from.end()};
}
Bytes message(std::size_t size, std::uint8_t fill = 7) {
  return Bytes(size, std::byte{fill});
}

/// Records of `count` messages, the i-th filled with i.
std::vector<Bytes> sealed(int count, std::size_t size = 64) {
  Sealer sealer{keys()};
  std::vector<Bytes> records;
  for (int i = 0; i < count; ++i) records.push_back(bytes_of(sealer.seal(message(size, static_cast<std::uint8_t>(i)))));
  return records;
}
Opened open(Opener& opener, const Bytes& record) {
  std::span<const std::byte> plain;
  return opener.open(record, plain);
}

TEST(Record, IsOpenedWithTheKeyItWasSealedWith) {
  Sealer sealer{keys()};
  Opener opener{keys()};
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1}, std::size_t{300}, kMaxDatagramBytes - kRecordOverhead}) {
    const Bytes plain = message(size);
    const Bytes record = bytes_of(sealer.seal(plain));
    ASSERT_EQ(record.size(), size + kRecordOverhead);
    if (size >= 300) {
      EXPECT_EQ(std::search(record.begin(), record.end(), plain.begin(), plain.begin() + 16), record.end())
          << "in plain text";
    }
    std::span<const std::byte> opened;
    ASSERT_EQ(opener.open(record, opened), Opened::ok);
    EXPECT_EQ(bytes_of(opened), plain);
  }
  EXPECT_TRUE(sealer.seal(message(kMaxDatagramBytes - kRecordOverhead + 1)).empty());
}

TEST(Record, OfAnotherKeyIsNotOpened) {
  Opener opener{keys(2)};
  EXPECT_EQ(open(opener, sealed(1)[0]), Opened::not_authentic);
}

TEST(Record, ThatWasChangedInAnyBitIsNotOpened) {
  const Bytes record = sealed(1, 20)[0];
  Opener opener{keys()};
  for (std::size_t bit = 0; bit < 8 * record.size(); ++bit) {
    Bytes changed = record;
    changed[bit / 8] ^= std::byte{1} << (bit % 8);
    EXPECT_NE(open(opener, changed), Opened::ok) << "bit " << bit;
  }
  EXPECT_EQ(open(opener, record), Opened::ok) << "what was changed has not used the number up";
}

TEST(Record, ThatIsCutOrLengthenedIsNotOpened) {
  const Bytes record = sealed(1, 20)[0];
  Opener opener{keys()};
  for (std::size_t size = 0; size < record.size(); ++size)
    EXPECT_EQ(open(opener, {record.begin(), record.begin() + static_cast<std::ptrdiff_t>(size)}), Opened::malformed);
  Bytes longer = record;
  longer.push_back(std::byte{0});
  EXPECT_EQ(open(opener, longer), Opened::malformed);
  longer.resize(1500);
  EXPECT_EQ(open(opener, longer), Opened::malformed);
}

TEST(Record, IsOpenedOnceInAnyOrderWithinTheWindow) {
  std::vector<Bytes> records = sealed(2 * static_cast<int>(Opener::kWindow));
  Opener opener{keys()};
  // Blocks shorter than the window, each from its end, every record twice.
  constexpr std::size_t kBlock = 2000;
  int opened = 0, replayed = 0;
  for (std::size_t from = 0; from < records.size(); from += kBlock) {
    const std::size_t end = std::min(from + kBlock, records.size());
    for (std::size_t i = end; i > from; --i)
      for (int copy = 0; copy < 2; ++copy) {
        const Opened result = open(opener, records[i - 1]);
        opened += result == Opened::ok, replayed += result == Opened::replayed;
      }
  }
  EXPECT_EQ(opened, static_cast<int>(records.size()));
  EXPECT_EQ(replayed, static_cast<int>(records.size()));
  EXPECT_EQ(open(opener, records[0]), Opened::stale);
}

TEST(Record, AgreesWithASetOfWhatHasBeenOpened) {
  const std::vector<Bytes> records = sealed(20'000, 8);
  Opener opener{keys()};
  std::vector<bool> seen(records.size());
  std::mt19937 random{1};
  std::size_t newest = 0, front = 0;
  bool any = false;
  for (int k = 0; k < 60'000; ++k) {
    front = std::min(records.size() - 1, front + random() % 3);
    const std::size_t back = random() % (random() % 4 == 0 ? 6000 : 300);
    const std::size_t i = front > back ? front - back : 0;
    const Opened expected = any && i + Opener::kWindow <= newest ? Opened::stale
                            : seen[i]                            ? Opened::replayed
                                                                 : Opened::ok;
    ASSERT_EQ(open(opener, records[i]), expected) << i << " behind " << newest;
    seen[i] = true, newest = std::max(newest, i), any = true;
  }
}

TEST(Sealer, UsesNoNumberTwiceAndEndsBeforeTheyRepeat) {
  Sealer sealer{keys(), (std::uint64_t{1} << 48) - 2};
  const Bytes first = bytes_of(sealer.seal(message(4))), second = bytes_of(sealer.seal(message(4)));
  EXPECT_FALSE(first.empty());
  EXPECT_FALSE(second.empty());
  EXPECT_NE(first, second);
  EXPECT_TRUE(sealer.seal(message(4)).empty());
}

TEST(Record, DoesNotAllocate) {
  Sealer sealer{keys()};
  Opener opener{keys()};
  const Bytes plain = message(300);
  std::span<const std::byte> opened;
  const NoAlloc guard;
  for (int k = 0; k < 1000; ++k) {
    const auto record = sealer.seal(plain);
    opener.open(record, opened);
    opener.open(record, opened);
    opener.open(plain, opened);
  }
  EXPECT_EQ(guard.seen(), 0);
}

/// How often bytes stand in the heap; they are given with every bit flipped.
std::size_t copies_in_heap(std::span<const std::uint8_t, 32> flipped) {
  std::array<std::uint8_t, 32> wanted;
  std::transform(flipped.begin(), flipped.end(), wanted.begin(), [](auto b) { return static_cast<std::uint8_t>(~b); });
  std::ifstream maps{"/proc/self/maps"};
  std::size_t copies = 0;
  for (std::string line; std::getline(maps, line);) {
    if (!line.ends_with("[heap]")) continue;
    std::size_t dash = 0;
    const std::size_t begin = std::stoull(line, &dash, 16), end = std::stoull(line.substr(dash + 1), nullptr, 16);
    const auto* at = reinterpret_cast<const std::uint8_t*>(begin);
    const auto* const last = reinterpret_cast<const std::uint8_t*>(end);
    while ((at = std::search(at, last, wanted.begin(), wanted.end())) != last) ++copies, ++at;
  }
  return copies;
}

TEST(Record, KeysAreWipedWithWhatHoldsThem) {
  std::array<std::uint8_t, 32> flipped;
  for (std::size_t i = 0; i < flipped.size(); ++i) flipped[i] = static_cast<std::uint8_t>(i * i + 7);
  const auto pair = [&] {
    RecordKeys keys;
    std::transform(flipped.begin(), flipped.end(), keys.key.begin(),
                   [](auto b) { return static_cast<std::uint8_t>(~b); });
    return std::make_unique<std::pair<Sealer, Opener>>(Sealer{keys}, Opener{keys});
  };
  auto held = pair();
  if (copies_in_heap(flipped) == 0) GTEST_SKIP() << "the heap is elsewhere";
  EXPECT_EQ(copies_in_heap(flipped), 2U);
  held.reset();
  EXPECT_EQ(copies_in_heap(flipped), 0U);
}

}  // namespace
}  // namespace twoport::record_test
