#include "common/scene/hints.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <variant>

#include "common/arm/arm_model.h"
#include "common/base/built_for.h"
#include "common/contact/environment.h"
#include "common/coupling/claim.h"
#include "common/scene/held_coupling.h"
#include "common/scene/shown.h"
#include "common/scene/source.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

/// A length of the scene: its path and its largest coordinate.
struct Length {
  std::string path;
  double metres = 0.0;
};

/// Looks at every length that `block` and the blocks within give; `path`: of the block, with a dot.
void look_at(const pb::Message& block, const std::string& path, Length& largest) {
  static const std::set<std::string> kLengths{"position_m", "center_m", "point_m",  "half_size_m", "anchor_m",
                                              "offset_m",   "radius_m", "travel_m", "amplitude_m"};
  const pb::Reflection& r = *block.GetReflection();
  std::vector<const pb::FieldDescriptor*> given;
  r.ListFields(block, &given);
  for (const pb::FieldDescriptor* const field : given) {
    const bool list = field->is_repeated();
    for (int i = 0; i < (list ? r.FieldSize(block, field) : 1); ++i) {
      const std::string name = path + field->name();
      if (field->message_type() != nullptr) {
        const pb::Message& inner = list ? r.GetRepeatedMessage(block, field, i) : r.GetMessage(block, field);
        look_at(inner, list ? fmt::format("{}[{}].", name, i) : name + ".", largest);
      } else if (kLengths.contains(field->name())) {
        const double v = std::abs(list ? r.GetRepeatedDouble(block, field, i) : r.GetDouble(block, field));
        if (v > largest.metres) largest = {name, v};
      }
    }
  }
}

Length largest_length(const Scene& scene) {
  Length largest;
  if (!scene.source) return largest;
  const schema::Scene& message = scene.source->message;
  look_at(message.device(), "device.", largest);
  look_at(message.robot(), "robot.", largest);
  look_at(message.operator_(), "operator.", largest);
  for (int i = 0; i < message.environment_size(); ++i)
    look_at(message.environment(i), fmt::format("environment[{}].", i), largest);
  return largest;
}

/// Where a number is probably a thousand times what was meant, or a thousandth.
struct UnitMistake {
  std::string_view block, field;  ///< block: its path, or a beginning of it
  double least, most;             ///< of a value that is not 0
  const char *quantities, *unit, *small, *large;
};
constexpr UnitMistake kUnitMistakes[] = {
    {"device", "mass_kg", 1e-3, 10.0, "masses", "kilograms", "g", "t"},
    {"operator.hand", "mass_kg", 1e-3, 10.0, "masses", "kilograms", "g", "t"},
    {"robot", "mass_kg", 1e-3, 200.0, "masses", "kilograms", "g", "t"},
    {"device", "inertia_kg_m2", 0.0, 5.0, "inertias", "kg m²", "g m²", ""},
    {"operator.hand", "inertia_kg_m2", 0.0, 5.0, "inertias", "kg m²", "g m²", ""},
    {"robot", "inertia_kg_m2", 0.0, 50.0, "inertias", "kg m²", "g m²", ""},
    {"operator.hand", "stiffness_n_per_m", 1.0, 1e5, "stiffnesses", "N/m", "mN/m", "N/mm"},
    {"environment", "stiffness_n_per_m", 20.0, 2e6, "stiffnesses", "N/m", "mN/m", "N/mm"},
    {"control.virtual_coupling", "stiffness_n_per_m", 20.0, 2e5, "stiffnesses", "N/m", "mN/m", "N/mm"},
    {"device", "max_force_n", 0.05, 2e3, "forces", "newtons", "mN", "kN"},
    {"control.device_limits", "force_n", 0.05, 2e3, "forces", "newtons", "mN", "kN"},
    {"control.robot_limits", "force_n", 0.05, 5e3, "forces", "newtons", "mN", "kN"},
    {"control.device_limits", "speed_m_per_s", 1e-3, 20.0, "speeds", "m/s", "mm/s", "km/s"},
    {"control.robot_limits", "speed_m_per_s", 1e-3, 20.0, "speeds", "m/s", "mm/s", "km/s"},
};

