// playground-scenes OUT SCENE.textproto...: writes for each scene OUT/NAME.scene, its values for the core, and OUT/NAME.json, what the
// page is told of it. Says in a sentence which scenes it leaves out.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/page/describe.h"
#include "common/scene/load.h"
#include "drivers/page_device.h"
#include "master/with_device.h"
#include "web/playground/packed_scene.h"

namespace twoport::playground {
namespace {

/// The fields of an entry of the schedule that choose a method, or a pair of layers.
using Choice = std::vector<std::string>;
std::vector<Choice> all_choices() {
  std::vector<Choice> all;
  for (const MethodName& method : kMethods) all.push_back({"passivity.method=" + std::string{method.name}});
  for (const TransparencyLayerName& t : kTransparencyLayers)
    for (const PassivityLayerName& p : kPassivityLayers) {
      const bool named = std::any_of(std::begin(kMethods), std::end(kMethods), [&](const MethodName& m) {
        return m.transparency == t.name && m.passivity == p.name;
      });
      if (!named && !t.is_external)
        all.push_back({"transparency.layer=" + std::string{t.name}, "passivity.layer=" + std::string{p.name}});
    }
  return all;
}

/// With every method that the scene admits, to be switched to by hand; a scene that switches at given times keeps its own.
Scene with_all_methods(const std::string& path) {
  Scene scene = load_scene(path, {}, SceneFor::live);
  const bool at_times = std::any_of(scene.schedule.begin(), scene.schedule.end(),
                                    [](const ScheduledControl& entry) { return std::isfinite(entry.at_s); });
  if (at_times || scene.control.architecture == Architecture::render) return scene;
  std::vector<std::string> overrides;
  for (const Choice& choice : all_choices()) {
    std::vector<std::string> longer = overrides;
    for (const std::string& field : choice)
      longer.push_back("control.schedule[" + std::to_string(scene.schedule.size()) + "]." + field);
    try {
      Scene next = load_scene(path, longer, SceneFor::live);
      const auto same = [&](const ControlOptions& o) {
        return o.method_name == next.schedule.back().control.method_name &&
               o.architecture == next.schedule.back().control.architecture;
      };
      if (same(scene.control) || std::any_of(scene.schedule.begin(), scene.schedule.end(),
                                             [&](const ScheduledControl& entry) { return same(entry.control); }))
        continue;
      scene = std::move(next);
      overrides = std::move(longer);
    } catch (const ConfigError&) {
      // Not for this scene.
    }
  }
  return scene;
}

std::string introduction(const Scene& read) {
  return for_cartesian_dof(read.dof, "the playground", [&]<int N>() {
    PageChannel channel;
    const DeviceInfo info = PageDevice<N>{read, 1.0 / read.master_rate_hz, &channel}.info();
    std::vector<std::string> methods;
    if (!read.schedule.empty()) methods.push_back(read.control.method_name);
    for (const ScheduledControl& entry : read.schedule) methods.push_back(entry.control.method_name);
    return describe_for_page(
        with_device(read, info),
        {.device = info.name, .has_pointer = true, .grip_n_per_m = channel.pointer.grip_n_per_m, .methods = methods});
  });
}

void write(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream{path, std::ios::binary} << bytes;
}

}  // namespace
}  // namespace twoport::playground

int main(int argc, char** argv) {
  using namespace twoport;
  const std::filesystem::path out = argv[1];
  for (int i = 2; i < argc; ++i) {
    const std::filesystem::path path = argv[i];
    try {
      Scene scene = playground::with_all_methods(path);
      if (scene.control.architecture == Architecture::uncontrolled) throw ConfigError{"a robot without a hand"};
      playground::Packer packer;
      packer(scene);
      playground::write(out / path.stem().concat(".scene"), packer.bytes());
      playground::write(out / path.stem().concat(".json"), playground::introduction(scene));
    } catch (const ConfigError& e) {
      std::cerr << "the playground leaves " << path.filename().string() << " out: " << e.what() << "\n";
    }
  }
}
