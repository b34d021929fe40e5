#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/plot/pictures.h"
#include "lab/study/cells.h"
#include "lab/study/impedance.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string scene, out;
  std::vector<std::string> set;
  ImpedanceOptions options;
};

int impedance_command(const Arguments& a) {
  const Scene scene = load_scene(a.scene, a.set);
  const std::vector<DisplayedImpedance> all = displayed_impedance(scene, a.options);
  if (!a.out.empty()) make_folder(a.out);
  std::fputs(to_text(all).c_str(), stdout);
  if (a.out.empty()) return 0;
  write_whole(a.out + "/table.csv", to_csv(all));
  fmt::print("{}\n", draw(all, scene.name, a.out));
  return 0;
}

}  // namespace

void add_impedance_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& impedance = *app.add_subcommand(
      "impedance", "Displayed mass, damping and stiffness in free space and in contact, beside the true");
  add_scene(impedance, a->scene, a->set);
  impedance.add_option("--amplitude", a->options.amplitude_m, "Largest excursion [m]")
      ->check(CLI::Range(1e-7, 1.0))
      ->capture_default_str();
  impedance.add_option("--out", a->out, "Folder for table.csv and the picture");
  impedance.footer(
      R"(The scene is run once to find where the robot (the device under RENDER) touches. Then the handle is moved to that place,
and to free space, and excited by a random-phase multi-sine of 0.5 to 50 Hz along the environment's force. Force against
motion at the master port gives a mass, a damping and a stiffness, fitted up to 10 Hz. True are those of robot and
environment, times force_scale and motion_scale. Coherence is the share of the force that a linear law explains: below 1
where a force saturates, an encoder is coarse, controllers switch, packets are lost or contact ends. table.csv holds each
line: real and imaginary part of force / motion [N/m], displayed and true. A scene that is unstable or never coupled, or
has no free space, is refused.)");
  impedance.callback([a, &chosen] { chosen = [a] { return impedance_command(*a); }; });
}

}  // namespace twoport::lab
