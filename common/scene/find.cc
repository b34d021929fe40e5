#include "common/scene/find.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <vector>

#include "common/base/check.h"
#include "common/base/nearest_names.h"

namespace twoport {
namespace {

namespace fs = std::filesystem;
constexpr const char* kEnding = ".textproto";

/// Where the project's folders may stand: here, above this program, and where it is installed.
std::vector<fs::path> roots() {
  std::vector<fs::path> all{"."};
  std::error_code error;
  for (fs::path at = fs::read_symlink("/proc/self/exe", error).parent_path(); at.has_relative_path();
       at = at.parent_path())
    all.insert(all.end(), {at, at / "share/twoport"});
  return all;
}

/// Names of all scenes of the first folder that has some.
std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const fs::path& root : roots()) {
    std::error_code error;
    for (fs::recursive_directory_iterator at{root / "scenes", error}, end; !error && at != end; at.increment(error))
      if (at->path().extension() == kEnding)
        all.push_back(at->path().lexically_relative(root / "scenes").replace_extension().string());
    if (!all.empty()) break;
  }
  return all;
}

}  // namespace

std::string scene_file(const std::string& named) {
  std::error_code error;
  if (fs::exists(named, error) && !fs::is_directory(named, error)) return named;
  for (const fs::path& root : roots())
    if (const fs::path file = root / "scenes" / (named + kEnding); fs::is_regular_file(file, error))
      return file.lexically_normal().string();
  if (fs::exists(named, error) || named.find('/') != named.npos || named.ends_with(kEnding)) return named;
  const std::vector<std::string> nearest = nearest_names(named, names(), 3);
  throw ConfigError{fmt::format("{}: no such file, and no scene of this name{}", named,
                                nearest.empty() ? "" : fmt::format("; did you mean {}?", fmt::join(nearest, ", ")))};
}

std::string project_folder(const std::string& name) {
  std::error_code error;
  for (const fs::path& root : roots())
    if (fs::is_directory(root / name, error)) return (root / name).lexically_normal().string();
  return name;
}

}  // namespace twoport
