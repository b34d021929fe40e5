#include "common/platform/key_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "tests/support/folder.h"

namespace twoport::key_file_test {
namespace {

class KeyFile : public ::testing::Test {
 protected:
  std::string write(const std::string& text, mode_t mode = 0600) {
    std::ofstream{path} << text;
    ::chmod(path.c_str(), mode);
    return path;
  }
  /// The sentence that reading is refused with; empty: it is not.
  static std::string refusal(const std::string& of) {
    try {
      read_key_file(of);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return {};
  }
  static bool has(const std::string& text, const std::string& part) { return text.find(part) != text.npos; }

  test::Folder folder;
  std::string path = folder / "key", digits = "6b1f0c9ad2e7435891bb03f4a76e2dc538e0174f5ca92b86d47a10ef6539c2fF";
};

TEST_F(KeyFile, ThatIsMadeIsReadAndNoTwoAreTheSame) {
  const std::string other = folder / "other";
  const mode_t before = ::umask(0);
  make_key_file(path);
  ::umask(0777);
  make_key_file(other);
  ::umask(before);
  const Key a = read_key_file(path), b = read_key_file(other);
  EXPECT_NE(a.bytes(), b.bytes());
  EXPECT_EQ(a.bytes(), read_key_file(path).bytes());
  struct stat about {};
  for (const std::string& made : {path, other}) {
    ASSERT_EQ(::stat(made.c_str(), &about), 0);
    EXPECT_EQ(about.st_mode & 07777, 0600U);
    EXPECT_EQ(about.st_size, 65);
  }
}

TEST_F(KeyFile, IsNeverOverwritten) {
  make_key_file(path);
  const Key::Bytes before = read_key_file(path).bytes();
  EXPECT_THROW(make_key_file(path), ConfigError);
  EXPECT_EQ(read_key_file(path).bytes(), before);
  const std::string link = folder / "link";
  std::filesystem::create_symlink(folder / "not-there", link);
  EXPECT_THROW(make_key_file(link), ConfigError) << "not through a link either";
  EXPECT_THROW(make_key_file(folder / "no/such/folder"), ConfigError);
}

TEST_F(KeyFile, HoldsSixtyFourDigits) {
  write(digits + "\n");
  EXPECT_EQ(read_key_file(path).bytes()[31], 0xff);
  EXPECT_EQ(refusal(write(digits)), "");
  for (const std::string& wrong : {std::string{}, digits.substr(1), digits + "0", digits + "\n\n", digits + " ",
                                   "g" + digits.substr(1), digits + "\n" + std::string(100, '0')})
    EXPECT_TRUE(has(refusal(write(wrong)), "64 hexadecimal digits")) << wrong;
}

TEST_F(KeyFile, IsNoPattern) {
  std::string counting, halves, seven, eight;
  for (int i = 0; i < 32; ++i) {
    const auto add = [](std::string& to, int byte) {
      to += "0123456789abcdef"[byte / 16 % 16];
      to += "0123456789abcdef"[byte % 16];
    };
    add(counting, 0xf0 + 3 * i), add(halves, i % 2 ? 0xab : 0xcd), add(seven, 37 * (i * i % 7)), add(eight, i * i % 37);
  }
  for (const std::string& weak :
       {std::string(64, '0'), std::string(64, 'f'), std::string(64, '7'), counting, halves, seven})
    EXPECT_TRUE(has(refusal(write(weak)), "is no secret")) << weak;
  EXPECT_EQ(refusal(write(eight)), "");
}

TEST_F(KeyFile, IsReadableByItsOwnerOnly) {
  for (const mode_t mode : {0640U, 0604U, 0660U, 0644U, 0620U, 0601U})
    EXPECT_TRUE(has(refusal(write(digits, mode)), "chmod 600")) << mode;
  EXPECT_EQ(refusal(write(digits, 0400)), "");
}

TEST_F(KeyFile, IsARegularFileOfThisUserOrRoot) {
  EXPECT_TRUE(has(refusal(folder / "missing"), "No such file"));
  write(digits);
  const std::string link = folder / "link", pipe = folder / "pipe";
  std::filesystem::create_symlink(path, link);
  EXPECT_TRUE(has(refusal(link), "symbolic link"));
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_TRUE(has(refusal(pipe), "regular file"));
  EXPECT_TRUE(has(refusal(folder / ""), "regular file"));
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a file away";
  ASSERT_EQ(::chown(path.c_str(), 12345, 12345), 0);
  EXPECT_TRUE(has(refusal(path), "belongs to user 12345"));
}

/// A folder of keys.
class KeyFolder : public KeyFile {
 protected:
  KeyFolder() { std::filesystem::create_directory(keys); }
  void add(const std::string& name) const { make_key_file(keys + '/' + name); }
  [[nodiscard]] std::string refusal(bool several = true) const {
    try {
      read_keys(keys, several);
    } catch (const ConfigError& e) {
      return e.what();
    }
    return {};
  }
  std::string keys = folder / "keys";
};

TEST_F(KeyFolder, HoldsAKeyForEachDeviceByName) {
  for (const char* name : {"right", "left", ".hidden"}) add(name);
  const KeyList list = read_keys(keys, true);
  EXPECT_EQ(list.names, (std::vector<std::string>{".hidden", "left", "right"}));
  ASSERT_EQ(list.keys.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(list.keys[i].bytes(), read_key_file(keys + '/' + list.names[i]).bytes());
  const KeyList one = read_keys(keys + "/left", true);
  EXPECT_EQ(one.names, std::vector<std::string>{"left"});
  EXPECT_EQ(one.keys.at(0).bytes(), list.keys[1].bytes());
  EXPECT_TRUE(has(refusal(false), "a master has one key"));
}

TEST_F(KeyFolder, HoldsBetweenOneAndSixtyFourDifferentKeys) {
  EXPECT_TRUE(has(refusal(), "is an empty folder"));
  for (std::size_t i = 0; i < kMostKeys; ++i) add("key" + std::to_string(i));
  EXPECT_EQ(read_keys(keys, true).keys.size(), 64U);
  add("one-more");
  EXPECT_TRUE(has(refusal(), "allowed are 64 keys"));
  std::filesystem::remove(keys + "/one-more");
  std::filesystem::remove(keys + "/key63");
  std::filesystem::copy_file(keys + "/key7", keys + "/copy");
  EXPECT_TRUE(has(refusal(), "copy and key7 are the same key"));
}

TEST_F(KeyFolder, IsRefusedWhereAnyOfItIsNoKeyOrOthersMayChangeIt) {
  add("good");
  ::chmod(keys.c_str(), 0770);
  EXPECT_TRUE(has(refusal(), "lets others change who may come; chmod go-w"));
  ::chmod(keys.c_str(), 0755);
  EXPECT_EQ(refusal(), "");
  std::ofstream{keys + "/notes.txt"} << "who has which";
  EXPECT_TRUE(has(refusal(), "/notes.txt: mode"));
  ::chmod((keys + "/notes.txt").c_str(), 0600);
  EXPECT_TRUE(has(refusal(), "/notes.txt: is no key"));
  std::filesystem::remove(keys + "/notes.txt");
  std::filesystem::create_directory(keys + "/more");
  EXPECT_TRUE(has(refusal(), "/more: is not a regular file"));
  std::filesystem::remove(keys + "/more");
  std::filesystem::create_symlink(keys + "/good", keys + "/link");
  EXPECT_TRUE(has(refusal(), "/link: is a symbolic link"));
  std::filesystem::remove(keys + "/link");
  add("two\nlines");
  EXPECT_TRUE(has(refusal(), "control characters"));
  EXPECT_THROW(read_keys(keys + "/two\nlines", true), ConfigError);
  std::filesystem::remove(keys + "/two\nlines");
  EXPECT_EQ(refusal(), "");
  const std::string link = folder / "link";
  std::filesystem::create_directory_symlink(keys, link);
  EXPECT_THROW(read_keys(link, true), ConfigError);
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a folder away";
  ASSERT_EQ(::chown(keys.c_str(), 12345, 12345), 0);
  EXPECT_TRUE(has(refusal(), "belongs to user 12345"));
}

}  // namespace
}  // namespace twoport::key_file_test
