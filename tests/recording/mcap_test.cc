#include <gtest/gtest.h>
#include <sys/resource.h>
#include <zstd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/mcap/bytes.h"
#include "tests/recording/rewrite.h"
#include "tests/support/folder.h"

// The container: written, read, torn, damaged, and on a full disk.
namespace twoport::test::mcap_test {
namespace {

constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};

/// Message i is "i" and 100 bytes that do not compress, at i ms.
std::string content(int i) {
  std::string bytes = std::to_string(i);
  std::uint64_t random = static_cast<std::uint64_t>(i);
  for (int k = 0; k < 100; ++k)
    bytes.push_back(static_cast<char>((random = random * 6364136223846793005 + 1442695040888963407) >> 56));
  return bytes;
}
constexpr std::uint64_t at_ns(int i) {
  return static_cast<std::uint64_t>(i) * 1'000'000;
}

/// Expects the first messages of the file at `path`, and returns how many there are.
int expect_messages(const std::string& path, bool torn) {
  const Messages m = read_messages(path);
  EXPECT_EQ(m.torn, torn);
  for (std::size_t i = 0; i < m.all.size(); ++i) {
    EXPECT_EQ(m.all[i].topic, "/numbers");
    EXPECT_EQ(m.all[i].log_time_ns, at_ns(static_cast<int>(i)));
    EXPECT_EQ(m.all[i].data, content(static_cast<int>(i)));
  }
  return static_cast<int>(m.all.size());
}

TEST(Mcap, WhatIsWrittenIsReadInOrder) {
  const Folder folder;
  const std::string path = folder / "a.mcap";
  mcap::Writer file{path, "test"};
  const auto channel = file.add_channel("/numbers", "Number", "descriptors", {{"unit", "m"}});
  for (int i = 0; i < 5000; ++i) file.write(channel, at_ns(i), content(i));
  file.close();
  EXPECT_EQ(expect_messages(path, false), 5000);
  const mcap::Channel c = read_messages(path).channels.at("/numbers");
  EXPECT_EQ(c.schema, "Number");
  EXPECT_EQ(c.descriptors, "descriptors");
  EXPECT_EQ(c.metadata, (mcap::Metadata{{"unit", "m"}}));
}

TEST(Mcap, TheFileIsWholeAfterEveryFlush) {
  const Folder folder;
  const std::string path = folder / "a.mcap";
  mcap::Writer file{path, "test"};
  const auto channel = file.add_channel("/numbers", "Number", "", {});
  int written = 0;
  for (int flushes = 0; flushes < 20; ++flushes) {
    for (int i = 0; i < 100; ++i, ++written) file.write(channel, at_ns(written), content(written));
    file.flush();
    const std::string bytes = bytes_of(path);  // as a killed program leaves it
    EXPECT_TRUE(bytes.ends_with(kMagic)) << flushes;
    EXPECT_EQ(expect_messages(path, false), written);
  }
}

TEST(Mcap, FlushesByItselfEveryHalfSecondOfLogTime) {
  const Folder folder;
  const std::string path = folder / "a.mcap";
  mcap::Writer file{path, "test"};
  const auto channel = file.add_channel("/numbers", "Number", "", {});
  for (int i = 0; i < 10000; ++i) file.write(channel, at_ns(i), content(i));
  const int there = expect_messages(path, false);
  EXPECT_GE(there, 9400);
  EXPECT_LT(there, 10000);
}

TEST(Mcap, ATornFileIsReadUpToTheChunkBefore) {
  const Folder folder;
  const std::string path = folder / "a.mcap", torn = folder / "torn.mcap";
  std::vector<std::pair<std::uint64_t, int>> chunks;  // size of the file without its end, messages until then
  {
    mcap::Writer file{path, "test"};
    const auto channel = file.add_channel("/numbers", "Number", "", {});
    for (int i = 0; i < 1000; ++i) {
      file.write(channel, at_ns(i), content(i));
      if (i % 100 != 99) continue;
      file.flush();
      chunks.emplace_back(file.size(), i + 1);
    }
  }
  const std::string whole = bytes_of(path);
  for (std::size_t size = 100; size < chunks.back().first; size += 61) {
    std::ofstream{torn, std::ios::binary}.write(whole.data(), static_cast<std::streamsize>(size));
    const int there = expect_messages(torn, true);
    int at_least = 0;
    for (const auto& [end, messages] : chunks)
      if (end <= size) at_least = messages;
    ASSERT_GE(there, at_least) << size;
    ASSERT_LE(there, at_least + 100) << size;
  }
}

TEST(Mcap, ADamagedChunkIsRefusedInASentence) {
  const Folder folder;
  const std::string path = folder / "a.mcap", damaged = folder / "damaged.mcap";
  {
    mcap::Writer file{path, "test"};
    const auto channel = file.add_channel("/numbers", "Number", "", {});
    for (int i = 0; i < 1000; ++i) file.write(channel, at_ns(i), content(i));
  }
  std::string bytes = bytes_of(path);
  const std::size_t middle = bytes.size() / 3;  // of the first chunk's content
  bytes[middle] = static_cast<char>(bytes[middle] ^ 1);
  std::ofstream{damaged, std::ios::binary} << bytes;
  try {
    read_messages(damaged);
    FAIL() << "read";
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find(damaged + ": a chunk is damaged"), std::string::npos) << e.what();
  }
  std::ofstream{damaged, std::ios::binary} << "PK\3\4 something else";
  try {
    read_messages(damaged);
    FAIL() << "read";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, damaged + ": it is no MCAP file");
  }
}

