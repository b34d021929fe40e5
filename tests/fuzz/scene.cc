#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "tests/fuzz/input.h"

// Any text as a scene, and any as overrides after a zero byte: it is a scene, or refused in one sentence.
namespace twoport {
namespace {

void check(std::string text) {
  std::vector<std::string> overrides;
  for (std::size_t at = text.rfind('\0'); at != text.npos; at = text.rfind('\0')) {
    overrides.insert(overrides.begin(), text.substr(at + 1));
    text.resize(at);
  }
  try {
    const Scene scene = parse_scene(text, "fuzz", overrides);
    require(scene.dof == 1 || scene.dof == 3 || scene.dof == 6, "a scene has 1, 3 or 6 degrees of freedom");
    scene_digest(scene);
  } catch (const ConfigError& e) {
    require(std::string{e.what()}.find('\n') == std::string::npos, "a refusal is one line");
  }
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::check({reinterpret_cast<const char*>(data), size});
  return 0;
}
