#include "lab/lanes/taken.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <sstream>
#include <string>

#include "common/base/time.h"
#include "common/contact/environment.h"
#include "common/coupling/layers.h"
#include "common/coupling/setpoint_tracker.h"
#include "common/record/metrics.h"
#include "common/scene/parts.h"
#include "lab/lanes/lanes.h"

namespace twoport::lab {
namespace lanes {

std::int64_t lag_of(const ImpairmentOptions& way, std::int64_t period_ns) {
  const std::int64_t delay = std::max<std::int64_t>(0, to_duration(way.delay_s).count());
  return (std::max<std::int64_t>(delay - 1, 1) + period_ns - 1) / period_ns;
}
std::int64_t period_of(const Scene& scene) {
  return static_cast<std::int64_t>(kNanosecondsPerSecond / scene.master_rate_hz);
}

std::int64_t first_force_lag_of(const Scene& scene) {
  return 1 + std::lround(scene.to_master.delay_s * scene.slave_rate_hz);
}
std::int64_t oldest_of(const Scene& scene) {
  const std::int64_t period = period_of(scene);
  return 1 + std::max({lag_of(scene.to_slave, period), lag_of(scene.to_master, period), first_force_lag_of(scene)});
}
std::size_t window_of(const Scene& scene) {
  return static_cast<std::size_t>(std::max(1L, std::lround(HeldForce<1>::kWindow * scene.master_rate_hz)));
}

namespace {
/// The fields of a scene that lanes take, halves in lanes too; of a block that is named, all.
constexpr const char* kTaken = R"(
  name description dof duration_s rate_hz master_rate_hz slave_rate_hz seed expect device_mount robot_mount
  simulation.integrator simulation.substeps
  operator.hand.mass_kg operator.hand.stiffness_n_per_m operator.hand.damping_n_s_per_m
  operator.path.hold.duration_s operator.path.move_to.position_m operator.path.move_to.duration_s
  operator.path.sine.axis operator.path.sine.amplitude_m operator.path.sine.frequency_hz operator.path.sine.duration_s
  operator.path.screw.point_m operator.path.screw.axis operator.path.screw.angle_rad operator.path.screw.travel_m
  operator.path.screw.frequency_hz operator.path.screw.duration_s
  operator.tremor.rms_m operator.tremor.low_hz operator.tremor.high_hz
  device.mass_kg device.damping_n_s_per_m device.position_m device.velocity_m_per_s device.max_force_n
  robot.mass_kg robot.damping_n_s_per_m robot.position_m robot.velocity_m_per_s robot.force_sensor.bias_n
  environment.wall.normal environment.wall.offset_m environment.wall.stiffness_n_per_m
  environment.wall.damping_n_s_per_m environment.wall.friction environment.wall.viscous_friction_n_s_per_m
  environment.spring.stiffness_n_per_m environment.spring.damping_n_s_per_m environment.spring.anchor_m
  control.architecture control.force_scale control.motion_scale control.engage_s control.hold_after_s
  control.release_after_s control.transparency.layer
  control.virtual_coupling.stiffness_n_per_m control.virtual_coupling.damping_n_s_per_m
  control.virtual_coupling.catch_up_m_per_s control.virtual_coupling.drift_compensation
  control.passivity.method control.passivity.layer control.passivity.initial_energy_j control.passivity.max_gain
  control.passivity.unilateral control.passivity.predict control.passivity.round_trip_ms
  to_slave.delay_ms to_slave.loss to_slave.burst to_master.delay_ms to_master.loss to_master.burst
)";
/// What they take besides where nodes and link are the laboratory's own.
constexpr const char* kTakenByNodes = R"(
  control.virtual_coupling control.passivity control.transparency control.device_limits control.robot_limits
  control.schedule to_slave to_master
)";
std::set<std::string> words_of(const std::string& text) {
  std::istringstream in{text};
  return {std::istream_iterator<std::string>{in}, {}};
}

/// Are packets lost so often that a side may hear nothing for hold_after/2 or a bridged gap, in a tick of 10^6?
bool may_be_silent(const ImpairmentOptions& o, const Scene& scene) {
  const double ticks =
      std::min(0.5 * scene.control.hold_after.si(), SetpointTracker<1>::kBridge.si()) * scene.master_rate_hz;
  double goes_on = o.loss;
  if (o.burst) {
    const double bad = 1.0 - (1.0 - o.loss) * (1.0 - o.burst->loss_bad),
                 good = 1.0 - (1.0 - o.loss) * (1.0 - o.burst->loss_good);
    goes_on = std::max(bad * (1.0 - o.burst->r), good);
  }
  return ticks * std::log(std::max(goes_on, 1e-300)) > std::log(1e-6);
}
bool has_nodes_in_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  if (has_figures(transparency_layer(c), scene.dof)) return false;
  const bool model = c.method_name == "INTERNAL_MODEL" && !exchanges_energy(c) && c.coupling.stiffness_n_per_m > 0.0;
  if (!model && c.method_name != "NONE" && c.method_name != "CLASSIC" && c.method_name != "FORCE_PROJECTED")
    return false;
  if (c.architecture != Architecture::position_force && c.architecture != Architecture::position_measured_force)
    return false;
  for (const ImpairmentOptions* o : {&scene.to_slave, &scene.to_master})
    if (!o->recorded_delay_s.empty() || lag_of(*o, period_of(scene)) > kMostLag || may_be_silent(*o, scene))
      return false;
  static const std::set<std::string> taken = words_of(kTaken);
  return field_beyond(scene, taken).empty();
}
}  // namespace
LaneMethod method_of(const Scene& scene) {
  if (!has_nodes_in_lanes(scene)) return LaneMethod::nodes;
  const ControlOptions& c = scene.control;
  if (c.method_name == "INTERNAL_MODEL") return LaneMethod::internal_model;
  if (c.controller.method == Method::none) return LaneMethod::none;
  const bool predictive =
      c.controller.method == Method::force_projected && c.controller.predict && c.handle_mass_kg > 0.0;
  return predictive ? LaneMethod::predictive : LaneMethod::one_port;
}

}  // namespace lanes

