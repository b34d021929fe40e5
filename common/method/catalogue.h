#pragma once

#include <string_view>

#include "common/method/energy_bounding/energy_bounding.h"
#include "common/method/energy_tank/energy_tank.h"
#include "common/method/fixed_damping/fixed_damping.h"
#include "common/method/four_channel/four_channel.h"
#include "common/method/fractal_impedance/fractal_impedance.h"
#include "common/method/internal_model/internal_model.h"
#include "common/method/model_mediated/model_mediated.h"
#include "common/method/none/none.h"
#include "common/method/set_position_modulation/set_position_modulation.h"
#include "common/method/tdpa/tdpa.h"
#include "common/method/wave_variables/wave_variables.h"

namespace twoport {

template <class... Each>
struct TypeList {};

/// All methods. For a new one: a folder beside these, its header above, its type here, and its names in
/// proto/scene.proto (Passivity.Method). The first name of the first is what a scene over a link gets that names none.
using Methods =
    TypeList<InternalModelControl, NoControl, TimeDomainPassivity, FixedDamping, WaveVariables, SetPositionModulation,
             EnergyTank, EnergyBounding, FourChannel, FractalImpedance, ModelMediated>;

/// Calls `visit.operator()<M>(name)` for every name of every method, in the order of the list.
template <class Visit>
void for_each_method(Visit visit) {
  const auto names_of = [&]<class M>() {
    for (const std::string_view name : M::kNames) visit.template operator()<M>(name);
  };
  [&]<class... Each>(TypeList<Each...>) { (names_of.template operator()<Each>(), ...); }(Methods{});
}

/// Does the master half keep an account of energy, whose deficit it tells? A method that has none says kKeepsAccount = false.
template <class M>
constexpr bool keeps_account() {
  if constexpr (requires { M::kKeepsAccount; }) {
    return M::kKeepsAccount;
  } else {
    return true;
  }
}

template <class First, class... Others>
constexpr std::string_view first_name(TypeList<First, Others...>) {
  return First::kNames[0];
}
static_assert(first_name(Methods{}) == kDefaultMethod, "the first method of the list is a scene's default");

}  // namespace twoport
