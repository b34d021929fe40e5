#include "common/base/file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "common/base/check.h"

namespace twoport {
namespace {

std::string partial(const std::string& path) {
  return path + ".partial";
}

/// The folder that a file is to be in. What hinders it, opening the file says.
void make_folder_of(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(std::filesystem::path{path}.parent_path(), error);
}

std::string reason(int error) {
  return std::generic_category().message(error);
}

}  // namespace

std::string read_whole(const std::string& path, std::string_view name, std::size_t most) {
  const auto fail = [&](const std::string& why) -> ConfigError {
    return ConfigError{std::string{name.empty() ? path : name} + ": cannot be read: " + why};
  };
  // Checked before opening: opening a pipe waits for its writer.
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (error) throw fail(error.message());
  if (std::filesystem::is_directory(status)) throw fail(reason(EISDIR));
  if (!std::filesystem::is_regular_file(status)) throw fail("it is not a regular file");

  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(path.c_str(), "rb"), std::fclose};
  if (!file) throw fail(reason(errno));
  std::string text;
  std::array<char, 65536> chunk;
  for (std::size_t n; (n = std::fread(chunk.data(), 1, chunk.size(), file.get())) > 0;) {
    text.append(chunk.data(), n);
    if (text.size() > most) throw fail("it is larger than " + std::to_string(most) + " bytes");
  }
  if (std::ferror(file.get()) != 0) throw fail(reason(errno));
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);  // the byte order mark that Windows programs write
  return text;
}
std::string_view wide_encoding(std::string_view text) {
  using namespace std::string_view_literals;
  const auto begins = [&](auto... marks) { return (text.starts_with(marks) || ...); };
  if (begins("\xFF\xFE\0\0"sv, "\0\0\xFE\xFF"sv)) return "UTF-32";
  if (begins("\xFF\xFE"sv, "\xFE\xFF"sv)) return "UTF-16";
  // Without a mark: of a text that begins with characters of ASCII every second byte is 0, or three of four.
  if (text.size() < 4) return {};
  const auto zero = [&](std::size_t i) { return text[i] == '\0'; };
  const int zeros = zero(0) + zero(1) + zero(2) + zero(3);
  if (zeros == 3 && (!zero(0) || !zero(3))) return "UTF-32";
  if (zeros == 2 && zero(0) == zero(2)) return "UTF-16";
  return {};
}

std::string read_text(const std::string& path, std::string_view name) {
  std::string text = read_whole(path, name);
  const std::string of{name.empty() ? path : name};
  if (const std::string_view encoding = wide_encoding(text); !encoding.empty())
    throw ConfigError{of + ": is in " + std::string{encoding} + "; save it as UTF-8"};
  if (const std::size_t at = text.find('\0'); at != text.npos)
    throw ConfigError{of + ": byte " + std::to_string(at + 1) + " is 0; it must be a text in UTF-8"};
  return text;
}

void write_whole(const std::string& path, std::string_view text) {
  WholeFile file{path};
  file.write(text);
  file.commit();
}

WholeFile::WholeFile(std::string path) : path_{std::move(path)}, file_{nullptr} {
  // It would take the place of a device or a pipe.
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path_, error);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status) &&
      !std::filesystem::is_directory(status))
    throw ConfigError{path_ + ": cannot be written: it is not a regular file"};
  make_folder_of(path_);
  file_ = std::fopen(partial(path_).c_str(), "wb");
  if (file_ == nullptr) throw ConfigError{path_ + ": cannot be written: " + reason(errno)};
}

WholeFile::~WholeFile() {
  if (file_ == nullptr) return;
  std::fclose(file_);
  std::remove(partial(path_).c_str());
}

void WholeFile::write(std::string_view text) noexcept {
  lines_ += static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  if (error_ == 0 && std::fwrite(text.data(), 1, text.size(), file_) != text.size()) error_ = errno;
}

void WholeFile::close() noexcept {
  if (std::fclose(std::exchange(file_, nullptr)) != 0 && error_ == 0) error_ = errno;
}

void WholeFile::fail() const {
  std::remove(partial(path_).c_str());
  throw IoError{path_ + ": cannot be written: " + reason(error_)};
}

void WholeFile::commit() {
  close();
  if (error_ == 0 && std::rename(partial(path_).c_str(), path_.c_str()) != 0) error_ = errno;
  if (error_ != 0) fail();
}

