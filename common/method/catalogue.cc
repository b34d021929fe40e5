#include "common/method/catalogue.h"

#include <algorithm>
#include <memory>
#include <string_view>

#include "common/base/check.h"
#include "common/method/layers.h"
#include "common/method/one_piece/set_position_modulation/set_position_modulation.h"
#include "common/method/one_piece/wave_variables/wave_variables.h"
#include "common/method/passivity/energy_bounding/energy_bounding.h"
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
namespace {

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
template <class Visit>
void for_each_transparency(Visit visit) {
  visit(Classes<InternalModel, InternalModelSlave>{"INTERNAL_MODEL"});
  visit(Classes<DelayedForceMaster, DelayedForceSlave>{"DELAYED_FORCE"});
  visit(Classes<SurfaceModelMaster, InternalModelSlave>{"SURFACE_MODEL"});
  visit(Classes<ContactSpringMaster, InternalModelSlave>{"CONTACT_SPRING"});
  visit(Classes<FourChannelMaster, FourChannelSlave>{"FOUR_CHANNEL"});
  visit(Classes<FixedDampingMaster, FixedDampingSlave>{"FIXED_DAMPING"});
  visit(Classes<FractalImpedanceMaster, FractalImpedanceSlave>{"FRACTAL_IMPEDANCE"});
  visit(Classes<RandomMaster, DelayedForceSlave>{"RANDOM"});
  visit(Classes<PluginMaster, DelayedForceSlave>{"PLUGIN"});
}
template <class Visit>
void for_each_passivity(Visit visit) {
  visit(Classes<EnergySpringMaster, NoPassivitySlave>{"ENERGY_SPRING"});
  visit(Classes<EnergySpringTwoPortMaster, EnergySpringTwoPortSlave>{"ENERGY_SPRING_TWO_PORT"});
  visit(Classes<NoPassivityMaster, NoPassivitySlave>{"NONE"});
  visit(Classes<TimeDomainMaster, TimeDomainSlave>{"CLASSIC"});
  visit(Classes<TimeDomainMaster, TimeDomainSlave>{"FORCE_PROJECTED"});
  visit(Classes<EnergyTankMaster, EnergyTankSlave>{"ENERGY_TANK"});
  visit(Classes<EnergyBoundingMaster, NoPassivitySlave>{"ENERGY_BOUNDING"});
}
template <class Visit>
void for_each_of_one_piece(Visit visit) {
  visit(Classes<WaveMaster, WaveSlave>{"WAVE_VARIABLES"});
  visit(Classes<SetPositionMaster, SetPositionSlave>{"SET_POSITION_MODULATION"});
}

/// make(classes) of the name in that list; null where it is not there.
template <class Base>
std::unique_ptr<Base> made(std::string_view name, auto list, auto make) {
  std::unique_ptr<Base> it;
  list([&](auto classes) {
    if (classes.name == name) it = make(classes);
  });
  return it;
}
template <class Base>
std::unique_ptr<Base> known(std::unique_ptr<Base> it, const char* field, const std::string& value, const auto& list) {
  if (it) return it;
  std::string names;
  for (const auto& each : list) names += (names.empty() ? "" : ", ") + std::string{each.name};
  throw ConfigError{std::string{field} + " is " + value + "; it must be one of " + names};
}

}  // namespace

std::vector<std::string> method_names() {
  std::vector<std::string> all;
  for (const MethodName& each : kMethods) all.emplace_back(each.name);
  return all;
}
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
  const auto keeps = [](const ControlOptions& o) {
    if (o.architecture == Architecture::render) return o.controller.method != Method::none;
    const MethodName* method = find_name(kMethods, o.method_name);
    return method != nullptr && method->one_piece() ? true : !o.passivity.empty() && o.passivity != "NONE";
  };
  return keeps(first) || std::any_of(schedule.begin(), schedule.end(),
                                     [&](const ScheduledControl& entry) { return keeps(entry.control); });
}