/// The first number that `block` and the blocks within give in another unit, it seems; empty: none.
std::string unit_mistake(const pb::Message& block, const std::string& path) {
  const pb::Reflection& r = *block.GetReflection();
  std::vector<const pb::FieldDescriptor*> given;
  r.ListFields(block, &given);
  for (const pb::FieldDescriptor* const field : given)
    for (int i = 0; i < (field->is_repeated() ? r.FieldSize(block, field) : 1); ++i) {
      const bool list = field->is_repeated();
      if (field->message_type() != nullptr) {
        // A spring may be as soft as it likes, and an arm's numbers stand in its file.
        if (field->name() == "spring" || field->name() == "arm") continue;
        const std::string name = (path.empty() ? "" : path + ".") + field->name();
        std::string found = unit_mistake(list ? r.GetRepeatedMessage(block, field, i) : r.GetMessage(block, field),
                                         list ? fmt::format("{}[{}]", name, i) : name);
        if (!found.empty()) return found;
      } else if (field->cpp_type() == pb::FieldDescriptor::CPPTYPE_DOUBLE) {
        const double value = list ? r.GetRepeatedDouble(block, field, i) : r.GetDouble(block, field);
        for (const UnitMistake& m : kUnitMistakes) {
          if (field->name() != m.field || !path.starts_with(m.block) || value == 0.0 ||
              (value >= m.least && value <= m.most))
            continue;
          const bool much = value > m.most;
          return fmt::format("{}.{} is {:g}; {} are in {}, and {:g} {} are {:g}", path, field->name(), value,
                             m.quantities, m.unit, value, much ? m.small : m.large, (much ? 1e-3 : 1e3) * value);
        }
      }
    }
  return {};
}

/// Inertia of the robot that is that of no tool of its mass: all of it 0.5 m from an axis, or 3 mm.
std::string inertia_mistake(const Scene& s) {
  constexpr double kLeast = 1e-5, kMost = 0.25;  // of inertia/mass [m²]
  if (!s.source || !(s.source->message.robot().mass_kg() > 0.0)) return {};
  const double mass = s.source->message.robot().mass_kg();
  for (const double inertia : s.source->message.robot().inertia_kg_m2()) {
    const double ratio = inertia / mass;
    if (!(inertia > 0.0) || (ratio >= kLeast && ratio <= kMost)) continue;
    return fmt::format(
        "robot.inertia_kg_m2 is {:g}, of {:g} kg that are {:.2g} m from the axis; inertias are in kg m², and {:g} {} "
        "are {:g}",
        inertia, mass, std::sqrt(ratio), inertia, ratio > kMost ? "g m²" : "t m²",
        (ratio > kMost ? 1e-3 : 1e3) * inertia);
  }
  return {};
}

/// The surface that a point of the handle or the tool at this position is inside of by more than 0.1 mm, and how deep.
struct Inside {
  std::size_t surface;
  double depth_m;
};
std::optional<Inside> starts_inside(const Scene& s, const Numbers& at) {
  constexpr double kDeep_m = 1e-4;
  if (s.joints > 0 || !built_for(s.dof)) return {};
  std::vector<Eigen::Vector3d> points = s.tool;
  if (points.empty()) points.emplace_back(Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i < s.environment.size(); ++i) {
    const auto* surface = std::get_if<Surface>(&s.environment[i]);
    if (surface == nullptr) continue;
    double depth_m = 0.0;
    for (const Eigen::Vector3d& point : points) {
      const double energy_j = for_cartesian_dof(s.dof, "dof", [&]<int N>() {
        return Environment<N>{{*surface}, {point}}.potential(position<N>(at)).si();
      });
      depth_m = std::max(depth_m, std::sqrt(2.0 * energy_j / surface->material.stiffness_n_per_m));
    }
    if (depth_m > kDeep_m) return Inside{i, depth_m};
  }
  return {};
}
std::string pushed_out(const Scene& s, const char* path, const Numbers& at) {
  const auto inside = starts_inside(s, at);
  if (!inside) return {};
  return fmt::format("{} is {:.3g} mm inside environment[{}].{}, which pushes it out before anything is coupled", path,
                     1e3 * inside->depth_m, inside->surface, name(s.environment[inside->surface]));
}