// 60 schemas of 32 MiB each in a file of 60 kB: what is kept has a bound, and the reader stops there.
TEST(Mcap, DefinitionsThatWouldTakeGigabytesAreRefused) {
  const Folder folder;
  const std::string path = folder / "a.mcap";
  {
    // A record begins with its kind and its length, the content of a schema with its number.
    constexpr std::size_t kNumber = 1 + sizeof(std::uint64_t);
    mcap::Output schema, record;
    schema.number(std::uint16_t{0}).string("S").string("protobuf").string(std::string(std::size_t{32} << 20, 'x'));
    record.record(mcap::Op::schema, schema);
    std::string body(ZSTD_compressBound(record.bytes.size()), 0);
    std::ofstream out{path, std::ios::binary};
    out << kMagic;
    for (char id = 1; id <= 60; ++id) {
      record.bytes[kNumber] = id;
      const std::size_t size = ZSTD_compress(body.data(), body.size(), record.bytes.data(), record.bytes.size(), 1);
      mcap::Output chunk, file;
      chunk.number(std::uint64_t{0}).number(std::uint64_t{0}).number(std::uint64_t{record.bytes.size()});
      chunk.number(std::uint32_t{0}).string("zstd").number(std::uint64_t{size}).raw({body.data(), size});
      file.record(mcap::Op::chunk, chunk);
      out << file.bytes;
    }
  }
  EXPECT_LT(std::filesystem::file_size(path), 1'000'000u);
  rusage before{}, after{};
  getrusage(RUSAGE_SELF, &before);
  try {
    read_messages(path);
    FAIL() << "read";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, path + ": its schemas and channels are longer than 67108864 bytes");
  }
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 200 * 1024) << "KiB";
}

// A limit of the file's size acts as a full disk does: write() fails in the middle of a chunk.
TEST(Mcap, AFullDiskIsSaidAndWhatWasWrittenStaysReadable) {
  const Folder folder;
  const std::string path = folder / "a.mcap";
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  rlimit little = before;
  little.rlim_cur = 100'000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &little), 0);
  std::string said;
  {
    mcap::Writer file{path, "test"};
    const auto channel = file.add_channel("/numbers", "Number", "", {});
    for (int i = 0; i < 5000; ++i) {
      file.write(channel, at_ns(i), content(i));
      if (i % 50 == 49) file.flush();
    }
    EXPECT_FALSE(file.error().empty());
    try {
      file.close();
    } catch (const IoError& e) {
      said = e.what();
    }
  }
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(said, path + ": cannot be written: File too large");
  EXPECT_TRUE(bytes_of(path).ends_with(kMagic));
  const int there = expect_messages(path, false);
  EXPECT_GT(there, 500);
  EXPECT_EQ(there % 50, 0);
  EXPECT_LE(std::filesystem::file_size(path), 100'000u);
}

TEST(Mcap, AFolderThatCannotBeMadeIsRefused) {
  EXPECT_THROW(mcap::Writer("/dev/null/a.mcap", "test"), ConfigError);
}

}  // namespace
}  // namespace twoport::test::mcap_test
