#pragma once

#include <cstddef>
#include <cstdio>
#include <string>
#include <string_view>

namespace twoport {

/// Largest file that is read as a whole [bytes].
inline constexpr std::size_t kLargestFile = std::size_t{64} << 20;

/// The whole content of a regular file of at most `most` bytes. Throws ConfigError with `name` (by default the path) and
/// the reason: the file is missing, no regular file (a directory, a pipe, a device), or larger.
std::string read_whole(const std::string& path, std::string_view name = {}, std::size_t most = kLargestFile);

/// "UTF-16", "UTF-32" where the content begins as a text in it does, with a byte order mark or without; else empty.
std::string_view wide_encoding(std::string_view content);

/// read_whole() of a text file. Refuses one in UTF-16 or UTF-32, and one with a byte 0.
std::string read_text(const std::string& path, std::string_view name = {});

/// Writes `text` to `path` whole or not at all. Throws as WholeFile does.
void write_whole(const std::string& path, std::string_view text);

/// A file that appears under its name only when it is complete: written as PATH.partial, renamed by commit(), removed
/// when it is destroyed before. A killed program leaves at most the partial file.
class WholeFile {
 public:
  /// Makes a missing folder. Throws ConfigError with the path and the reason when the file cannot be opened.
  explicit WholeFile(std::string path);
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  /// Does not throw: commit() reports the first error. After that nothing more is written.
  void write(std::string_view text) noexcept;
  /// Throws IoError with the path and the reason when not all of it could be written; then nothing is left.
  void commit();
  /// The same for a table of a header and rows, one a line, of which a beginning is worth keeping: the rows that could be
  /// written are left under the name, less the last kRoom bytes, which leaves room for a summary beside it. IoError then says
  /// how many are missing.
  void commit_rows();

  static constexpr std::size_t kRoom = 64 << 10;

 private:
  void close() noexcept;
  /// Cuts the partial file to whole lines. Returns their number; 0: nothing can be kept.
  std::size_t keep_lines() const;
  [[noreturn]] void fail() const;

  std::string path_;
  std::FILE* file_;
  int error_ = 0;          ///< errno of the first write that failed
  std::size_t lines_ = 0;  ///< that were to be written
};

/// Opens a file to be written anew, for this program alone, in a folder that is made if it is missing; one of an earlier run is renamed (earlier_file()). ConfigError where it
/// is in use (take_shared, or here), or begins otherwise than `magic`: nothing of another kind is touched.
std::FILE* take_file(const std::string& path, std::string_view magic);
/// While `file` is open, take_file refuses it.
void take_shared(std::FILE* file) noexcept;

/// Takes a folder for this program until its end: throws ConfigError with `name` where another one has taken it.
class FolderLock {
 public:
  FolderLock(const std::string& folder, std::string_view name);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int fd_;
};

/// A regular file that is not empty.
bool has_content(const std::string& path);
/// PATH~: the name that take_file gives to a file of an earlier run.
std::string earlier_file(const std::string& path);

}  // namespace twoport