using namespace lanes;

std::string why_not_in_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  const World world{scene.environment};
  if (!scene.source) return "a program has made the scene";
  static const std::set<std::string> taken = words_of(std::string{kTaken} + kTakenByNodes);
  if (const std::string field = field_beyond(scene, taken); !field.empty()) return "lanes do not take " + field;
  if (c.architecture == Architecture::render || c.architecture == Architecture::uncontrolled)
    return "the scene has no link";
  if (scene.dof != 1 && scene.dof != 3) return "dof is 6";
  if (scene.master_rate_hz != scene.slave_rate_hz) return "the rates of the sides differ";
  if (kNanosecondsPerSecond / scene.master_rate_hz != static_cast<double>(period_of(scene)))
    return "a tick is not a whole number of nanoseconds";
  const bool in_steps = scene.simulation.integrator == Integrator::rk4;
  if (scene.simulation.integrator != Integrator::exact && !in_steps) return "simulation.integrator is not EXACT or RK4";
  if (!scene.robot) return "the robot is ideal";
  if (world.surfaces.size() > 1) return "there is more than one wall";
  if (scene.dof == 3 && !in_steps && !world.surfaces.empty() && world.surfaces[0].material.friction != 0.0)
    return "the wall has friction, which simulation.integrator EXACT steps by itself";
  if (world.springs.size() > static_cast<std::size_t>(kMostSprings)) return "there are more than two springs";
  if (!scene.operator_model || !scene.operator_model->hand) return "nobody holds the device with a hand's impedance";
  const double device_kg = scene.device ? scene.device->mass_kg : 0.0;
  if (!(device_kg + scene.operator_model->hand->mass_kg > 0.0)) return "the handle has no mass";
  if (!(scene.duration_s * scene.master_rate_hz <= kMostTicks)) return "the run is very long";
  return {};
}

std::string shape_of_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  const World world{scene.environment};
  const LaneMethod method = method_of(scene);
  std::string shape =
      fmt::format("{} {} {} {} {}", scene.dof, static_cast<int>(method), world.surfaces.size(), world.springs.size(),
                  scene.simulation.integrator == Integrator::rk4 ? scene.simulation.substeps : 0);
  if (method == LaneMethod::internal_model) {
    shape += returns_measured_force(c) ? " measured" : "";
    shape += c.coupling.drift_compensation ? " 1" : " 0";
  } else if (method != LaneMethod::nodes)
    shape += fmt::format(" {}{}{}{}{}", static_cast<int>(c.controller.method), c.controller.unilateral ? 1 : 0,
                         c.controller.predict ? 1 : 0, returns_measured_force(c) ? 1 : 0,
                         c.coupling.drift_compensation ? 1 : 0);
  return shape;
}

}  // namespace twoport::lab