double two_port_grants(std::string_view passivity_layer) {
  const PassivityLayerName* layer = find_name(kPassivityLayers, passivity_layer);
  if (layer == nullptr || layer->claim != Claim::both) return 0.0;
  return layer->name == "ENERGY_SPRING_TWO_PORT" ? 1.0 : 2.0;
}

template <int N>
std::unique_ptr<MasterHalf<N>> MasterHalf<N>::make(const ControlOptions& o) {
  if (!o.transparency.empty()) return std::make_unique<MasterPair<N>>(o);
  return known(made<MasterHalf<N>>(
                   o.method_name, [](auto visit) { for_each_of_one_piece(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Master<N>>(o); }),
               "control.passivity.method", o.method_name, kMethods);
}
template <int N>
std::unique_ptr<SlaveHalf<N>> SlaveHalf<N>::make(const ControlOptions& o) {
  if (!o.transparency.empty()) return std::make_unique<SlavePair<N>>(o);
  return known(made<SlaveHalf<N>>(
                   o.method_name, [](auto visit) { for_each_of_one_piece(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Slave<N>>(o); }),
               "control.passivity.method", o.method_name, kMethods);
}
template <int N>
std::unique_ptr<MasterTransparency<N>> MasterTransparency<N>::make(const ControlOptions& o) {
  return known(made<MasterTransparency<N>>(
                   o.transparency, [](auto visit) { for_each_transparency(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Master<N>>(o); }),
               "control.transparency.layer", o.transparency, kTransparencyLayers);
}
template <int N>
std::unique_ptr<SlaveTransparency<N>> SlaveTransparency<N>::make(const ControlOptions& o) {
  return known(made<SlaveTransparency<N>>(
                   o.transparency, [](auto visit) { for_each_transparency(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Slave<N>>(o); }),
               "control.transparency.layer", o.transparency, kTransparencyLayers);
}
template <int N>
std::unique_ptr<MasterPassivity<N>> MasterPassivity<N>::make(const ControlOptions& o) {
  return known(made<MasterPassivity<N>>(
                   o.passivity, [](auto visit) { for_each_passivity(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Master<N>>(o); }),
               "control.passivity.layer", o.passivity, kPassivityLayers);
}
template <int N>
std::unique_ptr<SlavePassivity<N>> SlavePassivity<N>::make(const ControlOptions& o) {
  return known(made<SlavePassivity<N>>(
                   o.passivity, [](auto visit) { for_each_passivity(visit); },
                   [&](auto c) { return std::make_unique<typename decltype(c)::template Slave<N>>(o); }),
               "control.passivity.layer", o.passivity, kPassivityLayers);
}

template std::unique_ptr<MasterHalf<1>> MasterHalf<1>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<1>> SlaveHalf<1>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<1>> MasterTransparency<1>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<1>> SlaveTransparency<1>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<1>> MasterPassivity<1>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<1>> SlavePassivity<1>::make(const ControlOptions&);
template std::unique_ptr<MasterHalf<3>> MasterHalf<3>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<3>> SlaveHalf<3>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<3>> MasterTransparency<3>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<3>> SlaveTransparency<3>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<3>> MasterPassivity<3>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<3>> SlavePassivity<3>::make(const ControlOptions&);
template std::unique_ptr<MasterHalf<6>> MasterHalf<6>::make(const ControlOptions&);
template std::unique_ptr<SlaveHalf<6>> SlaveHalf<6>::make(const ControlOptions&);
template std::unique_ptr<MasterTransparency<6>> MasterTransparency<6>::make(const ControlOptions&);
template std::unique_ptr<SlaveTransparency<6>> SlaveTransparency<6>::make(const ControlOptions&);
template std::unique_ptr<MasterPassivity<6>> MasterPassivity<6>::make(const ControlOptions&);
template std::unique_ptr<SlavePassivity<6>> SlavePassivity<6>::make(const ControlOptions&);

}  // namespace twoport
