#include "lab/lanes/taken.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <variant>

#include "common/base/time.h"
#include "common/contact/environment.h"
#include "common/coupling/setpoint_tracker.h"
#include "common/record/metrics.h"
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
  const bool model = c.method_name == "INTERNAL_MODEL" && !exchanges_energy(c) && c.coupling.stiffness_n_per_m > 0.0;
  if (!model && c.method_name != "NONE" && c.method_name != "CLASSIC" && c.method_name != "FORCE_PROJECTED")
    return false;
  if (c.architecture != Architecture::position_force && c.architecture != Architecture::position_measured_force)
    return false;
  for (const ImpairmentOptions* o : {&scene.to_slave, &scene.to_master})
    if (o->jitter_s != 0.0 || o->duplicate != 0.0 || o->reorder != 0.0 || !o->recorded_delay_s.empty() ||
        !o->delay_step.empty() || !o->blackout.empty() || lag_of(*o, period_of(scene)) > kMostLag ||
        may_be_silent(*o, scene))
      return false;
  for (const TransmissionOptions* o : {&scene.transmission_to_slave, &scene.transmission_to_master})
    if (o->playout_s > 0.0 || o->deadband) return false;
  return scene.schedule.empty() && c.device_limits == PortLimits{} && c.robot_limits == PortLimits{} &&
         c.own_limits == PortLimits{} && c.observer == ObserverRule::exact && !c.reference_energy;
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
  if (scene.gripper) return "the scene has a gripper";
  if (c.architecture == Architecture::render || c.architecture == Architecture::uncontrolled)
    return "the scene has no link";
  if (scene.dof != 1 && scene.dof != 3) return "dof is 6";
  if (scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0) return "the slave's clock differs";
  if (scene.master_rate_hz != scene.slave_rate_hz) return "the rates of the sides differ";
  if (kNanosecondsPerSecond / scene.master_rate_hz != static_cast<double>(period_of(scene)))
    return "a tick is not a whole number of nanoseconds";
  const bool in_steps = scene.simulation.integrator == Integrator::rk4;
  if (scene.simulation.integrator != Integrator::exact && !in_steps) return "simulation.integrator is not EXACT or RK4";
  if (!scene.robot) return "the robot is ideal";
  if (world.surfaces.size() > 1 ||
      (world.surfaces.size() == 1 && !std::holds_alternative<Wall>(world.surfaces[0].shape)))
    return "the environment is more than one wall and springs";
  if (scene.dof == 3 && !in_steps && !world.surfaces.empty() && world.surfaces[0].material.friction != 0.0)
    return "the wall has friction, which simulation.integrator EXACT steps by itself";
  if (world.springs.size() > static_cast<std::size_t>(kMostSprings)) return "there are more than two springs";
  for (const Spring& s : world.springs)
    if (s.motion.amplitude_m != 0.0) return "an anchor moves";
  if (scene.robot->force_sensor) {
    const ForceSensorSpec& sensor = *scene.robot->force_sensor;
    if (sensor.noise_n > 0.0 || std::lround(sensor.latency_s * scene.slave_rate_hz) != 0)
      return "the force sensor has noise or latency";
  }
  if (!scene.operator_model || !scene.operator_model->hand) return "nobody holds the device with a hand's impedance";
  for (const double f : scene.operator_model->hand->force_n)
    if (f != 0.0) return "the hand has a constant force";
  for (const SegmentSpec& s : scene.operator_model->path)
    if (std::holds_alternative<RecordedHandSpec>(s) || std::holds_alternative<MultiSineSpec>(s))
      return "the operator's path is a recording";
  const double device_kg = scene.device ? scene.device->mass_kg : 0.0;
  if (!(device_kg + scene.operator_model->hand->mass_kg > 0.0)) return "the handle has no mass";
  if (scene.device) {
    if (scene.device->coulomb_friction_n != 0.0) return "the device has Coulomb friction";
    if (scene.device->position_resolution_m != 0.0 ||
        scene.device->velocity_estimate != VelocityEstimate::true_velocity)
      return "the device has encoders";
  }
  if (c.registration.absolute || !c.registration.rotation.normalized().toRotationMatrix().isIdentity(0.0))
    return "the registration is absolute or turned";
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
