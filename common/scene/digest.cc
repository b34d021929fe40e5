#include <bit>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/scene/load.h"

namespace twoport {
namespace {

/// FNV-1a, 64 bits, over bytes in a fixed order, so that it is the same on every machine.
class Digest {
 public:
  template <class... Values>
  void add(const Values&... values) {
    (mix(bits(values)), ...);
  }
  void add(const std::string& text) {
    for (const char c : text) add(static_cast<int>(c));
    add(-1);  // no text holds it: the next one begins here
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  static std::uint64_t bits(double number) { return std::bit_cast<std::uint64_t>(number + 0.0); }  // -0 is 0
  /// An option that is not given differs from every value.
  static std::uint64_t bits(const std::optional<double>& given) { return given ? bits(*given) : ~std::uint64_t{0}; }
  static std::uint64_t bits(std::uint64_t number) { return number; }
  static std::uint64_t bits(int number) { return static_cast<std::uint64_t>(number); }
  static std::uint64_t bits(bool flag) { return static_cast<std::uint64_t>(flag); }
  static std::uint64_t bits(Seconds t) { return bits(t.si()); }
  static std::uint64_t bits(Energy e) { return bits(e.si()); }
  template <class Enum>
  requires std::is_enum_v<Enum>
  static std::uint64_t bits(Enum choice) { return static_cast<std::uint64_t>(choice); }

  void mix(std::uint64_t bits) {
    for (int byte = 0; byte < 8; ++byte) value_ = (value_ ^ ((bits >> (8 * byte)) & 0xff)) * 0x100000001b3;
  }
  std::uint64_t value_ = 0xcbf29ce484222325;
};

/// The digest of all fields, and of each.
struct Digests {
  Digest all;
  std::vector<SharedField> fields;