bool has_link(const Scene& scene) {
  return scene.control.architecture != Architecture::render && scene.control.architecture != Architecture::uncontrolled;
}

bool delays(const ImpairmentOptions& way) {
  return way.delay_s > 0.0 || way.jitter_s > 0.0 || !way.recorded_delay_s.empty();
}

/// A motion of the robot that is unstable on the virtual coupling alone, which then makes energy at the robot's port, where no
/// controller acts.
struct FedMotion {
  const char *inertia_name, *damping_name, *units[2];  ///< fields of the scene; units of K, B
  double inertia, stiffness, damping;
  std::optional<std::pair<double, double>> holding;  ///< between which dampings it is stable; empty: with none
};

/// The dampings between which `holds`; they are looked for around `near`. Empty: there are none.
std::optional<std::pair<double, double>> holding_dampings(const auto& holds, double near) {
  constexpr double kStep = 1.1, kFarthest = 1e4;
  std::optional<std::pair<double, double>> found;
  for (double d = near / kFarthest; d < near * kFarthest; d *= kStep)
    if (holds(d)) found = {found ? found->first : d, d};
  if (!found) return {};
  // From one that holds towards one that does not.
  const auto edge = [&](double held, double lost) {
    for (int i = 0; i < 20; ++i) (holds(0.5 * (held + lost)) ? held : lost) = 0.5 * (held + lost);
    return held;
  };
  return std::pair{holds(0.0) ? 0.0 : edge(found->first, found->first / kStep),
                   edge(found->second, found->second * kStep)};
}

std::optional<FedMotion> fed_by_coupling(const Scene& s) {
  if (!has_link(s) || !s.robot || s.joints > 0 || !s.expect.stable.value_or(true) ||
      coupling_holds_robot(s, s.control.coupling))
    return {};
  const bool arm = s.robot->arm.has_value();
  const CouplingOptions& c = s.control.coupling;
  CouplingOptions translation = c;
  translation.rotational_stiffness_n_m_per_rad = translation.rotational_damping_n_m_s_per_rad = 0.0;
  const auto holding = [&](CouplingOptions with, double CouplingOptions::*damping, double inertia) {
    const auto holds = [&](double d) {
      with.*damping = d;
      return coupling_holds_robot(s, with);
    };
    return holding_dampings(holds, 2.0 * inertia * s.slave_rate_hz);
  };
  // Where each motion alone is held, it is the smaller inertia of both together.
  if (s.dof == 6 && coupling_holds_robot(s, translation)) {
    const double inertia = *std::min_element(s.robot->inertia_kg_m2.begin(), s.robot->inertia_kg_m2.end());
    return FedMotion{arm ? "the effective inertia of robot.arm," : "robot.inertia_kg_m2",
                     "rotational_damping_n_m_s_per_rad",
                     {"N m/rad", "N m s/rad"},
                     inertia,
                     c.rotational_stiffness_n_m_per_rad,
                     c.rotational_damping_n_m_s_per_rad,
                     holding(c, &CouplingOptions::rotational_damping_n_m_s_per_rad, inertia)};
  }
  return FedMotion{arm ? "the effective mass of robot.arm," : "robot.mass_kg",
                   "damping_n_s_per_m",
                   {"N/m", "N s/m"},
                   s.robot->mass_kg,
                   c.stiffness_n_per_m,
                   c.damping_n_s_per_m,
                   holding(translation, &CouplingOptions::damping_n_s_per_m, s.robot->mass_kg)};
}

