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

/// Writes `text` to `path` whole or not at all. Throws as WholeFile does.
void write_whole(const std::string& path, std::string_view text);

/// A file that appears under its name only when it is complete: written as PATH.partial, renamed by commit(), removed
/// when it is destroyed before. A killed program leaves at most the partial file.
class WholeFile {
 public:
  /// Throws ConfigError with the path and the reason when the file cannot be opened.
  explicit WholeFile(std::string path);
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  /// Does not throw: commit() reports the first error.
  void write(std::string_view text) noexcept;
  /// Throws IoError with the path and the reason when not all of it could be written; then nothing is left.
  void commit();

 private:
  std::string path_;
  std::FILE* file_;
  int error_ = 0;  ///< errno of the first write that failed
};

}  // namespace twoport
