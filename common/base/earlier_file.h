#pragma once

#include <string>

namespace twoport {

/// A regular file that is not empty.
bool has_content(const std::string& path);
/// PATH~: the name that take_file gives to a file of an earlier run.
std::string earlier_file(const std::string& path);

}  // namespace twoport