/// K T²/m of the stiffest rendered surface: from 0.05 on the motion of a tick changes by what the force of that tick does, and a
/// controller that only scales the force lets energy pass. Measured: all of 9 walls from 0.067 on but one, none up to 0.027.
constexpr double kFastHandle = 0.05;
double stiffest_surface(const Scene& s) {
  double most = 0.0;
  for (const EnvironmentSpec& each : s.environment)
    if (const auto* surface = std::get_if<Surface>(&each)) most = std::max(most, surface->material.stiffness_n_per_m);
  return most;
}
double rendered_ratio(const Scene& s) {
  if (s.control.architecture != Architecture::render || !s.device || !(s.device->mass_kg > 0.0)) return 0.0;
  return stiffest_surface(s) / (s.device->mass_kg * s.rate_hz * s.rate_hz);
}

/// √(K/m) T of a robot without an arm on the stiffest surface whose contact is not solved in closed form. From about 2 on, a period of it
/// is 3 ticks: ticks in contact then take hundreds of integrator steps. Measured on a rough cylinder: 30 µs a tick at 0.9, 430 at 2.7,
/// 1,300 at 16; without friction 8, 14 and 980.
constexpr double kFastContact = 2.0;
double fastest_contact(const Scene& s) {
  const bool sizes_its_steps =
      s.simulation.integrator == Integrator::exact || s.simulation.integrator == Integrator::dormand_prince;
  if (!s.robot || s.robot->arm || !sizes_its_steps || s.control.architecture == Architecture::render) return 0.0;
  std::size_t surfaces = 0;
  const bool closed_form = s.dof != 6 && s.simulation.integrator == Integrator::exact &&
                           std::all_of(s.environment.begin(), s.environment.end(), [&](const EnvironmentSpec& e) {
                             const auto* of = std::get_if<Surface>(&e);
                             return of == nullptr || (++surfaces == 1 && std::holds_alternative<Wall>(of->shape) &&
                                                      (s.dof == 1 || of->material.friction == 0.0));
                           });
  return closed_form ? 0.0 : std::sqrt(stiffest_surface(s) / s.robot->mass_kg) / s.slave_rate_hz;
}

/// Where energy is exchanged a limit of the rate is kept as one of the force, T/2 of it (unheld_share); below this it is little.
constexpr double kLittle_n = 2.0;
/// The limit of rate that leaves the least force, and that force; empty: none leaves little.
std::optional<std::pair<const char*, double>> slow_limit(const Scene& s) {
  if (!has_link(s) || !exchanges_energy(s.control)) return {};
  const double device_n = 0.5 * s.control.device_limits.force_rate_n_per_s / s.rate_hz;
  const double robot_n = 0.5 * s.control.robot_limits.force_rate_n_per_s / s.slave_rate_hz;
  if (std::min(device_n, robot_n) >= kLittle_n) return {};
  return device_n < robot_n ? std::pair{"device_limits", device_n} : std::pair{"robot_limits", robot_n};
}

/// An arm of the scene and its block's path.
struct NamedArm {
  const char* path;
  const ArmSpec* arm;
  const Numbers* position_m;
};
std::vector<NamedArm> arms(const Scene& s) {
  std::vector<NamedArm> all;
  if (s.robot && s.robot->arm) all.push_back({"robot.arm", &*s.robot->arm, &s.robot->position_m});
  if (s.device && s.device->arm) all.push_back({"device.arm", &*s.device->arm, &s.device->position_m});
  return all;
}

