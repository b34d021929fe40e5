#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/arm/parameters.h"
#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/text.h"
#include "common/platform/arguments.h"
#include "common/platform/realtime.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "tools/device/probe.h"

namespace twoport {
namespace {

struct Arguments {
  std::string device, scene;
  int dof = 1, joint = 0;  ///< joint: from 1; 0: handle or tool is the port
  double rate_hz = 1000.0, push_n = 0.0;
  bool move = false, json = false;
};

Scene scene_of(const Arguments& a) {
  if (!a.scene.empty()) {
    Scene scene = load_scene(a.scene, {}, SceneFor::live);
    if (a.joint > scene.joints || (a.joint == 0 && scene.joints > 0))
      throw ConfigError{fmt::format("{}: space is {}; --joint must be {}", a.scene,
                                    scene.joints > 0 ? "JOINTS" : "CARTESIAN",
                                    scene.joints > 0 ? fmt::format("1 to {}", scene.joints) : "absent")};
    return scene;
  }
  if (a.joint > 0) {
    if (!plugin_choice(a.device))
      throw ConfigError{"--joint: a plug-in says what its arm is; for " + a.device + " --scene must"};
    Scene scene{};
    scene.dof = kJointPort;
    scene.master_rate_hz = a.rate_hz;
    return scene;
  }
  return parse_scene(
      fmt::format("name: \"probe\" dof: {} rate_hz: {} device {{ mass_kg: 0.075 damping_n_s_per_m: 0.5 "
                  "max_force_n: 8 {} }} control {{ architecture: RENDER passivity {{ method: NONE }} }}",
                  a.dof, a.rate_hz, a.dof == 6 ? "inertia_kg_m2: 1e-4 rotational_damping_n_m_s_per_rad: 1e-3" : ""),
      "probe", {}, SceneFor::live);
}

/// Of what is measured: along an axis, or of a joint that turns.
struct Units {
  double most_force;  ///< of the device
  const char *position, *small, *inertia, *mass, *damping, *force, *stiffness;
  const char *json_force, *json_small, *json_mass, *json_damping, *json_friction, *json_wall;
};
// clang-format off
Units units(double most_force, bool turns) {
  if (turns)
    return {most_force, "rad", "urad", "inertia", "kg m2", "N m s/rad", "N m", "N m/rad", "max_torque_n_m", "resolution_rad",
            "inertia_kg_m2", "damping_n_m_s_per_rad", "coulomb_friction_n_m", "wall_n_m_per_rad"};
  return {most_force, "m", "um", "mass", "kg", "N s/m", "N", "N/m", "max_force_n", "resolution_m",
          "mass_kg", "damping_n_s_per_m", "coulomb_friction_n", "wall_n_per_m"};
}
// clang-format on
/// Of the port, or of the joint that is measured.
Units units_of(const Arguments& a, const Scene& scene, const DeviceInfo& info, const JointLimits& limits) {
  if (a.joint == 0) return units(info.max_force_n, false);
  const bool slides =
      scene.device && scene.device->arm &&
      scene.device->arm->parameters->joints[static_cast<std::size_t>(a.joint - 1)].type == JointType::prismatic;
  return units(limits.effort[a.joint - 1], !slides);
}

std::string number(double value, const char* unit) {
  return std::isfinite(value) && value > 0.0 ? fmt::format("{:.3g} {}", value, unit) : "not known";
}

/// Of joint `joint`, from 1.
void print_joints(int joints, int joint, const JointLimits& all, const Units& u) {
  const double lower = all.lower[joint - 1], upper = all.upper[joint - 1];
  fmt::print("joints             {}; joint {} is measured\n", joints, joint);
  fmt::print("its force          {}\n", number(u.most_force, u.force));
  fmt::print("its range          {}\n", std::isfinite(lower) && std::isfinite(upper)
                                            ? fmt::format("{:.4g} to {:.4g} {}", lower, upper, u.position)
                                            : "not known");
}
void print_handle(const DeviceInfo& i, int dof) {
  fmt::print("degrees of freedom {}\n", i.dof > 0 ? i.dof : dof);
  fmt::print("workspace          {}\n",
             i.workspace_m[0] > 0.0
                 ? fmt::format("{:.3g} x {:.3g} x {:.3g} m", i.workspace_m[0], i.workspace_m[1], i.workspace_m[2])
                 : "not known");
  fmt::print("force              {}\n",
             i.max_force_n == 0.0 ? std::string{"it displays none"}
             : std::isfinite(i.max_force_n)
                 ? fmt::format(
                       "{:.3g} N at most, {} continuously", i.max_force_n,
                       std::isfinite(i.continuous_force_n) ? fmt::format("{:.3g} N", i.continuous_force_n) : "the same")
                 : "not known");
  fmt::print("resolution         {}\n", number(1e6 * i.resolution_m, "um"));
  fmt::print("rate               {}\n", number(i.rate_hz, "Hz"));
  fmt::print("apparent mass      {}\n", number(i.mass_kg, "kg"));
}
void print_info(const DeviceInfo& i, int dof, int joint, const JointLimits& limits, const Units& u, bool simulated) {
  fmt::print("device             {}{}\n", in_one_line(i.name), simulated ? ", in virtual time" : "");
  if (joint > 0)
    print_joints(i.dof > 0 ? i.dof : dof, joint, limits, u);
  else
    print_handle(i, dof);
  fmt::print("watchdog           {}\n", i.watchdog > Seconds{}
                                            ? fmt::format("lets go after {:.3g} s", i.watchdog.si())
                                            : "none: a stopped program leaves its last command standing");
  fmt::print("buttons            {}{}\n", i.buttons, i.gripper ? ", and a gripper" : "");
}

void print_gripper(const DeviceInfo& i, double opening_m) {
  fmt::print("gripper            {}; it begins at {:.3g} m; {}\n", in_one_line(i.name), opening_m,
             i.max_force_n == 0.0           ? std::string{"it displays no force"}
             : std::isfinite(i.max_force_n) ? fmt::format("{:.3g} N at most", i.max_force_n)
                                            : "its force is not known");
}

void print_measured(const ProbeFigures& f, double period_s, bool moved, double tolerance, int joint, const Units& u) {
  fmt::print("\nmeasured {}\n", joint > 0 ? fmt::format("at joint {}", joint) : "along the first axis");
  fmt::print("new readings       {}\n",
             f.rate_hz > 0.0 ? fmt::format("{:.0f} a second", f.rate_hz) : "fewer than two in a second");
  fmt::print("resolution         {}\n",
             f.resolution_m > 0.0 ? fmt::format("{:.3g} {}", 1e6 * f.resolution_m, u.small) : "no step seen");
  if (!moved) return;
  fmt::print("latency            {}\n",
             std::isfinite(f.latency_s)
                 ? fmt::format("{:.3g} ms from a push to a reading that has moved", 1e3 * f.latency_s)
                 : "nothing has moved: no force arrives, or no reading changes; walls are not tried");
  if (f.mass_kg <= 0.0) {
    fmt::print("mass               does not follow from the pushes: `applied` is not the force that acts\n");
  } else if (std::isfinite(f.mass_kg)) {
    fmt::print("{:<18} {:.4g} {}\ndamping            {:.4g} {}\nCoulomb friction   {:.3g} {}\n", u.inertia, f.mass_kg,
               u.mass, f.damping_n_s_per_m, u.damping,
               std::abs(f.coulomb_friction_n) < 1e-6 ? 0.0 : f.coulomb_friction_n, u.force);
    fmt::print("explained          {:.2f} % of the impulses\n", 100.0 * f.fit);
  }
  if (std::isfinite(f.wall_n_per_m))
    fmt::print("stiffest wall      {}{:.4g} {} within {:.0f} %{}\n",
               !f.wall_is_bound         ? ""
               : f.wall_n_per_m > 100.0 ? "above "
                                        : "below ",
               f.wall_n_per_m, u.stiffness, 100.0 * tolerance,
               f.damping_n_s_per_m > 0.0 ? fmt::format("; 2 b/T = {:.4g} {} in theory, without delay",
                                                       2.0 * f.damping_n_s_per_m / period_s, u.stiffness)
                                         : "");
  if (!f.broken_off.empty()) fmt::print("broken off         {}\n", f.broken_off);
}

/// What the scene should name, of what was found.
void print_scene(const DeviceInfo& i, const ProbeFigures& f) {
  if (!(f.mass_kg > 0.0)) return;
  std::string block =
      fmt::format("device {{ mass_kg: {:.3g} damping_n_s_per_m: {:.3g}", f.mass_kg, std::max(0.0, f.damping_n_s_per_m));
  if (f.coulomb_friction_n > 1e-3) block += fmt::format(" coulomb_friction_n: {:.2g}", f.coulomb_friction_n);
  if (f.resolution_m > 0.0) block += fmt::format(" position_resolution_m: {:.2g}", f.resolution_m);
  if (i.max_force_n > 0.0 && std::isfinite(i.max_force_n)) block += fmt::format(" max_force_n: {:.3g}", i.max_force_n);
  fmt::print("\nfor the scene\n{} }}\n", block);
  if (std::isfinite(f.wall_n_per_m) && !f.wall_is_bound)
    fmt::print("# control.virtual_coupling.stiffness_n_per_m: at most {:.2g}, half of the stiffest wall\n",
               0.5 * f.wall_n_per_m);
}

template <int N>
int probe(const Arguments& a, const Scene& scene) {
  const double period_s = 1.0 / scene.master_rate_hz;
  const std::unique_ptr<Device<N>> device = all_drivers().devices.open<N>(a.device, scene, Seconds{period_s});
  const DeviceInfo info = device->info();
  if (a.joint > 0 && info.dof > 0 && a.joint > info.dof)
    throw ConfigError{fmt::format("--joint is {}, but {} has {} joints", a.joint, a.device, info.dof)};
  const JointLimits limits = lowest(info.limits.joints, scene.control.device_limits.joints);
  const Units u = units_of(a, scene, info, limits);
  const int axis = std::max(a.joint - 1, 0);
  const bool simulated = device->truth() != nullptr;
  const bool moves = (a.move || simulated) && u.most_force > 0.0;
  const std::atomic<bool>& stop = stop_on_signals();

  // Time goes on from phase to phase.
  Duration since{0}, before{0};
  const auto tick = [&](Duration now, const ProbePhase& step) {
    const Seconds period{period_s}, ended = simulated ? period : to_seconds(now - std::exchange(before, now));
    const DeviceSample<N> s = device->sense({Instant<MasterClock>{now}, period, ended});
    const auto push = step({to_seconds(now).si(), s.x.translation()[axis], s.v[axis], -s.applied[axis], s.status});
    typename Force<N>::Vector f = Force<N>::Vector::Zero();
    if (push) f[axis] = -std::clamp(*push, -u.most_force, u.most_force);
    device->actuate(Force<N>{f});
    return push.has_value();
  };
  std::optional<PeriodicLoop> loop;
  if (!simulated) loop.emplace(LoopOptions{.rate_hz = scene.master_rate_hz});
  long k = 0;
  const ProbeRunner runner = [&](const ProbePhase& step) {
    if (simulated) {
      while (!stop && tick(tick_time(++k, scene.master_rate_hz), step)) {
      }
      return;
    }
    Duration last{0};
    loop->run(stop, [&](std::int64_t, Duration now) { return tick(since + (last = now), step); });
    since += last + to_duration(period_s);
  };

  ProbeOptions o{.period_s = period_s};
  o.most_push_n = u.most_force;
  if (std::isfinite(u.most_force)) o.push_n = std::min(1.0, 0.2 * u.most_force);
  if (a.push_n > 0.0) o.push_n = a.push_n;
  o.kick_n = 0.5 * o.push_n;
  if (simulated) {
    o.trial_s = 4.0;
    o.wall_tolerance = 0.01;
    o.most_way_m = 1.0;
    o.most_speed_m_per_s = 10.0;
  }
  device->sense({Instant<MasterClock>{Duration{0}}, Seconds{period_s}});
  device->start();
  Probe p{runner, o};
  if (!a.json) print_info(info, scene.coordinates(), a.joint, limits, u, simulated);
  if (Device<1>* const gripper = device->gripper(); gripper != nullptr && !a.json)
    print_gripper(gripper->info(),
                  gripper->sense({Instant<MasterClock>{Duration{0}}, Seconds{period_s}}).x.translation()[0]);
  if (!moves && !a.json)
    fmt::print("\n{}\n", u.most_force > 0.0 ? "it is not moved: with --move it pushes itself, and nobody may hold it"
                                            : "it displays no force: friction and walls are not measured");
  p.listen();
  if (moves && !stop) p.push();
  // A device that has not moved would rest at every wall.
  const bool answers = std::isfinite(p.figures().latency_s) && !(p.figures().mass_kg <= 0.0);
  if (moves && answers && !stop) p.wall();
  device->release();
  const ProbeFigures& f = p.figures();
  if (!device->trouble().empty()) throw IoError{a.device + ": " + device->trouble()};
  if (a.json) {
    const auto json = [](double v) { return std::isfinite(v) ? fmt::format("{:.9g}", v) : std::string{"null"}; };
    fmt::print(
        "{{\"device\": \"{}\", \"simulated\": {}, \"{}\": {}, \"rate_hz\": {}, \"{}\": {}, \"latency_s\": {}, \"{}\": "
        "{}, "
        "\"{}\": {}, \"{}\": {}, \"fit\": {}, \"{}\": {}}}\n",
        info.name, simulated, u.json_force, json(u.most_force), json(f.rate_hz), u.json_small, json(f.resolution_m),
        json(f.latency_s), u.json_mass, json(f.mass_kg), u.json_damping, json(f.damping_n_s_per_m), u.json_friction,
        json(f.coulomb_friction_n), json(f.fit), u.json_wall, json(f.wall_n_per_m));
  } else {
    print_measured(f, period_s, moves, o.wall_tolerance, a.joint, u);
    if (a.joint == 0) print_scene(info, f);
  }
  return f.broken_off.empty() && (answers || !moves) ? 0 : 3;
}

int run(int argc, char** argv) {
  CLI::App app{"twoport-device: haptic devices, listed and measured"};
  app.set_version_flag("--version", "twoport-device " TWOPORT_VERSION);
  app.require_subcommand(1);
  Arguments a;
  CLI::App* list = app.add_subcommand("list", "One line for each NAME of --device");
  CLI::App* command =
      app.add_subcommand("probe", "What a device is, and its rate, resolution, latency, friction and stiffest wall");
  command->add_option("device", a.device, "NAME[:ARGS] or PATH.so[:ARGS], as for --device")->required();
  command->add_option("--scene", a.scene, "Scene that describes the device; dof and rate are its own");
  command->add_option("--dof", a.dof, "1, 3 or 6; the first axis is measured")
      ->check(CLI::IsMember({1, 3, 6}))
      ->capture_default_str();
  command->add_option("--joint", a.joint, "The device is an arm, joint by joint; this joint is measured, from 1")
      ->check(CLI::Range(1, kJointPort));
  command->add_option("--rate-hz", a.rate_hz, "Of the loop")->check(CLI::Range(1.0, 1e5))->capture_default_str();
  command->add_option("--push-n", a.push_n, "Push; absent: 1 N or N m, and at most a fifth of the device's force")
      ->check(CLI::Range(1e-3, 100.0));
  command->add_flag("--move", a.move,
                    "The device may push itself: take your hand away, and stay at the emergency stop");
  command->add_flag("--json", a.json, "Print figures as JSON");
  command->footer(
      "Exit status 3: a measurement was broken off. The simulated device is always moved, in virtual time.");
  return run_program(app, "twoport-device", argc, argv, [&] {
    if (list->parsed()) {
      std::fputs(all_drivers().devices.lines().c_str(), stdout);
      return 0;
    }
    const Scene scene = scene_of(a);
    return for_dof(scene.dof, [&]<int N>() { return probe<N>(a, scene); });
  });
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  return twoport::run(argc, argv);
}
