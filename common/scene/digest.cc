#include <bit>
#include <cstdint>
#include <string>
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

}  // namespace

std::uint64_t scene_digest(const Scene& scene) {
  // Taken apart by name: a new option does not compile until it is decided here whether both sides share it.
  // The handle's mass and the device's largest force are the master's own; the controller's method is that of the name.
  const auto& [architecture, coupling, force_scale, motion_scale, registration, method_name, controller, observer,
               accounts, reference_energy, initial_energy, handle_mass, handle_inertia, max_force, engage, hold_after,
               release_after] = scene.control;
  const auto& [stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation] = coupling;
  const auto& [method, max_gain, max_mobility, unilateral, predict, mass, radius_of_gyration, max_turn] = controller;
  Digest digest;
  digest.add(scene.dof, scene.master_rate_hz, scene.slave_rate_hz);
  digest.add(architecture, force_scale, motion_scale, observer, accounts, reference_energy, initial_energy);
  digest.add(engage, hold_after, release_after);
  const auto& [absolute, rotation, position] = registration;
  digest.add(absolute, rotation.w(), rotation.x(), rotation.y(), rotation.z());
  digest.add(position.x(), position.y(), position.z());
  digest.add(stiffness, damping, rotational_stiffness, rotational_damping, catch_up, drift_compensation);
  static_cast<void>(method), static_cast<void>(mass), static_cast<void>(radius_of_gyration);
  digest.add(method_name);
  digest.add(max_gain, max_mobility, unilateral, predict, max_turn);
  return digest.value();
}

}  // namespace twoport
