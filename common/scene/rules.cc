#include <algorithm>
#include <cmath>

#include "common/base/built_for.h"
#include "common/contact/environment.h"
#include "common/coupling/layers.h"
#include "common/link/playout.h"
#include "common/scene/blocks.h"
#include "common/scene/scene.h"

namespace twoport {
namespace {

using SceneBlock = Block<schema::Scene>;

/// Integrators that are maps of a linear motion need one: a mass on springs and at most one plane wall.
void check_integrator(const SceneBlock& scene, const Scene& values) {
  const Integrator i = values.simulation.integrator;
  if (i != Integrator::exact_per_tick && i != Integrator::trapezoidal) return;
  int walls = 0;
  bool linear = values.dof != 6;
  for (const EnvironmentSpec& e : values.environment)
    if (const auto* surface = std::get_if<Surface>(&e)) {
      ++walls;
      linear = linear && std::holds_alternative<Wall>(surface->shape) && surface->material.friction == 0.0;
    }
  if (!linear || walls > 1)
    scene.block(FIELD(simulation))
        .refuse(FIELD(integrator),
                "be another value here: it needs dof 1 or 3, springs and at most one wall without friction");
}

/// Without a link there is neither a robot nor a network.
void check_rendering(const SceneBlock& scene, const Scene& values) {
  if (values.control.architecture != Architecture::render) return;
  const auto refuse = [&](const auto& field) {
    if (scene.has(field))
      scene.fail(fmt::format("{} is given, but control.architecture is RENDER: there is no link", field.name));
  };
  refuse(FIELD(robot));
  refuse(FIELD(to_slave));
  refuse(FIELD(to_master));
  refuse(FIELD(slave_clock));
}

/// A moving anchor pulls at a body, not at an arm's links, beyond a link.
void check_moving_anchors(const SceneBlock& scene, const Scene& values) {
  const bool link = values.control.architecture != Architecture::render;
  if (link && !(values.robot && values.robot->arm)) return;
  for (const EnvironmentSpec& e : values.environment)
    if (const auto* spring = std::get_if<Spring>(&e); spring && spring->motion.amplitude_m != 0.0)
      scene.fail(fmt::format("environment.spring.anchor_motion is given, but {}",
                             link ? "robot.arm is too: it needs a robot without joints"
                                  : "control.architecture is RENDER: it needs a link"));
}

/// A force that reaches the handle later than it is commanded is none that a controller has booked.
void check_latency(const SceneBlock& scene, const Scene& values) {
  if (!values.device || !(values.device->force_latency_s > 0.0)) return;
  if (values.control.architecture != Architecture::render || !is_plain(values.control))
    scene.block(FIELD(device))
        .refuse(FIELD(force_latency_ms),
                fmt::format("be 0 unless control.architecture is RENDER and the method {}", kPlainMethod));
}

/// A spring of one contact point needs that point.
void check_contact_points(const SceneBlock& scene, const Scene& values) {
  for (const EnvironmentSpec& e : values.environment)
    if (const auto* spring = std::get_if<Spring>(&e);
        spring && spring->contact_point >= static_cast<int>(values.tool.size()) && spring->contact_point >= 0)
      scene.fail(fmt::format(
          "environment.spring.contact_point is {}; it must be < {}, the number of contact points of the tool",
          spring->contact_point, values.tool.size()));
}

template <int N>
bool starts_inside(const Scene& values) {
  const Environment<N> environment{values.environment, values.tool};
  return environment.potential(position<N>(values.device->position_m)) > Energy{};
}

/// A proxy and rigid surfaces: what they do not have may not be given.
void check_god_object(const SceneBlock& scene, const Scene& values) {
  if (values.control.rendering != RenderingAlgorithm::god_object) return;
  const Block control = scene.block(FIELD(control));
  if (values.control.architecture != Architecture::render)
    control.refuse(FIELD(rendering), "be PENALTY over a link; GOD_OBJECT needs control.architecture RENDER");
  control.require(FIELD(virtual_coupling),
                  "be given where control.rendering is GOD_OBJECT: it is the spring to the proxy");
  const Block coupling = control.block(FIELD(virtual_coupling));
  const auto need = [&](const auto& field, double value) {
    if (!(value > 0.0)) coupling.refuse(field, "be > 0 where control.rendering is GOD_OBJECT");
  };
  need(FIELD(stiffness_n_per_m), values.control.coupling.stiffness_n_per_m);
  if (values.dof == 6)
    need(FIELD(rotational_stiffness_n_m_per_rad), values.control.coupling.rotational_stiffness_n_m_per_rad);
  if (values.control.accounts != Accounts::total)
    control.block(FIELD(passivity))
        .refuse(FIELD(accounts), "be TOTAL where control.rendering is GOD_OBJECT: there is one spring");
  for (std::size_t i = 0; i < values.environment.size(); ++i) {
    const std::string path = fmt::format("environment[{}].{}", i, name(values.environment[i]));
    const auto* surface = std::get_if<Surface>(&values.environment[i]);
    if (surface == nullptr)
      scene.fail(fmt::format("{} is given, but control.rendering is GOD_OBJECT: it renders surfaces", path));
    if (surface->material.viscous_friction_n_s_per_m > 0.0)
      scene.fail(fmt::format(
          "{} has viscous friction, but control.rendering is GOD_OBJECT: it renders Coulomb friction only", path));
    if (surface->material.damping_n_s_per_m > 0.0)
      scene.fail(fmt::format("{} has damping, but control.rendering is GOD_OBJECT: it renders none", path));
  }
  // The proxy begins at the handle, so that it begins outside; the spring between them is at rest.
  if (!values.device) return;
  if (for_cartesian_dof(values.dof, "control.rendering", [&]<int N>() { return starts_inside<N>(values); }))
    scene.block(FIELD(device))
        .refuse(FIELD(position_m), "be outside of the environment where control.rendering is GOD_OBJECT");
}

/// UNCONTROLLED has a robot only.
void check_uncontrolled(const SceneBlock& scene, const Scene& values) {
  if (values.control.architecture != Architecture::uncontrolled) return;
  if (!values.robot) scene.fail("robot is missing; control.architecture UNCONTROLLED needs one");
  const auto refuse = [&](const auto& field) {
    if (scene.has(field))
      scene.fail(
          fmt::format("{} is given, but control.architecture is UNCONTROLLED: only the robot moves", field.name));
  };
  refuse(FIELD(operator_));
  refuse(FIELD(device));
  refuse(FIELD(to_slave));
  refuse(FIELD(to_master));
}

/// An arm at the hand is moved by forces: a hand's or none.
void check_arm_at_hand(const SceneBlock& scene, const Scene& values) {
  if (!values.device || !values.device->arm || !values.operator_model || values.operator_model->hand) return;
  scene.fail("device.arm is given, but operator.hand is missing; an arm does not follow an imposed path");
}

/// A handle that does not follow an imposed path moves by its own dynamics, and needs a mass.
void check_handle(const SceneBlock& scene, const Scene& values) {
  const bool held = values.operator_model && values.operator_model->hand;
  const bool free = values.device && !values.operator_model;
  if (!held && !free) return;
  const auto need = [&](const char* name, double DeviceSpec::*of_device, double HandSpec::*of_hand) {
    const double total =
        (values.device ? *values.device.*of_device : 0.0) + (held ? *values.operator_model->hand.*of_hand : 0.0);
    if (total > 0.0) return;
    scene.fail(fmt::format("device.{}{} is {}; it must be > 0: the handle moves by its own dynamics", name,
                           held ? fmt::format(" + operator.hand.{}", name) : "", total));
  };
  need("mass_kg", &DeviceSpec::mass_kg, &HandSpec::mass_kg);
  if (values.dof == 6) need("inertia_kg_m2", &DeviceSpec::inertia_kg_m2, &HandSpec::inertia_kg_m2);
}

/// No mass may oscillate by more than 1e4 rad in a tick, nor decay by more than e^-1e4: the plants are exact for any
/// stiffness, but their cost rises with it.
void check_fastest(const SceneBlock& scene, const Scene& values) {
  constexpr double kMost = 1e4;  // [rad] in a tick
  const auto check = [&](const char* what, double rate_hz, double mass, double damping, double stiffness) {
    const double turns = std::max(damping / mass, std::sqrt(stiffness / mass)) / rate_hz;
    if (mass > 0.0 && !(turns <= kMost))
      scene.fail(
          fmt::format("{} {:.3g} on stiffness {:.3g} and damping {:.3g} moves by {:.3g} rad in a tick; "
                      "it must be <= {:g}: leave out an element that is so stiff",
                      what, mass, stiffness, damping, turns, kMost));
  };
  const HandSpec hand =
      values.operator_model && values.operator_model->hand ? *values.operator_model->hand : HandSpec{};
  const DeviceSpec device = values.device.value_or(DeviceSpec{});
  check("device and operator.hand: mass", values.master_rate_hz, hand.mass_kg + device.mass_kg,
        hand.damping_n_s_per_m + device.damping_n_s_per_m, hand.stiffness_n_per_m);
  if (values.dof == 6)
    check("device and operator.hand: inertia", values.master_rate_hz, hand.inertia_kg_m2 + device.inertia_kg_m2,
          hand.rotational_damping_n_m_s_per_rad + device.rotational_damping_n_m_s_per_rad,
          hand.rotational_stiffness_n_m_per_rad);
  if (!values.robot) return;
  double stiffness = 0.0, damping = values.robot->damping_n_s_per_m;
  const World world{values.environment};
  for (const Surface& each : world.surfaces) {
    stiffness += each.material.stiffness_n_per_m;
    damping += each.material.damping_n_s_per_m;
  }
  for (const Spring& each : world.springs) {
    stiffness += each.stiffness_n_per_m;
    damping += each.damping_n_s_per_m;
  }
  check("robot and environment: mass", values.slave_rate_hz, values.robot->mass_kg, damping, stiffness);
  if (values.dof != 6 || values.robot->arm) return;
  double reach_m = 0.0;
  for (const Eigen::Vector3d& point : values.tool) reach_m = std::max(reach_m, point.norm());
  const std::vector<double>& inertia = values.robot->inertia_kg_m2;
  check("robot and environment: inertia", values.slave_rate_hz, *std::min_element(inertia.begin(), inertia.end()),
        values.robot->rotational_damping_n_m_s_per_rad + damping * reach_m * reach_m, stiffness * reach_m * reach_m);
}

/// A free body is stepped as finely as it turns.
void check_spin(const SceneBlock& scene, const Scene& values) {
  constexpr double kMost = 10.0;  // [rad] in a tick
  if (values.dof != 6 || !values.robot || values.robot->velocity_m_per_s.size() != 6) return;
  const std::vector<double>& twist = values.robot->velocity_m_per_s;
  const double angle = std::hypot(twist[3], twist[4], twist[5]) / values.slave_rate_hz;
  if (!(angle <= kMost))
    scene.fail(fmt::format("robot.velocity_m_per_s turns by {:.3g} rad in a tick; it must be <= {:g}", angle, kMost));
}

/// Two accounts, normal and tangential, for each contact.
void check_accounts(const SceneBlock& scene, const Scene& values) {
  constexpr std::size_t kMost = 4096;
  const std::size_t contacts = values.environment.size() * std::max<std::size_t>(values.tool.size(), 1);
  if (values.control.accounts == Accounts::per_contact && contacts > kMost)
    scene.fail(
        fmt::format("control.passivity.accounts is PER_CONTACT with {} contacts; it must be <= {}: environments "
                    "times contact points of the tool",
                    contacts, kMost));
}

/// A pause between packets and a wait in the playout buffer must not look like a silent link, nor hide one for long.
void check_transmission(const Block<schema::Impairment>& way, const TransmissionOptions& options,
                        const ControlOptions& c, double sender_rate_hz, SceneFor use) {
  constexpr double kSilent = 0.1;  // after which a live session takes its peer to be gone [s]
  const bool live = use == SceneFor::live && c.hold_after.si() > kSilent;
  const double most_silence = 0.5 * (live ? kSilent : c.hold_after.si());
  if (options.deadband && options.deadband->silence_s > most_silence * (1.0 + 1e-9))
    way.block(FIELD(deadband))
        .refuse(FIELD(silence_ms),
                fmt::format(
                    "be <= {:g}, half of {}: else one lost packet is a silent link", 1e3 * most_silence,
                    live ? "the 100 ms after which a live session takes its peer to be gone" : "control.hold_after_s"));
  const double room = static_cast<double>(kPlayoutRoom) / sender_rate_hz;
  const double most_wait = std::min(c.release_after.si(), room);
  if (options.playout_s > most_wait * (1.0 + 1e-9))
    way.refuse(FIELD(playout_ms),
               room < c.release_after.si()
                   ? fmt::format("be <= {:g}: the buffer has room for {} packets", 1e3 * most_wait, kPlayoutRoom)
                   : fmt::format("be <= {:g}, control.release_after_s: what waits hides that the link is silent",
                                 1e3 * most_wait));
}

/// Combinations of method, options and architecture that have no meaning.
void check_method(const ControlOptions& c, const Block<schema::Passivity>& passivity) {
  const TransparencyLayerName& transparency = transparency_layer(c);
  if (transparency.refusal != nullptr)
    if (const std::string_view why = transparency.refusal(c); !why.empty()) passivity.fail(std::string{why});
  if (c.architecture == Architecture::position_measured_force) {
    const std::string_view by_layer = transparency.refuses_measured_force,
                           why = by_layer.empty() ? method_entry(c).refuses_measured_force : by_layer;
    const std::string must = fmt::format("be another one under POSITION_MEASURED_FORCE: {}", why);
    if (!by_layer.empty() && passivity.has(FIELD(layer)))
      passivity.fail(fmt::format("control.transparency.layer is {}; it must {}", c.transparency, must));
    if (!why.empty()) passivity.refuse(FIELD(method), must);
  }
  if (const auto refusal = passivity_layer(c).refusal; refusal != nullptr)
    if (const std::string must{refusal(c)}; !must.empty()) {
      if (passivity.has(FIELD(layer))) passivity.refuse(FIELD(layer), must);
      passivity.refuse(FIELD(method), must);
    }
}

}  // namespace

void check_rules(const SceneBlock& scene, const Scene& values, SceneFor use) {
  check_integrator(scene, values);
  check_rendering(scene, values);
  check_moving_anchors(scene, values);
  check_god_object(scene, values);
  check_uncontrolled(scene, values);
  check_latency(scene, values);
  check_contact_points(scene, values);
  check_arm_at_hand(scene, values);
  check_handle(scene, values);
  check_fastest(scene, values);
  check_spin(scene, values);
  check_accounts(scene, values);
  check_transmission(scene.block(FIELD(to_slave)), values.transmission_to_slave, values.control, values.master_rate_hz,
                     use);
  check_transmission(scene.block(FIELD(to_master)), values.transmission_to_master, values.control, values.slave_rate_hz,
                     use);
  const auto control = scene.block(FIELD(control));
  check_method(values.control, control.block(FIELD(passivity)));
  const auto entries = control.blocks(FIELD(schedule));
  for (std::size_t i = 0; i < entries.size(); ++i)
    check_method(values.schedule[i].control, entries[i].block(FIELD(passivity)));
}

}  // namespace twoport