void WholeFile::commit_rows() {
  if (error_ == 0 && std::fflush(file_) != 0) error_ = errno;
  if (error_ == 0) return commit();
  close();
  const std::size_t kept = keep_lines();
  if (kept < 2 || std::rename(partial(path_).c_str(), path_.c_str()) != 0) fail();
  throw IoError{path_ + ": its last " + std::to_string(lines_ - kept) + " of " + std::to_string(lines_ - 1) +
                " rows cannot be written: " + reason(error_)};
}

std::size_t WholeFile::keep_lines() const {
  const std::string path = partial(path_);
  std::error_code error;
  if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(path, error))) return 0;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(path.c_str(), "rb"), std::fclose};
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (!file || error || size <= kRoom) return 0;
  std::size_t lines = 0;
  std::uintmax_t end = 0, at = 0;
  std::array<char, 65536> chunk;
  for (std::size_t n; at < size - kRoom && (n = std::fread(chunk.data(), 1, chunk.size(), file.get())) > 0; at += n)
    for (std::size_t i = 0; i < n && at + i < size - kRoom; ++i)
      if (chunk[i] == '\n') ++lines, end = at + i + 1;
  std::filesystem::resize_file(path, end, error);
  return error ? 0 : lines;
}

bool has_content(const std::string& path) {
  std::error_code error;
  return std::filesystem::is_regular_file(path, error) && std::filesystem::file_size(path, error) > 0 && !error;
}

std::string earlier_file(const std::string& path) {
  return path + "~";
}

namespace {

/// ConfigError where the file that a recording's predecessor would replace is not one, or is in use.
void check_replaceable(const std::string& path, const std::string& earlier, std::string_view magic) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(earlier.c_str(), "rbe"), std::fclose};
  if (!file) return;
  if (::flock(::fileno(file.get()), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw ConfigError{path + ": " + earlier + ", which it would replace, is read or written now; give another name"};
  std::string begin(magic.size(), '\0');
  begin.resize(std::fread(begin.data(), 1, begin.size(), file.get()));
  if (!begin.empty() && begin != magic)
    throw ConfigError{path + ": " + earlier + ", which it would replace, is no recording; give another name"};
}

}  // namespace

std::FILE* take_file(const std::string& path, std::string_view magic) {
  make_folder_of(path);
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOCTTY, 0666);
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{fd < 0 ? nullptr : ::fdopen(fd, "r+b"), std::fclose};
  if (!file) throw ConfigError{path + ": cannot be written: " + reason(errno)};
  struct stat about {};
  // Reading what is there would wait for its writer.
  if ((::fstat(fd, &about) == 0 && S_ISFIFO(about.st_mode)) || ::isatty(fd) != 0)
    throw ConfigError{path + ": cannot be written: it is a pipe or a terminal; give the name of a file"};
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw ConfigError{path + ": is read or written now; give another name"};
  std::string begin(magic.size(), '\0');
  const std::size_t n = std::fread(begin.data(), 1, begin.size(), file.get());
  if (n > 0 && begin.substr(0, n) != magic.substr(0, n))
    throw ConfigError{path + ": is there already, and is no recording; give another name"};
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::symlink_status(path, error);
  if (n == magic.size() && std::filesystem::is_symlink(status))
    throw ConfigError{path + ": is a link to an earlier recording; give another name"};
  if (n == magic.size() && std::filesystem::is_regular_file(status)) {
    check_replaceable(path, earlier_file(path), magic);
    // Locked meanwhile, so that no other program takes it for its own.
    if (std::rename(path.c_str(), earlier_file(path).c_str()) != 0)
      throw ConfigError{path + ": of an earlier run cannot be renamed: " + reason(errno)};
    file.reset();
    return take_file(path, magic);
  }
  std::rewind(file.get());
  // A device has no length.
  if (::ftruncate(fd, 0) != 0 && errno != EINVAL) throw ConfigError{path + ": cannot be written: " + reason(errno)};
  return file.release();
}

void take_shared(std::FILE* file) noexcept {
  ::flock(::fileno(file), LOCK_SH | LOCK_NB);
}

FolderLock::FolderLock(const std::string& folder, std::string_view name)
    : fd_{::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)} {
  // File systems without locks take none.
  if (fd_ < 0 || ::flock(fd_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
  ::close(fd_);
  throw ConfigError{std::string{name} + " " + folder +
                    ": another program writes there now; give each program a folder of its own"};
}

FolderLock::~FolderLock() {
  if (fd_ >= 0) ::close(fd_);
}

}  // namespace twoport
