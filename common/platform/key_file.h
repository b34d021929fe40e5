#pragma once

#include <string>

#include "common/secure/key.h"

namespace twoport {

/// Reads a key: 64 hexadecimal digits and at most one end of line. Throws ConfigError with the path and the reason unless it
/// is a regular file, not a symbolic link, of this user or of root, which nobody else may read or write.
Key read_key_file(const std::string& path);

/// Writes a new key from the system's random generator, readable and writable by its owner only. Throws ConfigError when the
/// file exists or cannot be made, IoError when it cannot be written; then nothing is left.
void make_key_file(const std::string& path);

}  // namespace twoport
