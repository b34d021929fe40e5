#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/method/layers.h"
#include "common/method/one_piece/set_position_modulation/set_position_modulation.h"
#include "common/method/one_piece/wave_variables/wave_variables.h"
#include "common/method/passivity/energy_bounding/energy_bounding.h"
#include "common/method/passivity/energy_exchange/energy_exchange.h"
#include "common/method/passivity/energy_spring/energy_spring_layer.h"
#include "common/method/passivity/energy_tank/energy_tank.h"
#include "common/method/passivity/none/none.h"
#include "common/method/passivity/time_domain/time_domain.h"
#include "common/method/transparency/contact_spring/master.h"
#include "common/method/transparency/delayed_force/delayed_force.h"
#include "common/method/transparency/fixed_damping/fixed_damping.h"
#include "common/method/transparency/four_channel/four_channel.h"
#include "common/method/transparency/fractal_impedance/fractal_impedance.h"
#include "common/method/transparency/internal_model/contact_model.h"
#include "common/method/transparency/internal_model/slave.h"
#include "common/method/transparency/plugin/plugin.h"
#include "common/method/transparency/random/random.h"
#include "common/method/transparency/surface_model/master.h"

namespace twoport {

/// The classes of a name. A new layer or method of one piece is a line here, one in common/coupling/layers.h and one in
/// proto/scene.proto.
template <template <int> class M, template <int> class S>
struct Classes {
  std::string_view name;
  template <int N>
  using Master = M<N>;
  template <int N>
  using Slave = S<N>;
};
constexpr auto kTransparencyClasses = [](auto visit) {
  visit(Classes<InternalModel, InternalModelSlave>{"INTERNAL_MODEL"});
  visit(Classes<DelayedForceMaster, DelayedForceSlave>{"DELAYED_FORCE"});
  visit(Classes<SurfaceModelMaster, InternalModelSlave>{"SURFACE_MODEL"});
  visit(Classes<ContactSpringMaster, InternalModelSlave>{"CONTACT_SPRING"});
  visit(Classes<FourChannelMaster, FourChannelSlave>{"FOUR_CHANNEL"});
  visit(Classes<FixedDampingMaster, FixedDampingSlave>{"FIXED_DAMPING"});
  visit(Classes<FractalImpedanceMaster, FractalImpedanceSlave>{"FRACTAL_IMPEDANCE"});
  visit(Classes<RandomMaster, DelayedForceSlave>{"RANDOM"});
  visit(Classes<PluginMaster, DelayedForceSlave>{"PLUGIN"});
};
constexpr auto kPassivityClasses = [](auto visit) {
  visit(Classes<EnergySpringMaster, NoPassivitySlave>{"ENERGY_SPRING"});
  visit(Classes<EnergyExchangeMaster, EnergyExchangeSlave>{"ENERGY_EXCHANGE"});
  visit(Classes<EnergyExchangeMaster, EnergyExchangeSlave>{"ENERGY_SPRING_TWO_PORT"});
  visit(Classes<NoPassivityMaster, NoPassivitySlave>{"NONE"});
  visit(Classes<TimeDomainMaster, TimeDomainSlave>{"CLASSIC"});
  visit(Classes<TimeDomainMaster, TimeDomainSlave>{"FORCE_PROJECTED"});
  visit(Classes<EnergyTankMaster, EnergyTankSlave>{"ENERGY_TANK"});
  visit(Classes<EnergyBoundingMaster, NoPassivitySlave>{"ENERGY_BOUNDING"});
};
constexpr auto kOnePieceClasses = [](auto visit) {
  visit(Classes<WaveMaster, WaveSlave>{"WAVE_VARIABLES"});
  visit(Classes<SetPositionMaster, SetPositionSlave>{"SET_POSITION_MODULATION"});
};

/// The half or layer of that name in a list of classes; `field` of a scene names it. Throws ConfigError, with the names, where there is none.
template <template <int> class Base, int N>
std::unique_ptr<Base<N>> made(const ControlOptions& o, const std::string& name, auto classes, const char* field,
                              const auto& names) {
  std::unique_ptr<Base<N>> it;
  classes([&]<template <int> class M, template <int> class S>(Classes<M, S> each) {
    if (each.name != name) return;
    if constexpr (std::is_base_of_v<Base<N>, M<N>>) {
      it = std::make_unique<M<N>>(o);
    } else {
      it = std::make_unique<S<N>>(o);
    }
  });
  if (it) return it;
  std::string all;
  for (const auto& each : names) all += (all.empty() ? "" : ", ") + std::string{each.name};
  throw ConfigError{std::string{field} + " is " + name + "; it must be one of " + all};
}

template <int N>
std::unique_ptr<MasterHalf<N>> MasterHalf<N>::make(const ControlOptions& o) {
  if (!o.transparency.empty()) return std::make_unique<MasterPair<N>>(o);
  return made<twoport::MasterHalf, N>(o, o.method_name, kOnePieceClasses, "control.passivity.method", kMethods);
}
template <int N>
std::unique_ptr<MasterTransparency<N>> MasterTransparency<N>::make(const ControlOptions& o) {
  return made<twoport::MasterTransparency, N>(o, o.transparency, kTransparencyClasses, "control.transparency.layer",
                                              kTransparencyLayers);
}
template <int N>
std::unique_ptr<MasterPassivity<N>> MasterPassivity<N>::make(const ControlOptions& o) {
  return made<twoport::MasterPassivity, N>(o, o.passivity, kPassivityClasses, "control.passivity.layer",
                                           kPassivityLayers);
}
template <int N>
std::unique_ptr<SlaveHalf<N>> SlaveHalf<N>::make(const ControlOptions& o) {
  if (!o.transparency.empty()) return std::make_unique<SlavePair<N>>(o);
  return made<twoport::SlaveHalf, N>(o, o.method_name, kOnePieceClasses, "control.passivity.method", kMethods);
}
template <int N>
std::unique_ptr<SlaveTransparency<N>> SlaveTransparency<N>::make(const ControlOptions& o) {
  return made<twoport::SlaveTransparency, N>(o, o.transparency, kTransparencyClasses, "control.transparency.layer",
                                             kTransparencyLayers);
}
template <int N>
std::unique_ptr<SlavePassivity<N>> SlavePassivity<N>::make(const ControlOptions& o) {
  return made<twoport::SlavePassivity, N>(o, o.passivity, kPassivityClasses, "control.passivity.layer",
                                          kPassivityLayers);
}

/// Compiles them for N axes: a line of dof_N.cc.
#define TWOPORT_MAKE(N)                                                                               \
  template std::unique_ptr<MasterHalf<N>> MasterHalf<N>::make(const ControlOptions&);                 \
  template std::unique_ptr<SlaveHalf<N>> SlaveHalf<N>::make(const ControlOptions&);                   \
  template std::unique_ptr<MasterTransparency<N>> MasterTransparency<N>::make(const ControlOptions&); \
  template std::unique_ptr<SlaveTransparency<N>> SlaveTransparency<N>::make(const ControlOptions&);   \
  template std::unique_ptr<MasterPassivity<N>> MasterPassivity<N>::make(const ControlOptions&);       \
  template std::unique_ptr<SlavePassivity<N>> SlavePassivity<N>::make(const ControlOptions&)

}  // namespace twoport
