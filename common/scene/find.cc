#include "common/scene/find.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <vector>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/scene/arm.h"

namespace twoport {
namespace {

namespace fs = std::filesystem;
constexpr std::array<const char*, 3> kEndings{".textproto", ".urdf", ""};  // the last: it has one

/// Folders of look_above().
std::vector<fs::path>& places() {
  static std::vector<fs::path> all;
  return all;
}

/// Where the project's folders may stand: here, above this program or library, and where it is installed.
std::vector<fs::path> roots() {
  std::vector<fs::path> all{"."};
  std::error_code error;
  std::vector<fs::path> starts{fs::read_symlink("/proc/self/exe", error).parent_path()};
  starts.insert(starts.end(), places().begin(), places().end());
  for (const fs::path& start : starts)
    for (fs::path at = start; at.has_relative_path(); at = at.parent_path())
      all.insert(all.end(), {at, at / "share/twoport"});
  return all;
}

/// Names of all files of the kind in the first `folder` that has some.
std::vector<std::string> names(const char* folder) {
  std::vector<std::string> all;
  for (const fs::path& root : roots()) {
    std::error_code error;
    for (fs::recursive_directory_iterator at{root / folder, error}, end; !error && at != end; at.increment(error))
      if (std::ranges::find(kEndings, at->path().extension()) != kEndings.end() && at->path().has_extension())
        all.push_back(at->path().lexically_relative(root / folder).replace_extension().string());
    if (!all.empty()) break;
  }
  return all;
}

/// `file`, where `named` is, if it exists; else the file of this name in `folder` of the project, which holds things of one `kind`.
std::string project_file(const fs::path& file, const std::string& named, const char* folder, const char* kind) {
  std::error_code error;
  if (fs::exists(file, error) && !fs::is_directory(file, error)) return file.string();
  for (const fs::path& root : roots())
    for (const char* ending : kEndings)
      if (const fs::path in = root / folder / (named + ending); fs::is_regular_file(in, error))
        return in.lexically_normal().string();
  if (fs::exists(file, error) || named.find('/') != named.npos || fs::path{named}.extension() == kEndings[0] ||
      fs::path{named}.extension() == kEndings[1])
    return file.string();
  const std::vector<std::string> nearest = nearest_names(named, names(folder), 3);
  throw ConfigError{fmt::format("{}: no such file, and no {} of this name{}", named, kind,
                                nearest.empty() ? "" : fmt::format("; did you mean {}?", fmt::join(nearest, ", ")))};
}

}  // namespace

std::string file_beside(const std::string& naming, const std::string& named) {
  return (fs::path{naming}.parent_path() / named).string();
}

std::string scene_file(const std::string& named) {
  return project_file(named, named, "scenes", "scene");
}

std::string arm_file(const std::string& named, const std::string& folder) {
  return project_file(fs::path{folder} / named, named, "arms", "arm");
}

void look_above(const std::string& at) {
  places().push_back(at);
}

std::string project_folder(const std::string& name) {
  std::error_code error;
  for (const fs::path& root : roots())
    if (fs::is_directory(root / name, error)) return (root / name).lexically_normal().string();
  return name;
}

}  // namespace twoport
