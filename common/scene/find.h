#pragma once

#include <string>

namespace twoport {

/// The file of a scene as people name it: that file where there is one, else the scene of the project with this name ("demo",
/// "edge/deadband"), in `scenes` here, in the source tree of this program, or installed. Throws ConfigError with the nearest names for a
/// word that is neither; another path is returned as it is, to be complained of where it is read.
std::string scene_file(const std::string& named);

/// A file that the file `naming` names: a relative path starts at the folder of `naming`.
std::string file_beside(const std::string& naming, const std::string& named);

/// From now on the project's folders are looked for above the folder `at` too: a library is not where its program is. Call it before any
/// thread reads a scene.
void look_above(const std::string& at);

/// The folder "scenes/edge" of the project, where scene_file() looks; the name itself where there is none.
std::string project_folder(const std::string& name);

}  // namespace twoport
