#pragma once

#include <cstdint>
#include <string_view>

namespace twoport {

enum class Method : std::uint8_t {
  none,             ///< observe only
  classic,          ///< correction along the port's input, out + αv or out + βf: paper eqs. (3), (5)-(7)
  force_projected,  ///< correction along the port's output, out·s: paper eq. (8); keeps the direction of out
  metric_damping,   ///< impedance only: classic, with the response of the handle's inertia to the correction
  force_cone,       ///< impedance only: metric_damping, the force turned by no more than a given angle
};

/// Their names in scenes, and whether one needs a rendered impedance: those are no layers of a link.
struct ControllerName {
  std::string_view name;
  Method method;
  bool rendering = false;
};
inline constexpr ControllerName kControllers[] = {{"NONE", Method::none},
                                                  {"CLASSIC", Method::classic},
                                                  {"FORCE_PROJECTED", Method::force_projected},
                                                  {"METRIC_DAMPING", Method::metric_damping, true},
                                                  {"FORCE_CONE", Method::force_cone, true}};

struct ControllerOptions {
  Method method = Method::none;
  /// Largest damping of an impedance against the accumulated deficit [N s/m]; about an axis times radius_of_gyration_m².
  /// The new deficit is not limited by it alone; it is bounded by |P| and rise.
  double max_gain = 10.0;
  /// The same at an admittance [m/(N s)]. On a spring K the sampled correction is stable below 2/(K T).
  double max_mobility_m_per_n_s = 0.01;
  /// A projected output keeps its sign: s >= 0, a wall never pulls.
  bool unilateral = true;
  /// Also cover the deficit of the coming interval, as predicted by in·out.
  bool predict = true;
  /// Apparent mass at the port; 0: not known.
  double mass_kg = 0.0;
  /// ρ = √(inertia/mass) at the port: makes a radian comparable with a metre, |V|² = |v|² + ρ²|ω|².
  double radius_of_gyration_m = 1.0;
  /// force_cone: largest angle between the wanted force and the force, in the metric of the inverse mass.
  double max_turn_rad = 0.0;
};

}  // namespace twoport
