#include "lab/study/zwidth.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/load.h"
#include "lab/theory/sampled_loop.h"

namespace twoport::lab {
namespace {

constexpr int kPoints = 120;

SampledWall theory(const Scene& scene, const std::string& file) {
  const auto refuse = [&](const std::string& what) {
    return ConfigError{
        fmt::format("{}: {}; z-width needs one axis, RENDER, a device with mass, and one wall or spring", file, what)};
  };
  if (scene.dof != 1) throw refuse(fmt::format("dof is {}", scene.dof));
  if (scene.control.architecture != Architecture::render) throw refuse("the architecture is not RENDER");
  if (scene.environment.size() != 1) throw refuse(fmt::format("{} environments", scene.environment.size()));
  if (!scene.device) throw refuse("there is no device");
  if (scene.operator_model && !scene.operator_model->hand)
    throw refuse("an operator without a hand leads the device along its path");
  const DeviceSpec& device = *scene.device;
  if (device.coulomb_friction_n > 0.0 || device.position_resolution_m > 0.0)
    throw refuse("Coulomb friction and encoder resolution have no eigenvalues");
  if (device.velocity_estimate == VelocityEstimate::filtered) throw refuse("velocity_estimate is FILTERED");
  const HandSpec hand = scene.operator_model && scene.operator_model->hand ? *scene.operator_model->hand : HandSpec{};
  return {.mass_kg = device.mass_kg + hand.mass_kg,
          .damping_n_s_per_m = device.damping_n_s_per_m + hand.damping_n_s_per_m,
          .hand_stiffness_n_per_m = hand.stiffness_n_per_m,
          .period_s = 1.0 / scene.master_rate_hz,
          .true_velocity = device.velocity_estimate == VelocityEstimate::true_velocity};
}

}  // namespace

ZWidth z_width(const ZWidthOptions& o, const Heard& heard) {
  const std::string text = read_text(o.scene);
  const Scene scene = parse_scene(text, o.scene, o.set);
  SampledWall wall = theory(scene, o.scene);
  const std::string kind = name(scene.environment[0]);
  if (kind != Wall::kName && kind != Spring::kName)
    throw ConfigError{fmt::format("{}: z-width needs a wall or a spring to vary", o.scene)};
  const std::string element = "environment[0]." + kind + ".";
  const SweepOptions grid{.scene = o.scene,
                          .text = text,
                          .set = o.set,
                          .axes = {parse_axis(element + "damping_n_s_per_m=" + o.damping),
                                   parse_axis(element + "stiffness_n_per_m=" + o.stiffness),
                                   parse_axis("control.passivity.method=" + o.methods)},
                          .jobs = o.jobs,
                          .lanes = o.lanes,
                          .shard = {},
                          .out = o.out,
                          .returned = std::vector<std::string>{"stable"}};
  for (const Axis& axis : grid.axes) warn_if_lost(o.set, axis.paths);
  ZWidth z{.scene = scene.name,
           .table = sweep(grid, heard),
           .damping = {},
           .critical = {},
           .passive = {},
           .methods = grid.axes[2].values,
           .displayed = {},
           .border = {}};
  for (const std::string& b : grid.axes[0].values) {
    wall.wall_damping_n_s_per_m = std::stod(b);
    z.damping.push_back(wall.wall_damping_n_s_per_m);
    z.critical.push_back(critical_stiffness(wall));
    const double spare = wall.damping_n_s_per_m - wall.wall_damping_n_s_per_m;
    z.passive.push_back(std::max(0.0, 2.0 * spare / wall.period_s));
  }
  const auto [least, most] = std::minmax_element(z.damping.begin(), z.damping.end());
  for (int i = 0; i <= kPoints; ++i) {
    wall.wall_damping_n_s_per_m = *least + (*most - *least) * i / kPoints;
    z.border.emplace_back(wall.wall_damping_n_s_per_m, critical_stiffness(wall));
  }
  const std::vector<std::string>& stiffness = grid.axes[1].values;
  for (std::size_t m = 0; m < z.methods.size(); ++m) {
    std::vector<double>& up_to = z.displayed.emplace_back(z.damping.size(), 0.0);
    for (std::size_t b = 0; b < z.damping.size(); ++b)
      for (std::size_t k = 0; k < stiffness.size() && z.stable(b, k, m); ++k) up_to[b] = std::stod(stiffness[k]);
  }
  return z;
}

bool ZWidth::stable(std::size_t b, std::size_t k, std::size_t m) const {
  const std::vector<Axis>& axes = table.grid.axes;
  const std::size_t row = (b * axes[1].values.size() + k) * axes[2].values.size() + m;
  return table.rows[row][*table.find("stable")].number() == 1.0;
}

std::string to_text(const ZWidth& z) {
  std::string out = fmt::format("{:>10} {:>12} {:>12}", "B [N s/m]", "passive to", "stable to");
  for (const std::string& method : z.methods) out += fmt::format(" {:>16}", method);
  out += "\n                 (theory)     (theory)   stiffness displayed [N/m]\n";
  for (std::size_t b = 0; b < z.damping.size(); ++b) {
    out += fmt::format("{:>10.3g} {:>12.5g} {:>12.5g}", z.damping[b], z.passive[b], z.critical[b]);
    for (const auto& method : z.displayed) out += fmt::format(" {:>16.5g}", method[b]);
    out += '\n';
  }
  return out;
}

}  // namespace twoport::lab
