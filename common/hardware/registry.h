#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/scalar.h"
#include "common/hardware/device.h"
#include "common/hardware/plugin_host.h"
#include "common/hardware/robot.h"

namespace twoport {

struct PageChannel;
struct Scene;

/// Arguments of a driver's constructor.
struct DriverOptions {
  const Scene& scene;
  Seconds period;               ///< of the loop that will call it
  std::string arguments;        ///< text after "NAME:" on the command line, or empty
  PageChannel* page = nullptr;  ///< of --page; null: the program serves none
};

/// The drivers of one interface (Hardware is Device or Robot) by name.
template <template <int> class Hardware>
class DriverList {
 public:
  /// `flag` is the command-line option that chooses a driver, e.g. "--device".
  explicit DriverList(std::string flag) : flag_{std::move(flag)} {}

  /// Adds a class template for all sizes: Driver<N> derives from Hardware<N> and is constructed from DriverOptions. Of joints only where
  /// Driver<N>::kDrivesJoints says so.
  /// `sentence` is its description in --list-devices.
  template <template <int> class Driver>
  void add(const std::string& name, const std::string& sentence) {
    drivers_.push_back({name,
                        sentence,
                        {maker<Driver, 1>(), maker<Driver, 3>(), maker<Driver, 6>(), maker<Driver, kJointPort>()},
                        false});
  }
  /// Adds a class that drives one size, that of the Hardware<N> it derives from.
  template <class Driver>
  void add(const std::string& name, const std::string& sentence) {
    drivers_.push_back({name, sentence, {}, false});
    std::get<Maker<Driver::kSize>>(drivers_.back().makers) = make<Driver>;
  }
  /// A name whose driver this build lacks. `sentence`: why.
  void add_missing(const std::string& name, const std::string& sentence) {
    drivers_.push_back({name, sentence, {}, true});
  }

  /// Opens "NAME", "NAME:ARGUMENTS", or a plug-in, "PATH.so" or "PATH.so:ARGUMENTS". Throws ConfigError for an unknown name, a
  /// size that the driver does not support, a plug-in that cannot be loaded, and errors of the driver's constructor.
  /// `scene` is a Scene, which is of a higher layer.
  template <int N>
  [[nodiscard]] std::unique_ptr<Hardware<N>> open(const std::string& choice, const auto& scene, Seconds period,
                                                  PageChannel* page = nullptr) const {
    if (const std::optional<PluginChoice> plugin = plugin_choice(choice))
      return open_plugin<Hardware, N>(flag_, *plugin, N == kJointPort ? scene.joints : N, period);
    const std::size_t colon = choice.find(':');
    const Entry& driver = find(choice.substr(0, colon));
    const Maker<N>& maker = std::get<Maker<N>>(driver.makers);
    if (!maker) refuse_size(driver, N);
    return maker({scene, period, colon == choice.npos ? std::string{} : choice.substr(colon + 1), page});
  }

  /// One line per driver, and one for plug-ins: name, tab, sentence.
  [[nodiscard]] std::string lines() const;

 private:
  template <int N>
  using Maker = std::function<std::unique_ptr<Hardware<N>>(const DriverOptions&)>;
  struct Entry {
    std::string name, sentence;
    std::tuple<Maker<1>, Maker<3>, Maker<6>, Maker<kJointPort>> makers;
    bool missing;
  };
  template <class Driver>
  static std::unique_ptr<Hardware<Driver::kSize>> make(const DriverOptions& options) {
    return std::make_unique<Driver>(options);
  }
  template <template <int> class Driver, int N>
  static Maker<N> maker() {
    if constexpr (!built_for(N)) {
      return {};
    } else if constexpr (N != kJointPort) {
      return make<Driver<N>>;
    } else if constexpr (requires { Driver<N>::kDrivesJoints; }) {
      return make<Driver<N>>;
    } else {
      return {};
    }
  }
  [[nodiscard]] const Entry& find(const std::string& name) const;
  [[noreturn]] void refuse_size(const Entry& driver, int wanted) const;

  std::string flag_;
  std::vector<Entry> drivers_;
};

extern template class DriverList<Device>;
extern template class DriverList<Robot>;

/// All drivers of a program.
struct Registry {
  DriverList<Device> devices{"--device"};
  DriverList<Robot> robots{"--robot"};
};

}  // namespace twoport
