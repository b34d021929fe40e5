#pragma once

#include <string_view>

namespace twoport {

/// A method over a link is a transparency layer and a passivity layer.
///
///     wanted    = transparency layer: what the hand should feel and what the robot should do; it may be wrong
///     displayed = passivity layer: how much of it the energy of the port allows
///
/// These lists are the names of scenes, of `twoport-lab methods` and of tables. common/method/classes.h has the classes.

/// Which port a passivity layer bounds: the energy that it returns is at most what it was given plus E(0).
enum class Claim : unsigned char {
  none,
  hand,  ///< of the hand's port, for any reports
  both,  ///< of the hand's and the robot's port together, for honest reports
};

constexpr std::string_view to_string(Claim claim) {
  return claim == Claim::none ? "none" : claim == Claim::hand ? "hand" : "both";
}

struct TransparencyLayerName {
  std::string_view name, summary;
};
struct PassivityLayerName {
  std::string_view name;
  Claim claim;
  std::string_view summary;
};
/// A named pair; a method of one piece has no layers.
struct MethodName {
  std::string_view name, transparency, passivity, summary;
  [[nodiscard]] constexpr bool one_piece() const { return transparency.empty(); }
};

inline constexpr TransparencyLayerName kTransparencyLayers[] = {
    {"INTERNAL_MODEL", "a local model of the surface, corrected by the delayed force"},
    {"DELAYED_FORCE", "the force of the architecture as it arrives"},
    {"SURFACE_MODEL", "a local model of the surface and nothing else"},
    {"CONTACT_SPRING", "the delayed force and a local spring in all axes, for tools with many contacts"},
    {"FOUR_CHANNEL", "positions and forces in both directions"},
    {"FIXED_DAMPING", "a spring between the two positions and a damper at each side"},
    {"FRACTAL_IMPEDANCE", "springs that give back less than they take"},
    {"RANDOM", "forces drawn at random, to attack a passivity layer"},
    {"PLUGIN", "a force computed by a shared library"},
};

inline constexpr PassivityLayerName kPassivityLayers[] = {
    {"ENERGY_SPRING", Claim::hand, "at most the force of a spring that holds the energy of the hand's port"},
    {"ENERGY_SPRING_TWO_PORT", Claim::both, "the same at both ports, which send each other the energy they spare"},
    {"NONE", Claim::none, "everything is displayed"},
    {"CLASSIC", Claim::none,
     "two-port time domain passivity, correction along the velocity, as far as its largest damping reaches"},
    {"FORCE_PROJECTED", Claim::both, "two-port time domain passivity, correction along the force"},
    {"ENERGY_TANK", Claim::both, "a tank of energy at each side; the tanks exchange energy and the hand fills them"},
    {"ENERGY_BOUNDING", Claim::hand, "the device's own damping covers every next motion"},
};

/// The first is what a scene over a link gets that names none.
inline constexpr MethodName kMethods[] = {
    {"INTERNAL_MODEL", "INTERNAL_MODEL", "ENERGY_SPRING",
     "a local model of the surface at the master, corrected by the delayed force and limited by an energy spring"},
    {"NONE", "DELAYED_FORCE", "NONE", "no passivity control: transparent, and unstable over delay"},
    {"CLASSIC", "DELAYED_FORCE", "CLASSIC", "two-port time domain passivity approach: a damper along the velocity"},
    {"FORCE_PROJECTED", "DELAYED_FORCE", "FORCE_PROJECTED",
     "two-port time domain passivity approach: a correction along the force, whose direction stays"},
    {"FIXED_DAMPING", "FIXED_DAMPING", "NONE",
     "a spring between the two positions and a damper at each side (P+d): stable for any passive hand and environment "
     "at a known delay, and felt as a brake"},
    {"WAVE_VARIABLES", "", "",
     "wave variables: the link carries waves whose energy no delay or loss can raise; position is not exact"},
    {"SET_POSITION_MODULATION", "", "",
     "passive set-position modulation: each side's spring follows the other's position as far as stored energy allows"},
    {"ENERGY_TANK", "DELAYED_FORCE", "ENERGY_TANK",
     "two layers: any force, limited by an energy tank at each side; the tanks exchange energy and the hand fills "
     "them"},
    {"ENERGY_BOUNDING", "DELAYED_FORCE", "ENERGY_BOUNDING",
     "energy bounding algorithm: the displayed force is bounded so that the device's own damping covers every next "
     "motion"},
    {"FOUR_CHANNEL", "FOUR_CHANNEL", "NONE",
     "positions and forces in both directions: transparent without delay, not passive"},
    {"FRACTAL_IMPEDANCE", "FRACTAL_IMPEDANCE", "NONE",
     "springs that give back less than they take, without a damper; no account of energy"},
    {"MODEL_MEDIATED", "SURFACE_MODEL", "ENERGY_SPRING",
     "model-mediated: the hand feels a local model of the surface that the robot touches; its force is as good as the "
     "model"},
};

/// The entry of a name; null: there is none.
template <class Entry, int Count>
constexpr const Entry* find_name(const Entry (&list)[Count], std::string_view name) {
  for (const Entry& each : list)
    if (each.name == name) return &each;
  return nullptr;
}

}  // namespace twoport
