#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/method/layers.h"
#define TWOPORT_LAYER_CLASSES
#include "common/method/list.h"
#undef TWOPORT_LAYER_CLASSES

namespace twoport {

/// The classes of a name.
template <template <int> class M, template <int> class S>
struct Classes {
  std::string_view name;
  template <int N>
  using Master = M<N>;
  template <int N>
  using Slave = S<N>;
};
#define TWOPORT_LAYER(NAME, Master, Slave, ...) visit(Classes<Master, Slave>{NAME});
constexpr auto kTransparencyClasses = [](auto visit) {
#include "common/method/transparency/list.h"
};
constexpr auto kPassivityClasses = [](auto visit) {
#include "common/method/passivity/list.h"
};
constexpr auto kOnePieceClasses = [](auto visit) {
#include "common/method/one_piece/list.h"
};
#undef TWOPORT_LAYER

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
