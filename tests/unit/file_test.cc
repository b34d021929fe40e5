#include "common/base/file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <cstddef>
#include <filesystem>
#include <set>
#include <string>

#include "common/base/check.h"
#include "tests/support/folder.h"

namespace twoport::test {
namespace {

/// Why `path` cannot be read; empty if it can.
std::string why_not(const std::string& path, std::size_t most = kLargestFile) {
  try {
    static_cast<void>(read_whole(path, "it", most));
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

TEST(ReadWhole, GivesEveryByte) {
  const Folder folder;
  std::string text(200'000, 'x');
  text[3] = '\0';
  text[100'000] = '\r';
  EXPECT_EQ(read_whole(folder.write("file", text)), text);
  EXPECT_EQ(read_whole(folder.write("empty", "")), "");
}

TEST(ReadWhole, RefusesWhatIsNoRegularFileWithoutWaitingForIt) {
  const Folder folder;
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_EQ(why_not(folder / "pipe"), "it: cannot be read: it is not a regular file");
  EXPECT_EQ(why_not("/dev/zero"), "it: cannot be read: it is not a regular file");
  EXPECT_EQ(why_not(folder / ""), "it: cannot be read: Is a directory");
  EXPECT_EQ(why_not(folder / "none"), "it: cannot be read: No such file or directory");
}

TEST(ReadWhole, RefusesMoreBytesThanStated) {
  const Folder folder;
  const std::string file = folder.write("file", std::string(100'000, 'x'));
  EXPECT_EQ(why_not(file, 100'000), "");
  EXPECT_EQ(why_not(file, 99'999), "it: cannot be read: it is larger than 99999 bytes");
}

TEST(WriteWhole, LeavesTheTextAndNothingElse) {
  const Folder folder;
  write_whole(folder / "summary.json", "first");
  write_whole(folder / "summary.json", "second");
  EXPECT_EQ(read_whole(folder / "summary.json"), "second");
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

TEST(WriteWhole, SaysWhyItCannot) {
  const Folder folder;
  try {
    write_whole(folder / "none/summary.json", "text");
    FAIL() << "it wrote";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, (folder / "none/summary.json") + ": cannot be written: No such file or directory");
  }
  EXPECT_TRUE(folder.names().empty());
}

TEST(WriteWhole, KeepsTheOldFileWhenTheDiskIsFull) {
  const Folder folder;
  write_whole(folder / "summary.json", "old");
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  auto* const handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  bool refused = false;
  try {
    write_whole(folder / "summary.json", std::string(5000, 'x'));
  } catch (const IoError&) {
    refused = true;
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_TRUE(refused);
  EXPECT_EQ(read_whole(folder / "summary.json"), "old");
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

TEST(WriteWhole, LeavesNothingBesideWhenItCannotTakeTheName) {
  const Folder folder;
  std::filesystem::create_directories(folder / "summary.json");
  EXPECT_THROW(write_whole(folder / "summary.json", "text"), IoError);
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

}  // namespace
}  // namespace twoport::test
