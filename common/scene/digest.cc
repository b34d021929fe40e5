#include <bit>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

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
  /// An option of a method: those given, by their place in the block. A scene without them has the digest it had before
  /// there was such an option.
  void add_given(std::string_view block, std::initializer_list<std::optional<double>> options) {
    int place = 0;
    for (const auto& each : options) {
      ++place;
      if (!each) continue;
      add(std::string{block});
      add(place, *each);
    }
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  static std::uint64_t bits(double number) { return std::bit_cast<std::uint64_t>(number + 0.0); }  // -0 is 0
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

std::optional<double> unless_zero(double value) {
  return value != 0.0 ? std::optional{value} : std::nullopt;
}

}  // namespace

std::uint64_t scene_digest(const Scene& scene) {
  // Taken apart by name: a new option does not compile until it is decided here whether both sides share it.
  // The handle's mass and the device's largest force are the master's own; the controller's method is that of the name.
  const auto& [architecture, coupling, force_scale, motion_scale, registration, method_name, controller, observer,
               accounts, reference_energy, initial_energy, handle_mass, handle_inertia, max_force, engage, hold_after,
               release_after, known, stated_round_trip, fixed_damping, wave_variables, set_position_modulation,
               energy_tank, energy_bounding, four_channel, fractal_impedance] = scene.control;
  const auto& [stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation] = coupling;
  const auto& [method, max_gain, unilateral, predict] = controller;
  Digest digest;
  digest.add(scene.dof, scene.master_rate_hz, scene.slave_rate_hz);
  digest.add(architecture, force_scale, motion_scale, observer, accounts, reference_energy, initial_energy);
  digest.add(engage, hold_after, release_after);
  const auto& [absolute, rotation, position] = registration;
  digest.add(absolute, rotation.w(), rotation.x(), rotation.y(), rotation.z());
  digest.add(position.x(), position.y(), position.z());
  digest.add(stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation);
  static_cast<void>(method);
  static_cast<void>(known);  // of the scene's device, robot and delays
  digest.add(method_name);
  digest.add(max_gain, unilateral, predict);
  if (stated_round_trip) digest.add_given("round_trip", {stated_round_trip->si()});
  {
    const auto& [damping_of, stiffness_of, rotational_damping_of, rotational_stiffness_of] = fixed_damping;
    digest.add_given("fixed_damping", {damping_of, stiffness_of, rotational_damping_of, rotational_stiffness_of});
  }
  {
    const auto& [impedance, rotational_impedance, receiver, correction] = wave_variables;
    digest.add_given("wave_variables", {impedance, rotational_impedance, unless_zero(static_cast<double>(receiver)),
                                        unless_zero(correction)});
  }
  {
    const auto& [k, b, k_rotational, b_rotational, ceiling] = set_position_modulation;
    digest.add_given("set_position_modulation", {k, b, k_rotational, b_rotational, ceiling});
  }
  {
    const auto& [desired_level, level_gain, transfer] = energy_tank;
    digest.add_given("energy_tank", {desired_level, level_gain, transfer});
  }
  static_cast<void>(energy_bounding);  // of the master's device
  {
    const auto& [observer_used, bandwidth, force_gain] = four_channel;
    digest.add_given("four_channel", {unless_zero(observer_used ? 1.0 : 0.0), bandwidth, force_gain});
  }
  {
    const auto& [k, k_rotational] = fractal_impedance;
    digest.add_given("fractal_impedance", {k, k_rotational});
  }
  return digest.value();
}

}  // namespace twoport
