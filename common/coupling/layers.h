#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/coupling/options.h"

namespace twoport {

/// A method over a link is a transparency layer and a passivity layer.
///
///     wanted    = transparency layer: what the hand should feel and what the robot should do; it may be wrong
///     displayed = passivity layer: how much of it the energy of the port allows
///
/// These lists are the names of scenes, of `twoport-lab methods` and of tables. A layer is a folder and a line of a list.h; its layer.h
/// states what others ask of it, and its classes. Nothing else asks for a layer by its name.

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
  /// What hand and robot together may give back at most, in E(0): that of each side. 0: not bounded.
  [[nodiscard]] constexpr double grants() const { return both ? 2.0 : 0.0; }
  friend constexpr bool operator==(const Claim&, const Claim&) = default;
};

constexpr std::string_view to_string(const Claim& claim) {
  if (claim.hand && claim.both) return "hand, both";
  return claim.hand ? "hand" : claim.both ? "both" : "none";
}

/// A number that a layer computes in each tick: a column of the trace, a value of the page, and in the summary its mean over ticks in contact.
struct LayerFigure {
  std::string_view name, unit{};
  int least_dof = 1;  ///< it is left out of smaller scenes
};

struct TransparencyLayerName {
  std::string_view name, summary;
  bool is_plain = false;  ///< it leaves the force as it arrives
  /// A damper at the robot that acts beside the passivity layer is of the link: no controller of the link's port bounds it.
  bool damps_link = false;
  /// E(0) that no scene states grows with the round trip (default_initial_energy).
  bool initial_energy_by_round_trip = false;
  /// From so many axes on its model of the contact may be a spring in all of them; 0: never.
  int spring_in_all_axes_from = 0;
  bool is_random = false;    ///< its forces are drawn
  bool is_external = false;  ///< a program of its own computes its forces
  /// Why it is not displayed under POSITION_MEASURED_FORCE; empty: it is.
  std::string_view refuses_measured_force{};
  /// What would make the force sensor unnecessary; empty: it needs none.
  std::string_view (*replaces_force_sensor)(const ControlOptions&) = nullptr;
  /// What is wrong with its options; empty: nothing.
  std::string_view (*refusal)(const ControlOptions&) = nullptr;
  LayerFigure figures[2]{};
};
struct PassivityLayerName {
  std::string_view name, summary;
  bool is_plain = false;             ///< it displays everything and keeps no account
  std::optional<Claim> claim{};      ///< each layer states one
  Method controller = Method::none;  ///< of the observer's port
  bool exchanges = false;            ///< both sides have an account and exchange energy
  std::string_view passes_on{};      ///< the same layer without the bound of the hand's port alone
  /// What must be otherwise, after "it must "; empty: nothing.
  std::string_view (*refusal)(const ControlOptions&) = nullptr;
  /// Which of its options voids the claim of the hand's port, and why: a sentence. Empty: none.
  std::string_view (*voids_hand)(const ControlOptions&) = nullptr;
};
/// A named pair; a method of one piece has no layers, and a claim of its own.
struct MethodName {
  std::string_view name, transparency{}, passivity{}, summary{};
  std::optional<Claim> claim{};
  std::string_view refuses_measured_force{};  ///< as of a layer
  bool strict_two_port = false;               ///< under that option it has PassivityLayerName::passes_on
  [[nodiscard]] constexpr bool one_piece() const { return transparency.empty(); }
};

/// Of a layer that models the surface by the force sensor or, under POSITION_POSITION, without.
constexpr std::string_view positions_replace_force_sensor(const ControlOptions& o) {
  return o.architecture == Architecture::position_position ? "" : "control.architecture POSITION_POSITION";
}

#define TWOPORT_LAYER(NAME, Master, Slave, ...) {.name = NAME, __VA_ARGS__},
inline constexpr TransparencyLayerName kTransparencyLayers[] = {
#include "common/method/transparency/list.h"
};

inline constexpr PassivityLayerName kPassivityLayers[] = {
#include "common/method/passivity/list.h"
};