/// The first joint that cannot hold arm and tool at rest at the first position, counted from 1, the torque that it needs there, what it has,
/// and the largest mass of a tool that it can hold. Weight torques are linear in that mass.
struct TooHeavy {
  std::size_t joint = 0;
  double needs = 0.0, has = 0.0, most_kg = 0.0;
};
TooHeavy too_heavy(const NamedArm& of) {
  if constexpr (!built_for(6)) return {};
  const ArmSpec& arm = *of.arm;
  const Eigen::Vector3d gravity{0.0, 0.0, -9.81};
  const ArmModel::Joints q = joint_vector(arm.joint_position_rad);
  const Eigen::Matrix3d flange = ArmModel{*arm.parameters}.pose(q).tool_rotation;
  const Eigen::Matrix3d tool = flange.transpose() * position<6>(*of.position_m).attitude().toRotationMatrix();
  const auto torque = [&](double mass) {
    const ArmModel model{*arm.parameters, {.mass_kg = mass, .center_m = vector<3>(arm.tool_center_m)}, tool};
    return model.gravity_torque(model.pose(q), gravity);
  };
  const ArmModel::Joints alone = torque(0.0), each = torque(1.0) - alone;
  TooHeavy found;
  double least = arm.tool_mass_kg;
  for (int i = 0; i < q.size(); ++i) {
    const double has = arm.parameters->joints[static_cast<std::size_t>(i)].max_effort;
    const double most = each[i] > 0.0   ? (has - alone[i]) / each[i]
                        : each[i] < 0.0 ? (-has - alone[i]) / each[i]
                                        : std::numeric_limits<double>::infinity();
    if (most < least)
      least = most, found = {static_cast<std::size_t>(i) + 1, std::abs(alone[i] + arm.tool_mass_kg * each[i]), has,
                             std::max(0.0, most)};
  }
  return found;
}
/// Torques are held for a tick, in which weight and inertial forces change: joints of arms are controlled at 1 kHz.
constexpr double kSlowArm_hz = 200.0;
double arm_rate_hz(const Scene& s) {
  return s.robot && s.robot->arm ? s.slave_rate_hz : s.rate_hz;
}

/// Which of the environment moves by itself.
std::optional<std::size_t> moving_anchor(const Scene& scene) {
  for (std::size_t i = 0; i < scene.environment.size(); ++i)
    if (const auto* spring = std::get_if<Spring>(&scene.environment[i]); spring && spring->motion.amplitude_m > 0.0)
      return i;
  return {};
}

/// What an option takes of a claim; empty: nothing.
std::string what_voids(const ControlOptions& o) {
  using enum StandingClaim::Voided;
  const std::string layer = o.passivity.empty() ? o.method_name : o.passivity;
  const auto rate = [&](const char* side, const PortLimits& limits) {
    return fmt::format(
        "control.{}_limits.force_rate_n_per_s is {:g}: a force may outlast the account of {}; a rate of twice force_n "
        "in a tick or more cannot act",
        side, limits.force_rate_n_per_s, layer);
  };
  switch (standing_claim(o).voided) {
    case nothing:
      return {};
    case observer:
      return fmt::format(
          "control.passivity.observer is RECTANGLE, which misses energy: {} does not keep its claim; EXACT does",
          layer);
    case device_rate:
      return rate("device", limits_at_device(o));
    case robot_rate:
      return rate("robot", limits_at_robot(o));
    case ideal_robot:
      return fmt::format(
          "the robot is ideal: it goes to its set point whatever force that takes, of which {} has no account", layer);
    case prediction:
      return fmt::format("{} does not predict the handle's motion: {}", layer,
                         o.controller.predict ? "its mass is not known" : "control.passivity.predict is false");
    case measured_force:
      return fmt::format("the force sensor's force is displayed, of which {} at the robot has no account", layer);
    case link_damper:
      return fmt::format("{} has a brake at the robot beside the account of {}", o.transparency, layer);
    case option:
      return std::string{passivity_layer(o).voids_hand(o)};
  }
  return {};
}
/// Is it said when the scene is read? What belongs to the pair of layers stands in the table of claims, the defaults of a live run in
/// that of limits.
bool is_said(const ControlOptions& o) {
  using enum StandingClaim::Voided;
  switch (standing_claim(o).voided) {
    case observer:
    case prediction:
    case option:
      return true;
    case device_rate:
      return o.device_limits.force_rate_n_per_s != kDeviceDefaults.force_rate_n_per_s;
    case robot_rate:
      return o.robot_limits.force_rate_n_per_s != kRobotDefaults.force_rate_n_per_s;
    default:
      return false;
  }
}

