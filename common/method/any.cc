#include "common/method/any.h"

#include <algorithm>
#include <string>

#include "common/base/check.h"
#include "common/method/catalogue.h"

namespace twoport {
namespace {

/// Calls make.operator()<M>() for the method of that name.
template <class Result, class Make, class... Each>
Result make_by_name(const std::string& name, TypeList<Each...>, Make make) {
  Result half;
  std::string known;
  const auto try_one = [&]<class M>() {
    for (const std::string_view each : M::kNames) {
      known += (known.empty() ? "" : ", ") + std::string{each};
      if (each == name) half = make.template operator()<M>();
    }
  };
  (try_one.template operator()<Each>(), ...);
  if (!half) throw ConfigError{"control.passivity.method is " + name + "; it must be one of " + known};
  return half;
}

}  // namespace

template <int N>
AnyMasterHalf<N>::AnyMasterHalf(const ControlOptions& o)
    : half_{make_by_name<std::unique_ptr<Concept>>(o.method_name, Methods{}, [&]<class M>() {
        return std::make_unique<Model<typename M::template Master<N>>>(o);
      })} {}
template <int N>
AnySlaveHalf<N>::AnySlaveHalf(const ControlOptions& o)
    : half_{make_by_name<std::unique_ptr<Concept>>(o.method_name, Methods{}, [&]<class M>() {
        return std::make_unique<Model<typename M::template Slave<N>>>(o);
      })} {}

template class AnyMasterHalf<1>;
template class AnyMasterHalf<3>;
template class AnyMasterHalf<6>;
template class AnySlaveHalf<1>;
template class AnySlaveHalf<3>;
template class AnySlaveHalf<6>;

}  // namespace twoport
