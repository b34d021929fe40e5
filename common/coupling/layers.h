#pragma once

#include <optional>
#include <string_view>

#include "common/passivity/controller_options.h"

namespace twoport {

/// A method over a link is a transparency layer and a passivity layer.
///
///     wanted    = transparency layer: what the hand should feel and what the robot should do; it may be wrong
///     displayed = passivity layer: how much of it the energy of the port allows
///
/// These lists are the names of scenes, of `twoport-lab methods` and of tables. common/method/classes.h has the classes.

/// Which ports' energy is bounded [J], since the start, for any hand, robot and network:
///
///     hand   Σ f·Δx at the master port              >= -E(0) - slack          for any reports
///     both   hand less what leaves at the slave      >= -E(0) of both sides - slack     for honest reports
///     slack  = Σ |f·e| T + K δ_m²/2,  `both` also K δ_s²/2
///     e(k+1) = e(k) - e(k-1)/4 + a(k+1) - a(k)         a(k+1) = v(k+1) - v(k) + C (f(k) + f(k+1)),   v = Δx/T, C = T/(2m)
///
/// At the slave Σ f·v_d T leaves the link, with `robot_port` Σ f·Δx of the robot. a: what all but the displayed force f adds to the
/// handle's velocity in a tick; e: the error that this makes in the velocity which the controller predicts
/// (common/passivity/velocity_predictor.h), counted where `predicts`. K: the coupling's stiffness;
/// δ_m, δ_s: largest motion of hand and robot in a tick, where `tick_at_hand`, `tick_at_robot`, else 0. What a pair claims with the options that it has: common/coupling/claim.h.
struct Claim {
  bool hand = false, both = false;
  bool device_damping = false;  ///< Σ b Δx²/T of the device counts with the hand's energy
  bool robot_port = false;
  bool tick_at_hand = false, tick_at_robot = false;
  bool in_hand_joules = false;  ///< E(0) of the robot's side is E(0) in the master's joules, else in its own
  bool predicts = false;        ///< as the handle has moved, not for the worst that a hand can do