  template <class... Values>
  void add(std::string_view path, const Values&... values) {
    Digest one;
    (one.add(values), ...);
    (all.add(values), ...);
    fields.push_back({path, one.value()});
  }
  /// A switch that came later: a scene without it keeps the digest that it had.
  void add_if_set(std::string_view path, bool set) {
    Digest one;
    one.add(set);
    if (set) all.add(set);
    fields.push_back({path, one.value()});
  }
};

Digests digests(const Scene& scene) {
  // Taken apart by name: a new option does not compile until it is decided here whether both sides share it.
  // The handle's mass and the device's largest force are the master's own; the controller's method is that of the name.
  const auto& [architecture, coupling, rendering, force_scale, motion_scale, registration, method_name, controller,
               observer, accounts, reference_energy, initial_energy, handle_mass, handle_inertia, max_force, engage,
               hold_after, release_after, device_limits, robot_limits, own_limits, known, stated_round_trip,
               fixed_damping, wave_variables, set_position_modulation, energy_tank, energy_bounding, four_channel,
               fractal_impedance, internal_model] = scene.control;
  const auto& [stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation] = coupling;
  const auto& [method, max_gain, max_mobility, unilateral, predict, mass, radius_of_gyration, max_turn] = controller;
  static_cast<void>(method), static_cast<void>(mass), static_cast<void>(radius_of_gyration);
  const auto& [absolute, rotation, position] = registration;
  Digests d;
  d.add("dof", scene.dof);
  d.add("master_rate_hz", scene.master_rate_hz);
  d.add("slave_rate_hz", scene.slave_rate_hz);
  d.add("control.architecture", architecture);
  d.add_if_set("control.rendering", rendering != RenderingAlgorithm::penalty);
  d.add("control.force_scale", force_scale);
  d.add("control.motion_scale", motion_scale);
  d.add("control.passivity.observer", observer);
  d.add("control.passivity.accounts", accounts);
  d.add("control.passivity.reference_energy", reference_energy);
  // Under internal-model control the account is the master's own, and its default that of the scene's delays.
  d.add("control.passivity.initial_energy_j",
        method_name == kDefaultMethod ? std::nullopt : std::optional{initial_energy.si()});
  d.add("control.engage_s", engage);
  d.add("control.hold_after_s", hold_after);
  d.add("control.release_after_s", release_after);
  d.add("control.registration", absolute, rotation.w(), rotation.x(), rotation.y(), rotation.z(), position.x(),
        position.y(), position.z());
  d.add("control.virtual_coupling.stiffness_n_per_m", stiffness);
  d.add("control.virtual_coupling.damping_n_s_per_m", damping);
  d.add("control.virtual_coupling.rotational_stiffness_n_m_per_rad", rotational_stiffness);
  d.add("control.virtual_coupling.rotational_damping_n_m_s_per_rad", rotational_damping);
  d.add("control.virtual_coupling.catch_up_m_per_s", catch_up);
  d.add("control.virtual_coupling.drift_compensation", drift_compensation);
  d.add("control.passivity.method", method_name);
  d.add("control.passivity.max_gain", max_gain, max_mobility);  // the latter is no field of a scene
  d.add("control.passivity.unilateral", unilateral);
  d.add("control.passivity.predict", predict);
  d.add("control.passivity.max_turn_deg", max_turn);
  for (const auto& [path, limits] :
       {std::pair{"control.device_limits", device_limits}, {"control.robot_limits", robot_limits}})
    d.add(path, limits.force_n, limits.torque_n_m, limits.force_rate_n_per_s, limits.power_w, limits.speed_m_per_s,
          limits.angular_speed_rad_per_s, limits.set_point_step_m, limits.workspace_m);
  static_cast<void>(own_limits);       // of this side's driver
  static_cast<void>(known);            // of the scene's device, robot and delays
  static_cast<void>(energy_bounding);  // of the master's device
  d.add("control.passivity.round_trip_ms", stated_round_trip ? std::optional{stated_round_trip->si()} : std::nullopt);
  {
    const auto& [damping_of, stiffness_of, rotational_damping_of, rotational_stiffness_of] = fixed_damping;
    d.add("control.passivity.fixed_damping", damping_of, stiffness_of, rotational_damping_of, rotational_stiffness_of);
  }
  {
    const auto& [impedance, rotational_impedance, receiver, correction] = wave_variables;
    d.add("control.passivity.wave_variables", impedance, rotational_impedance, receiver, correction);
  }
  {
    const auto& [k, b, k_rotational, b_rotational, ceiling] = set_position_modulation;
    d.add("control.passivity.set_position_modulation", k, b, k_rotational, b_rotational, ceiling);
  }
  {
    const auto& [desired_level, level_gain, transfer] = energy_tank;
    d.add("control.passivity.energy_tank", desired_level, level_gain, transfer);
  }
  {
    const auto& [observer_used, bandwidth, force_gain, disturbance_observer] = four_channel;
    d.add("control.passivity.four_channel", observer_used, bandwidth, force_gain);
    d.add_if_set("control.passivity.four_channel.disturbance_observer", disturbance_observer);
  }
  {
    const auto& [k, k_rotational] = fractal_impedance;
    d.add("control.passivity.fractal_impedance", k, k_rotational);
  }
  {
    const auto& [strict_two_port] = internal_model;
    d.add_if_set("control.passivity.internal_model.strict_two_port", strict_two_port);
  }
  // What is switched to, each as a scene of its own; when is the master's own. A scene without a schedule has the digest that it
  // had before there were any.
  Digest switches;
  for (const ScheduledControl& entry : scene.schedule) {
    Scene then = scene;
    then.schedule.clear();
    then.control = entry.control;
    switches.add(digests(then).all.value());
  }
  d.fields.push_back({"control.schedule", switches.value()});
  if (!scene.schedule.empty()) d.all.add(switches.value());
  // As a scene of its own. A scene without a gripper has the digest that it had before there were any.
  const std::uint64_t gripper = scene.gripper ? digests(*scene.gripper).all.value() : 0;
  d.fields.push_back({"gripper", gripper});
  if (scene.gripper) d.all.add(gripper);
  return d;
}

}  // namespace

std::uint64_t scene_digest(const Scene& scene) {
  return digests(scene).all.value();
}

std::vector<SharedField> shared_fields(const Scene& scene) {
  return digests(scene).fields;
}

}  // namespace twoport
