#include "common/platform/key_file.h"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <strings.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/algorithm/hex.hpp>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <memory>
#include <string_view>
#include <utility>

#include "common/base/check.h"

namespace twoport {
namespace {

constexpr std::size_t kDigits = 2 * Key::kSize;
constexpr mode_t kOthers = 077, kOthersWrite = 022;

/// A descriptor that is closed in any case.
struct File {
  int fd;
  explicit File(int f) : fd{f} {}
  ~File() {
    if (fd >= 0) ::close(fd);
  }
  File(const File&) = delete;
};

/// Bytes that are wiped in any case.
template <std::size_t Size>
struct Secret {
  std::array<char, Size> bytes{};
  ~Secret() { explicit_bzero(bytes.data(), Size); }
};

/// Bytes that somebody has typed: fewer than 8 different ones, or each a step from the one before. Of random keys one in 10^29.
bool follows_a_pattern(const std::array<char, Key::kSize>& key) {
  std::array<bool, 256> occurs{};
  std::size_t different = 0;
  bool steps = true;
  for (std::size_t i = 0; i < key.size(); ++i) {
    bool& here = occurs[static_cast<unsigned char>(key[i])];
    if (!std::exchange(here, true)) ++different;
    if (i > 1) steps = steps && ((key[i] - key[i - 1]) & 0xff) == ((key[1] - key[0]) & 0xff);
  }
  return different < 8 || steps;
}

void check_owner(const struct stat& about, const std::string& path) {
  if (about.st_uid != ::geteuid() && about.st_uid != 0)
    throw ConfigError{fmt::format("--key {}: belongs to user {}; allowed are this user ({}) and root", path,
                                  about.st_uid, ::geteuid())};
}

/// The file `name` in an open folder, `path` in messages.
Key read_key(int folder, const char* name, const std::string& path) {
  const auto refuse = [&](const std::string& why) { return ConfigError{fmt::format("--key {}: {}", path, why)}; };
  // Without O_NONBLOCK, opening a pipe waits for its writer.
  const File file{::openat(folder, name, O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK)};
  if (file.fd < 0) {
    if (errno == ELOOP) throw refuse("is a symbolic link; give the file itself");
    throw refuse(fmt::format("cannot be opened: {}; twoport-keygen FILE makes a key", std::strerror(errno)));
  }
  struct stat about {};
  if (::fstat(file.fd, &about) != 0) throw refuse(std::strerror(errno));
  if (!S_ISREG(about.st_mode)) throw refuse("is not a regular file");
  check_owner(about, path);
  if ((about.st_mode & kOthers) != 0)
    throw refuse(fmt::format("mode {:04o} lets others at the key; chmod 600 {}", about.st_mode & 07777, path));

  Secret<kDigits + 2> text;
  std::size_t size = 0;
  while (size < text.bytes.size()) {
    const ssize_t n = ::read(file.fd, text.bytes.data() + size, text.bytes.size() - size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw refuse(fmt::format("cannot be read: {}", std::strerror(errno)));
    if (n == 0) break;
    size += static_cast<std::size_t>(n);
  }
  const bool ended = size == kDigits || (size == kDigits + 1 && text.bytes[kDigits] == '\n');
  const auto is_digit = [](unsigned char c) { return std::isxdigit(c) != 0; };
  if (!ended || !std::all_of(text.bytes.begin(), text.bytes.begin() + kDigits, is_digit))
    throw refuse("is no key: allowed are 64 hexadecimal digits and one end of line; twoport-keygen FILE makes one");
  Secret<Key::kSize> key;
  boost::algorithm::unhex(text.bytes.begin(), text.bytes.begin() + kDigits, key.bytes.begin());
  if (follows_a_pattern(key.bytes))
    throw refuse("is no secret: its bytes repeat or count; allowed are random ones, as twoport-keygen FILE makes them");
  Key::Bytes bytes;
  std::memcpy(bytes.data(), key.bytes.data(), bytes.size());
  Key out{bytes};
  explicit_bzero(bytes.data(), bytes.size());
  return out;
}

/// Names of the entries of an open folder, sorted; at most one more than there may be keys.
std::vector<std::string> entries(int folder, const std::string& path) {
  const std::unique_ptr<DIR, int (*)(DIR*)> listing{::fdopendir(::fcntl(folder, F_DUPFD_CLOEXEC, 0)), ::closedir};
  if (!listing) throw ConfigError{fmt::format("--key {}: cannot be read: {}", path, std::strerror(errno))};
  std::vector<std::string> names;
  while (const dirent* const entry = ::readdir(listing.get()))
    if (const std::string_view name{entry->d_name}; name != "." && name != ".." && names.size() <= kMostKeys)
      names.emplace_back(name);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace

Key read_key_file(const std::string& path) {
  return read_key(AT_FDCWD, path.c_str(), path);
}

KeyList read_keys(const std::string& path, bool several) {
  const auto refuse = [&](const std::string& why) { return ConfigError{fmt::format("--key {}: {}", path, why)}; };
  KeyList list;
  const File folder{::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_DIRECTORY)};
  const auto has_control = [](std::string_view name) {
    return std::any_of(name.begin(), name.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; });
  };
  if (folder.fd < 0) {
    list.keys.push_back(read_key_file(path));
    list.names.push_back(path.substr(path.rfind('/') + 1));
    if (has_control(list.names.back())) throw refuse("its name has control characters");
    return list;
  }
  if (!several) throw refuse("is a folder; a master has one key: give its file");
  struct stat about {};
  if (::fstat(folder.fd, &about) != 0) throw refuse(std::strerror(errno));
  check_owner(about, path);
  if ((about.st_mode & kOthersWrite) != 0)
    throw refuse(
        fmt::format("mode {:04o} lets others change who may come; chmod go-w {}", about.st_mode & 07777, path));
  list.names = entries(folder.fd, path);
  if (list.names.empty()) throw refuse(fmt::format("is an empty folder; twoport-keygen {}/NAME makes a key", path));
  if (list.names.size() > kMostKeys)
    throw refuse(fmt::format("has more than {} files; allowed are {} keys", kMostKeys, kMostKeys));
  list.keys.reserve(list.names.size());
  for (const std::string& name : list.names) {
    if (has_control(name)) throw refuse(fmt::format("the name of the file {} has control characters", name));
    Key key = read_key(folder.fd, name.c_str(), path + '/' + name);
    const auto same =
        std::find_if(list.keys.begin(), list.keys.end(), [&](const Key& k) { return k.bytes() == key.bytes(); });
    if (same != list.keys.end())
      throw refuse(fmt::format("{} and {} are the same key; every device needs its own",
                               list.names[static_cast<std::size_t>(same - list.keys.begin())], name));
    list.keys.push_back(std::move(key));
  }
  return list;
}

void make_key_file(const std::string& path) {
  Secret<Key::kSize> key;
  if (::getrandom(key.bytes.data(), Key::kSize, 0) != static_cast<ssize_t>(Key::kSize))
    throw IoError{fmt::format("the system has no random numbers: {}", std::strerror(errno))};
  Secret<kDigits + 1> text;
  boost::algorithm::hex_lower(key.bytes.begin(), key.bytes.end(), text.bytes.begin());
  text.bytes[kDigits] = '\n';

  const File file{::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600)};
  if (file.fd < 0) {
    if (errno == EEXIST) throw ConfigError{path + ": exists already; a key is never overwritten, choose another name"};
    throw ConfigError{fmt::format("{}: cannot be made: {}", path, std::strerror(errno))};
  }
  std::signal(SIGXFSZ, SIG_IGN);  // `ulimit -f`: the write fails, and no half key is left
  // The mode that was asked for, whatever the umask.
  const bool written =
      ::fchmod(file.fd, 0600) == 0 &&
      ::write(file.fd, text.bytes.data(), text.bytes.size()) == static_cast<ssize_t>(text.bytes.size()) &&
      ::fsync(file.fd) == 0;
  if (written) return;
  const int error = errno;
  ::unlink(path.c_str());
  throw IoError{fmt::format("{}: cannot be written: {}", path, std::strerror(error))};
}

}  // namespace twoport