  [[nodiscard]] constexpr bool any() const { return hand || both; }
  friend constexpr bool operator==(const Claim&, const Claim&) = default;
};

constexpr std::string_view to_string(const Claim& claim) {
  if (claim.hand && claim.both) return "hand, both";
  return claim.hand ? "hand" : claim.both ? "both" : "none";
}

struct TransparencyLayerName {
  std::string_view name, summary;
  /// A damper at the robot that acts beside the passivity layer is of the link: no controller of the link's port bounds it.
  bool damps_link = false;
  /// It displays a local model of the surface, estimated by the force sensor or, under POSITION_POSITION, without.
  bool models_surface = false;
  /// It displays the position error and nothing else.
  bool by_position = false;
};
struct PassivityLayerName {
  std::string_view name;
  Claim claim;
  std::string_view summary;
  Method controller = Method::none;  ///< of the observer's port
  bool exchanges = false;            ///< both sides have an account and exchange energy
};
/// A named pair; a method of one piece has no layers, and a claim of its own.
struct MethodName {
  std::string_view name, transparency, passivity, summary;
  std::optional<Claim> claim{};
  [[nodiscard]] constexpr bool one_piece() const { return transparency.empty(); }
};

inline constexpr TransparencyLayerName kTransparencyLayers[] = {
    {.name = "INTERNAL_MODEL",
     .summary = "a local model of the surface, corrected by the delayed force",
     .damps_link = true,
     .models_surface = true},
    {.name = "DELAYED_FORCE", .summary = "the force of the architecture as it arrives"},
    {.name = "SURFACE_MODEL",
     .summary = "a local model of the surface and nothing else",
     .damps_link = true,
     .models_surface = true},
    {.name = "CONTACT_SPRING",
     .summary = "the delayed force and a local spring in all axes, for tools with many contacts",
     .models_surface = true},
    {.name = "FOUR_CHANNEL", .summary = "positions and forces in both directions"},
    {.name = "FIXED_DAMPING",
     .summary = "a spring between the two positions and a damper at each side",
     .by_position = true},
    {.name = "FRACTAL_IMPEDANCE", .summary = "springs that give back less than they take", .by_position = true},
    {.name = "RANDOM", .summary = "forces drawn at random, to attack a passivity layer"},
    {.name = "PLUGIN", .summary = "a force computed by a shared library"},
};

inline constexpr PassivityLayerName kPassivityLayers[] = {
    {.name = "ENERGY_SPRING",
     .claim = {.hand = true},
     .summary = "at most the force of a spring that holds the energy of the hand's port"},
    {.name = "ENERGY_EXCHANGE",
     .claim = {.hand = true, .both = true, .robot_port = true, .tick_at_robot = true, .in_hand_joules = true},
     .summary =
         "an energy spring at each side; the two exchange energy until both have the same, and the hand pays what "
         "is spent",
     .exchanges = true},
    {.name = "ENERGY_SPRING_TWO_PORT",
     .claim = {.both = true, .robot_port = true, .tick_at_robot = true, .in_hand_joules = true},
     .summary = "the same without the bound of the hand's port alone: an environment that moves is felt as long as it "
                "does",
     .exchanges = true},
    {.name = "NONE", .claim = {}, .summary = "everything is displayed"},
    {.name = "CLASSIC",
     .claim = {},
     .summary = "two-port time domain passivity, correction along the velocity, as far as its largest damping reaches",
     .controller = Method::classic},
    {.name = "FORCE_PROJECTED",
     .claim = {.hand = true, .both = true, .predicts = true},
     .summary = "two-port time domain passivity, correction along the force",
     .controller = Method::force_projected},
    {.name = "ENERGY_TANK",
     .claim = {.both = true, .robot_port = true, .tick_at_hand = true, .tick_at_robot = true},
     .summary = "a tank of energy at each side; the tanks exchange energy and the hand fills them"},
    {.name = "ENERGY_BOUNDING",
     .claim = {.hand = true, .device_damping = true},
     .summary = "the device's own damping covers every next motion"},
};

/// The first is what a scene over a link gets that names none.
inline constexpr MethodName kMethods[] = {
    {"INTERNAL_MODEL", "INTERNAL_MODEL", "ENERGY_SPRING",
     "a local model of the surface at the master, corrected by the delayed force and limited by an energy spring"},
    {"ENERGY_EXCHANGE", "INTERNAL_MODEL", "ENERGY_EXCHANGE",
     "the same model, with observers and controllers at both ends: both ports' energy is bounded, and the hand pays "
     "for "
     "the robot"},
    {"NONE", "DELAYED_FORCE", "NONE", "no passivity control: transparent, and unstable over delay"},
    {"CLASSIC", "DELAYED_FORCE", "CLASSIC", "two-port time domain passivity approach: a damper along the velocity"},
    {"FORCE_PROJECTED", "DELAYED_FORCE", "FORCE_PROJECTED",
     "two-port time domain passivity approach: a correction along the force, whose direction stays"},
    {"FIXED_DAMPING", "FIXED_DAMPING", "NONE",
     "a spring between the two positions and a damper at each side (P+d): stable for any passive hand and environment "
     "at a known delay, and felt as a brake"},
    {"WAVE_VARIABLES", "", "",
     "wave variables: the link carries waves whose energy no delay or loss can raise; position is not exact", Claim{}},
    {"SET_POSITION_MODULATION", "", "",
     "passive set-position modulation: each side's spring follows the other's position as far as stored energy allows",
     Claim{.both = true, .robot_port = true, .tick_at_hand = true, .tick_at_robot = true}},
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

/// A pair's claim is that of its layers.
static_assert([] {
  for (const MethodName& each : kMethods)
    if (each.one_piece() != each.claim.has_value()) return false;
  return true;
}());

/// The entry of a name; null: there is none.
template <class Entry, int Count>
constexpr const Entry* find_name(const Entry (&list)[Count], std::string_view name) {
  for (const Entry& each : list)
    if (each.name == name) return &each;
  return nullptr;
}

}  // namespace twoport