/// The first is what a scene over a link gets that names none.
inline constexpr MethodName kMethods[] = {
    {.name = "INTERNAL_MODEL",
     .transparency = "INTERNAL_MODEL",
     .passivity = "ENERGY_SPRING",
     .summary =
         "a local model of the surface at the master, corrected by the delayed force and limited by an energy spring",
     .strict_two_port = true},
    {"ENERGY_EXCHANGE", "INTERNAL_MODEL", "ENERGY_EXCHANGE",
     "the same model, with observers and controllers at both ends: both ports' energy is bounded, and the hand pays "
     "for the robot"},
    {"NONE", "DELAYED_FORCE", "NONE", "no passivity control: transparent, and unstable over delay"},
    {"CLASSIC", "DELAYED_FORCE", "CLASSIC", "two-port time domain passivity approach: a damper along the velocity"},
    {"FORCE_PROJECTED", "DELAYED_FORCE", "FORCE_PROJECTED",
     "two-port time domain passivity approach: a correction along the force, whose direction stays"},
    {"FIXED_DAMPING", "FIXED_DAMPING", "NONE",
     "a spring between the two positions and a damper at each side (P+d): stable for any passive hand and environment "
     "at a known delay, and felt as a brake"},
#include "common/method/one_piece/list.h"
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
#undef TWOPORT_LAYER

static_assert(std::all_of(std::begin(kPassivityLayers), std::end(kPassivityLayers),
                          [](const PassivityLayerName& each) { return each.claim.has_value(); }),
              "each passivity layer states a claim");
static_assert(std::all_of(std::begin(kMethods), std::end(kMethods),
                          [](const MethodName& each) { return each.one_piece() == each.claim.has_value(); }),
              "each method of one piece states a claim, and a pair's claim is that of its layers");

/// The entry of a name; null: there is none.
template <class Entry, int Count>
constexpr const Entry* find_name(const Entry (&list)[Count], std::string_view name) {
  for (const Entry& each : list)
    if (each.name == name) return &each;
  return nullptr;
}

std::vector<std::string> names_of(const auto& list) {
  std::vector<std::string> all;
  for (const auto& each : list) all.emplace_back(each.name);
  return all;
}

/// The figures of all layers, each once, at `all`. Returns their number.
constexpr std::size_t collect_figures(LayerFigure* all) {
  std::size_t count = 0;
  for (const TransparencyLayerName& layer : kTransparencyLayers)
    for (const LayerFigure& figure : layer.figures)
      if (std::none_of(all, all + count, [&](const LayerFigure& f) { return f.name == figure.name; }) &&
          !figure.name.empty())
        all[count++] = figure;
  return count;
}
inline constexpr auto kLayerFigures = [] {
  constexpr auto collect = [] {
    std::array<LayerFigure, 2 * std::size(kTransparencyLayers)> all{};
    return std::pair{collect_figures(all.data()), all};
  };
  std::array<LayerFigure, collect().first> all{};
  std::copy_n(collect().second.begin(), all.size(), all.begin());
  return all;
}();
/// A value of each.
using LayerFigures = std::array<double, kLayerFigures.size()>;
/// The place of a figure in them; does not compile where no layer declares it.
consteval std::size_t layer_figure(std::string_view name) {
  std::size_t i = 0;
  while (kLayerFigures.at(i).name != name) ++i;
  return i;
}
/// Has a layer figures in a scene with so many degrees of freedom?
constexpr bool has_figures(const TransparencyLayerName& layer, int dof) {
  return std::any_of(std::begin(layer.figures), std::end(layer.figures),
                     [&](const LayerFigure& each) { return !each.name.empty() && dof >= each.least_dof; });
}

/// The method of a scene over a link that names none.
inline constexpr std::string_view kDefaultMethod = kMethods[0].name;
static_assert(find_name(kTransparencyLayers, kPlainTransparency)->is_plain &&
              find_name(kPassivityLayers, kPlainPassivity)->is_plain &&
              find_name(kMethods, kPlainMethod)->transparency == kPlainTransparency &&
              find_name(kMethods, kPlainMethod)->passivity == kPlainPassivity);

/// The entry of what is in use; where it has no such layer, as of one piece, one that states nothing.
template <class Entry, int Count>
const Entry& entry_of(const Entry (&list)[Count], std::string_view name) {
  static constexpr Entry kNoEntry{};
  const Entry* found = find_name(list, name);
  return found != nullptr ? *found : kNoEntry;
}
inline const TransparencyLayerName& transparency_layer(const ControlOptions& o) {
  return entry_of(kTransparencyLayers, o.transparency);
}
inline const PassivityLayerName& passivity_layer(const ControlOptions& o) {
  return entry_of(kPassivityLayers, o.passivity);
}
inline const MethodName& method_entry(const ControlOptions& o) {
  return entry_of(kMethods, o.method_name);
}

/// Is there no layer but the plain ones, and no method of one piece? The coupling acts as it is.
inline bool is_plain(const ControlOptions& o) {
  return o.method_name == kPlainMethod;
}

/// Sets a method by its name, of kMethods or TRANSPARENCY+PASSIVITY. False: there is no such method, and nothing is set.
inline bool choose_method(ControlOptions& o, std::string_view name) {
  if (const MethodName* method = find_name(kMethods, name)) {
    o.transparency = method->transparency;
    o.passivity = method->passivity;
    o.method_name = name;
  } else {
    const std::size_t plus = std::min(name.find('+'), name.size());
    const std::string_view transparency = name.substr(0, plus),
                           passivity = name.substr(std::min(plus + 1, name.size()));
    if (find_name(kTransparencyLayers, transparency) == nullptr || find_name(kPassivityLayers, passivity) == nullptr)
      return false;
    o.transparency = transparency;
    o.passivity = passivity;
    o.method_name = name;
    for (const MethodName& each : kMethods)
      if (each.transparency == transparency && each.passivity == passivity) o.method_name = each.name;
  }
  o.controller.method = passivity_layer(o).controller;
  return true;
}

/// Do both sides have an account and exchange energy?
inline bool exchanges_energy(const ControlOptions& o) {
  return passivity_layer(o).exchanges;
}

}  // namespace twoport