struct Hint {
  std::string (*sentence)(const Scene&);  ///< empty: it does not apply
  bool of_simulated_device = false;       ///< said of a simulated device only
};

constexpr double kLong = 5.0;  // [m]

constexpr Hint kHints[] = {
    {[](const Scene& s) {
      const Length length = largest_length(s);
      if (!(length.metres > kLong)) return std::string{};
      return fmt::format("{} is {:g} m; lengths are in metres, and {:g} mm are {:g}", length.path, length.metres,
                         length.metres, 1e-3 * length.metres);
    }},
    {[](const Scene& s) {
      const std::string said = s.source ? unit_mistake(s.source->message, "") : std::string{};
      return said.empty() ? inertia_mistake(s) : said;
    }},
    {[](const Scene& s) {
       const bool pressed = s.operator_model && s.operator_model->hand && !s.operator_model->hand->force_n.empty();
       const bool renders = s.control.architecture == Architecture::render && s.device;
       return renders && !pressed ? pushed_out(s, "device.position_m", s.device->position_m) : std::string{};
     },
     true},
    {[](const Scene& s) {
      return has_link(s) && s.robot ? pushed_out(s, "robot.position_m", s.robot->position_m) : std::string{};
    }},
    {[](const Scene& s) -> std::string {
       return has_link(s) && s.device && !s.operator_model ? "operator is absent: no hand holds the handle" : "";
     },
     true},
    {[](const Scene& s) {
      const bool delayed = has_link(s) && (delays(s.to_slave) || delays(s.to_master));
      if (!delayed || !s.expect.stable.value_or(true) || !is_plain(s.control)) return std::string{};
      return fmt::format(
          "control.passivity.method is {} and the link delays: the loop may be unstable; {}, the default, holds it",
          s.control.method_name, kDefaultMethod);
    }},
    {[](const Scene& s) {
      const std::optional<FedMotion> of = fed_by_coupling(s);
      if (!of) return std::string{};
      const std::string needs =
          of->holding
              ? fmt::format("needs a damping between about {:.3g} and {:.3g} {}, and {} is {:g}", of->holding->first,
                            of->holding->second, of->units[1], of->damping_name, of->damping)
              : std::string{"is too stiff for any damping"};
      return fmt::format(
          "control.virtual_coupling makes the robot unstable, whatever the link does: {} {:g} on {:g} {} at {:g} Hz "
          "{}",
          of->inertia_name, of->inertia, of->stiffness, of->units[0], s.slave_rate_hz, needs);
    }},
    {[](const Scene& s) {
      for (const NamedArm& arm : arms(s))
        if (const TooHeavy of = too_heavy(arm); of.joint != 0)
          return fmt::format(
              "{}: joint {} needs {:.3g} N m to carry arm and tool at the first position and has {:.3g}, so the arm "
              "sinks and follows no command; tool_mass_kg is {:g}, and may be {:.3g} there",
              arm.path, of.joint, of.needs, of.has, arm.arm->tool_mass_kg, of.most_kg);
      return std::string{};
    }},
    {[](const Scene& s) {
      if (arms(s).empty() || arm_rate_hz(s) >= kSlowArm_hz) return std::string{};
      return fmt::format(
          "{} is given at {:g} Hz: torques of an arm are held for {:.3g} ms, in which its weight changes; use {:g} Hz "
          "or more",
          arms(s)[0].path, arm_rate_hz(s), 1e3 / arm_rate_hz(s), kSlowArm_hz);
    }},
    {[](const Scene& s) {
      const Integrator i = s.simulation.integrator;
      if (arms(s).empty() || i == Integrator::exact || i == Integrator::rk4) return std::string{};
      return fmt::format("simulation.integrator does not apply to {}, which is stepped by RK4", arms(s)[0].path);
    }},
    {[](const Scene& s) {
      const double fastest = fastest_contact(s), at_rate = kFastContact * s.slave_rate_hz;
      if (!(fastest > kFastContact)) return std::string{};
      return fmt::format(
          "robot.mass_kg is {:g}: on a surface of {:g} N/m it swings at {:.3g} kHz, too fast for ticks of {:g} Hz; "
          "the run is slow, as a tick in contact takes hundreds of steps of the integrator; use {:.2g} kg or more",
          s.robot->mass_kg, stiffest_surface(s), 1e-3 * fastest * s.slave_rate_hz / (2.0 * std::numbers::pi),
          s.slave_rate_hz, stiffest_surface(s) / (at_rate * at_rate));
    }},
    {[](const Scene& s) {
      const auto slow = slow_limit(s);
      if (!slow) return std::string{};
      return fmt::format(
          "control.{}.force_rate_n_per_s and the passivity layer {} together leave a force of at most {:.3g} N: what "
          "may not fall at once is not shown",
          slow->first, s.control.passivity, slow->second);
    }},
    {[](const Scene& s) {
      if (s.control.controller.method != Method::force_projected || !(rendered_ratio(s) > kFastHandle) ||
          !s.expect.stable.value_or(true))
        return std::string{};
      return fmt::format(
          "rate_hz is {:g}: FORCE_PROJECTED may let energy pass at a rendered {:g} N/m with a handle of {:g} kg, as "
          "the handle turns back within a tick; it holds from about {:.0f} Hz",
          s.rate_hz, stiffest_surface(s), s.device->mass_kg,
          std::sqrt(stiffest_surface(s) / (kFastHandle * s.device->mass_kg)));
    }},
    {what_voids_claim},
    {[](const Scene& s) {
      const auto moving = moving_anchor(s);
      if (!moving || passivity_layer(s.control).passes_on.empty()) return std::string{};
      return fmt::format(
          "environment[{}].spring.anchor_motion puts energy in, and control.passivity.layer {} gives the hand no more "
          "of it than E(0); {} passes it on",
          *moving, s.control.passivity, passivity_layer(s.control).passes_on);
    }},
};

}  // namespace

