#include "common/base/file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>

#include "common/base/check.h"
#include "tests/support/folder.h"

namespace twoport::test::file_test {
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

TEST(ReadWhole, LeavesOutAByteOrderMark) {
  const Folder folder;
  EXPECT_EQ(read_whole(folder.write("file", "\xEF\xBB\xBF\xEF\xBB\xBFtext")), "\xEF\xBB\xBFtext");
  EXPECT_EQ(read_whole(folder.write("file", "\xEF\xBBtext")), "\xEF\xBBtext");
}

// What PowerShell's > writes.
TEST(ReadText, RefusesUtf16AndBytesThatAreNoText) {
  const Folder folder;
  const auto refusal = [&](const std::string& text) -> std::string {
    const std::string file = folder.write("file", text);
    try {
      return read_text(file, "it");
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  using namespace std::string_literals;
  EXPECT_EQ(refusal("\xFF\xFE"
                    "5\0\n\0"s),
            "it: is in UTF-16; save it as UTF-8");
  EXPECT_EQ(refusal("\xFE\xFF\0"
                    "5"s),
            "it: is in UTF-16; save it as UTF-8");
  EXPECT_EQ(refusal("5\0\n\0"s), "it: is in UTF-16; save it as UTF-8");
  EXPECT_EQ(refusal("\0"
                    "5\0\n"s),
            "it: is in UTF-16; save it as UTF-8");
  for (const std::string& wide : {"\xFF\xFE\0\0"
                                  "5\0\0\0"s,
                                  "\0\0\xFE\xFF\0\0\0"
                                  "5"s,
                                  "5\0\0\0"s,
                                  "\0\0\0"
                                  "5"s})
    EXPECT_EQ(refusal(wide), "it: is in UTF-32; save it as UTF-8");
  EXPECT_EQ(refusal("5\n6\0"s), "it: byte 4 is 0; it must be a text in UTF-8");
  EXPECT_EQ(refusal("\xEF\xBB\xBF"
                    "5\n"s),
            "5\n");
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

TEST(WriteWhole, MakesTheFolder) {
  const Folder folder;
  write_whole(folder / "a/b/summary.json", "text");
  EXPECT_EQ(read_whole(folder / "a/b/summary.json"), "text");
}

TEST(WriteWhole, SaysWhyItCannot) {
  const Folder folder;
  try {
    write_whole(folder / "file", "text");
    write_whole(folder / "file/summary.json", "text");
    FAIL() << "it wrote";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, (folder / "file/summary.json") + ": cannot be written: Not a directory");
  }
  EXPECT_EQ(folder.names(), std::set<std::string>{"file"});
}

/// While it exists no file grows beyond `bytes`.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_{std::signal(SIGXFSZ, SIG_IGN)} {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int);
};

TEST(WriteWhole, KeepsTheOldFileWhenTheDiskIsFull) {
  const Folder folder;
  write_whole(folder / "summary.json", "old");
  bool refused = false;
  {
    const FullDisk full{1000};
    try {
      write_whole(folder / "summary.json", std::string(5000, 'x'));
    } catch (const IoError&) {
      refused = true;
    }
  }
  EXPECT_TRUE(refused);
  EXPECT_EQ(read_whole(folder / "summary.json"), "old");
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

// 300,000 rows of 10 bytes on a disk that has room for 1 MB.
TEST(WriteRows, KeepsWholeRowsWhenTheDiskIsFullAndSaysHowManyAreMissing) {
  const Folder folder;
  constexpr std::size_t kBytes = 1'000'003, kRows = 300'000;
  std::string why;
  {
    const FullDisk full{kBytes};
    WholeFile file{folder / "trace.csv"};
    file.write("a header of another length\n");
    for (std::size_t k = 0; k < kRows; ++k) file.write(std::to_string(100'000'000 + k) + "\n");
    try {
      file.commit_rows();
    } catch (const IoError& e) {
      why = e.what();
    }
  }
  const std::string text = read_whole(folder / "trace.csv");
  const std::size_t kept = (text.size() - 27) / 10;
  EXPECT_EQ(text.size(), 27 + 10 * kept) << "whole rows";
  EXPECT_GE(text.size(), kBytes - WholeFile::kRoom - 10);
  EXPECT_LE(text.size(), kBytes - WholeFile::kRoom) << "room for the summary";
  EXPECT_EQ(text.substr(text.size() - 10), std::to_string(100'000'000 + kept - 1) + "\n")
      << "the first rows, without a gap";
  EXPECT_EQ(why, (folder / "trace.csv") + ": its last " + std::to_string(kRows - kept) +
                     " of 300000 rows cannot be written: File too large");
  EXPECT_EQ(folder.names(), std::set<std::string>{"trace.csv"});
}

TEST(WriteRows, LeavesNothingWhereNoRowCanBeKept) {
  const Folder folder;
  {
    const FullDisk full{1000};
    WholeFile file{folder / "trace.csv"};
    for (int k = 0; k < 1000; ++k) file.write("a row\n");
    EXPECT_THROW(file.commit_rows(), IoError);
  }
  EXPECT_TRUE(folder.names().empty());
  WholeFile whole{folder / "trace.csv"};
  whole.write("header\nrow\n");
  whole.commit_rows();
  EXPECT_EQ(read_whole(folder / "trace.csv"), "header\nrow\n");
}

TEST(FolderLock, IsForOneProgramAtATime) {
  const Folder folder;
  {
    const FolderLock first{folder / "", "--out"};
    try {
      const FolderLock second{folder / "", "--out"};
      FAIL() << "two have it";
    } catch (const ConfigError& e) {
      EXPECT_EQ(std::string{e.what()},
                "--out " + (folder / "") + ": another program writes there now; give each program a folder of its own");
    }
  }
  const FolderLock again{folder / "", "--out"};
  EXPECT_TRUE(folder.names().empty());
}

TEST(TakeFile, RenamesAnEarlierOneOfItsKindAndTakesNothingThatIsInUse) {
  const Folder folder;
  const auto why = [&](const std::string& path) -> std::string {
    try {
      std::fclose(take_file(path, "magic"));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  const std::string path = folder / "a";
  EXPECT_EQ(why(path), "");
  std::FILE* const first = take_file(path, "magic");
  std::fputs("magic and more", first);
  EXPECT_EQ(why(path), path + ": is read or written now; give another name");
  std::fclose(first);
  std::FILE* const reader = std::fopen(path.c_str(), "rb");
  take_shared(reader);
  EXPECT_EQ(why(path), path + ": is read or written now; give another name");
  EXPECT_EQ(read_whole(path), "magic and more");
  std::fclose(reader);
  EXPECT_EQ(why(path), "");
  EXPECT_EQ(read_whole(path), "");
  EXPECT_EQ(read_whole(earlier_file(path)), "magic and more");
  EXPECT_EQ(why(path), "") << "an empty one is taken as it is";
  EXPECT_EQ(read_whole(earlier_file(path)), "magic and more");
  const std::string scene = folder.write("scene", "dof: 1");
  EXPECT_EQ(why(scene), scene + ": is there already, and is no recording; give another name");
  EXPECT_EQ(read_whole(scene), "dof: 1");
}

TEST(TakeFile, DoesNotWaitForTheWriterOfAPipe) {
  const Folder folder;
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  try {
    std::fclose(take_file(pipe, "magic"));
    FAIL() << "taken";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, pipe + ": cannot be written: it is a pipe or a terminal; give the name of a file");
  }
}

TEST(WriteWhole, LeavesNothingBesideWhenItCannotTakeTheName) {
  const Folder folder;
  std::filesystem::create_directories(folder / "summary.json");
  EXPECT_THROW(write_whole(folder / "summary.json", "text"), IoError);
  EXPECT_EQ(folder.names(), std::set<std::string>{"summary.json"});
}

}  // namespace
}  // namespace twoport::test::file_test
