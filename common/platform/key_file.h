#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/secure/key.h"

namespace twoport {

/// Reads a key: 64 hexadecimal digits and at most one end of line. Throws ConfigError with the path and the reason unless it
/// is a regular file, not a symbolic link, of this user or of root, which nobody else may read or write.
Key read_key_file(const std::string& path);

/// Keys, and the names of their files at the same places.
struct KeyList {
  std::vector<std::string> names;
  std::vector<Key> keys;
};
inline constexpr std::size_t kMostKeys = 64;

/// The key in a file, or, where `several`, those in all files of a folder, by name. Throws ConfigError as read_key_file(), and for a
/// folder that is empty, has more than 64 files or the same key twice, or that others may change, and for a name with control
/// characters.
KeyList read_keys(const std::string& path, bool several);

/// Writes a new key from the system's random generator, readable and writable by its owner only. Throws ConfigError when the
/// file exists or cannot be made, IoError when it cannot be written; then nothing is left.
void make_key_file(const std::string& path);

}  // namespace twoport
