#include "common/method/any.h"

#include <algorithm>
#include <string>
#include <string_view>

#include "common/base/check.h"
#include "common/method/catalogue.h"

namespace twoport {
namespace {

/// make.operator()<M>() for the method of that name.
template <class Result, class Make>
Result make_by_name(const std::string& name, Make make) {
  Result half;
  for_each_method([&]<class M>(std::string_view each) {
    if (each == name) half = make.template operator()<M>();
  });
  if (!half) {
    std::string known;
    for (const std::string& each : method_names()) known += (known.empty() ? "" : ", ") + each;
    throw ConfigError{"control.passivity.method is " + name + "; it must be one of " + known};
  }
  return half;
}

}  // namespace

std::vector<std::string> method_names() {
  std::vector<std::string> all;
  for_each_method([&]<class M>(std::string_view name) { all.emplace_back(name); });
  return all;
}
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
  const auto keeps = [](const ControlOptions& o) {
    if (o.architecture == Architecture::render) return o.controller.method != Method::none;
    bool found = false;
    for_each_method(
        [&]<class M>(std::string_view name) { found = found || (name == o.method_name && keeps_account<M>()); });
    return found;
  };
  return keeps(first) || std::any_of(schedule.begin(), schedule.end(),
                                     [&](const ScheduledControl& entry) { return keeps(entry.control); });
}

template <int N>
AnyMasterHalf<N>::AnyMasterHalf(const ControlOptions& o)
    : half_{make_by_name<std::unique_ptr<Concept>>(
          o.method_name, [&]<class M>() { return std::make_unique<Model<typename M::template Master<N>>>(o); })} {}
template <int N>
AnySlaveHalf<N>::AnySlaveHalf(const ControlOptions& o)
    : half_{make_by_name<std::unique_ptr<Concept>>(
          o.method_name, [&]<class M>() { return std::make_unique<Model<typename M::template Slave<N>>>(o); })} {}

template class AnyMasterHalf<1>;
template class AnyMasterHalf<3>;
template class AnyMasterHalf<6>;
template class AnySlaveHalf<1>;
template class AnySlaveHalf<3>;
template class AnySlaveHalf<6>;

}  // namespace twoport