std::string what_voids_claim(const Scene& s) {
  if (!has_link(s)) return {};
  if (is_said(s.control)) return what_voids(s.control);
  for (const ScheduledControl& entry : s.schedule)
    if (is_said(entry.control)) return what_voids(entry.control);
  return {};
}

std::string claim_that_holds(const Scene& s) {
  if (!has_link(s)) return {};
  std::string text{to_string(claim_of(s.control, s.schedule))}, why = what_voids(s.control);
  for (const ScheduledControl& entry : s.schedule)
    if (why.empty()) why = what_voids(entry.control);
  return why.empty() ? text : text + ": " + why;
}

std::vector<std::string> hints(const Scene& scene, bool device_is_simulated) {
  std::vector<std::string> all;
  for (const Hint& hint : kHints)
    if (device_is_simulated || !hint.of_simulated_device)
      if (std::string sentence = hint.sentence(scene); !sentence.empty()) all.push_back(std::move(sentence));
  std::ranges::move(left_out_of_meshes(scene), std::back_inserter(all));
  return all;
}

std::vector<std::string> live_hints(const Scene& scene, bool device_is_simulated) {
  std::vector<std::string> all = hints(scene, device_is_simulated);
  if (scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0)
    all.emplace_back("slave_clock is ignored: it is for the laboratory, here each side has the clock of its machine");
  return all;
}

}  // namespace twoport
