#include "common/hardware/registry.h"

#include <algorithm>

#include "common/base/check.h"

namespace twoport {

template <template <int> class Hardware>
std::string DriverList<Hardware>::lines() const {
  std::string all;
  for (const Entry& each : drivers_) all += each.name + "\t" + each.sentence + "\n";
  all += "PATH.so[:ARGS]\ta driver of your own, built against the installed twoport\n";
  return all;
}

template <template <int> class Hardware>
auto DriverList<Hardware>::find(const std::string& name) const -> const Entry& {
  const auto found =
      std::find_if(drivers_.begin(), drivers_.end(), [&](const Entry& each) { return each.name == name; });
  if (found != drivers_.end() && found->missing) throw ConfigError{flag_ + " " + name + ": " + found->sentence};
  if (found != drivers_.end()) return *found;
  std::string known;
  for (const Entry& each : drivers_) known += each.name + ", ";
  throw ConfigError{flag_ + " " + name + ": no driver has this name; it must be one of " + known + "or PATH.so"};
}

template <template <int> class Hardware>
void DriverList<Hardware>::refuse_size(const Entry& driver, int wanted) const {
  std::string sizes;
  const auto has = [&](bool maker, const char* size) {
    if (maker) sizes += (sizes.empty() ? "" : " or ") + std::string{size};
  };
  has(static_cast<bool>(std::get<0>(driver.makers)), "1");
  has(static_cast<bool>(std::get<1>(driver.makers)), "3");
  has(static_cast<bool>(std::get<2>(driver.makers)), "6");
  const bool joints = wanted == kJointPort;
  throw ConfigError{
      flag_ + " " + driver.name + ": drives dof " + sizes +
      (joints ? ", but space of the scene is JOINTS" : ", but dof of the scene is " + std::to_string(wanted))};
}

template class DriverList<Device>;
template class DriverList<Robot>;

}  // namespace twoport
