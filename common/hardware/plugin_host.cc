#include "common/hardware/plugin_host.h"

#include <dlfcn.h>
#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <type_traits>
#include <utility>

#include "common/base/check.h"
#include "common/hardware/device.h"
#include "common/hardware/plugin.h"
#include "common/hardware/robot.h"

namespace twoport {
namespace {

template <class Interface>
constexpr bool kIsDevice = std::is_same_v<Interface, plugin::Device>;

/// Of an entry point.
struct Kind {
  const char* symbol;
  const char* is_for;  ///< an option, and what the scene must say
  std::uint32_t oldest, newest;
};
constexpr Kind kDevicePlugin{"twoport_device_plugin", "--device", plugin::kOldestVersion, plugin::kVersion};
constexpr Kind kRobotPlugin{"twoport_robot_plugin", "--robot", plugin::kOldestVersion, plugin::kVersion};
constexpr Kind kLeaderPlugin{"twoport_leader_plugin", "--device with space JOINTS", 1, plugin::kArmVersion};
constexpr Kind kFollowerPlugin{"twoport_follower_plugin", "--robot with space JOINTS", 1, plugin::kArmVersion};

[[noreturn]] void refuse(const std::string& flag, const PluginChoice& choice, const std::string& why) {
  throw ConfigError{flag + " " + choice.path + (choice.arguments.empty() ? "" : ":" + choice.arguments) + ": " + why};
}

/// A symbol of a function, as the library's table says; where it says nothing, yes.
bool is_function(void* symbol) {
  Dl_info info;
  void* entry = nullptr;
  if (dladdr1(symbol, &info, &entry, RTLD_DL_SYMENT) == 0 || entry == nullptr) return true;
  const int type = ELF64_ST_TYPE(static_cast<const ElfW(Sym)*>(entry)->st_info);
  return type == STT_FUNC || type == STT_GNU_IFUNC;
}

template <class Interface>
const plugin::Entry<Interface>& load(const Kind& kind, const std::string& flag, const PluginChoice& choice) {
  std::error_code error;
  if (!std::filesystem::exists(choice.path, error))
    refuse(flag, choice, "there is no such file; give the path of a shared library");
  if (!std::filesystem::is_regular_file(choice.path, error))
    refuse(flag, choice, "it is not a regular file; give the path of a shared library");
  // A name without a slash would be searched in the system's folders.
  const std::string path = std::filesystem::absolute(choice.path).string();
  if (const std::string why = try_to_load(path); !why.empty()) refuse(flag, choice, "cannot be loaded: " + why);
  void* const library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) refuse(flag, choice, std::string{"cannot be loaded: "} + dlerror());
  void* const symbol = dlsym(library, kind.symbol);
  if (symbol == nullptr) {
    std::string others;
    for (const Kind& other : {kDevicePlugin, kRobotPlugin, kLeaderPlugin, kFollowerPlugin})
      if (dlsym(library, other.symbol) != nullptr)
        others += (others.empty() ? "; it has one for " : " and one for ") + std::string{other.is_for};
    refuse(flag, choice,
           std::string{"is no plug-in for "} + kind.is_for + ": it has no entry point " + kind.symbol + others);
  }
  if (!is_function(symbol))
    refuse(flag, choice, std::string{"its entry point "} + kind.symbol + " is no function; use the macro of plugin.h");
  const plugin::Entry<Interface>* entry = nullptr;
  std::string why;
  try {
    entry = reinterpret_cast<const plugin::Entry<Interface>* (*)()>(symbol)();
  } catch (...) {
    why = "its entry point threw: " + current_words();
  }
  if (!why.empty()) refuse(flag, choice, why);
  if (entry == nullptr) refuse(flag, choice, "its entry point returns nothing");
  if (entry->version < kind.oldest || entry->version > kind.newest)
    refuse(flag, choice,
           "is a plug-in of version " + std::to_string(entry->version) + ", and this program loads " +
               (kind.oldest == kind.newest ? "version " : "versions " + std::to_string(kind.oldest) + " to ") +
               std::to_string(kind.newest) + "; build it again with the installed twoport");
  return *entry;
}

/// Notes the first of a description's numbers that cannot be true.
struct Needs {
  void operator()(bool met, const std::string& name, double value, const char* what) {
    if (!met && why.empty()) why = fmt::format("info() says {} {:g}; it must be {}", name, value, what);
  }
  std::string why;
};

/// Why a plug-in's description cannot be true; empty: it can.
template <class Info>
std::string defect(const Info& info) {
  Needs need;
  const auto known = [&](const char* name, double v) {
    need(v >= 0.0 && std::isfinite(v), name, v, ">= 0 and finite");
  };
  need(info.dof == 1 || info.dof == 3 || info.dof == 6, "dof", info.dof, "1, 3 or 6");
  known("watchdog_s", info.watchdog_s);
  if constexpr (std::is_same_v<Info, plugin::DeviceInfo>) {
    need(info.peak_force_n >= 0.0, "peak_force_n", info.peak_force_n, ">= 0");
    need(info.peak_torque_n_m >= 0.0, "peak_torque_n_m", info.peak_torque_n_m, ">= 0");
    need(info.continuous_force_n >= 0.0, "continuous_force_n", info.continuous_force_n, ">= 0");
    for (const double extent : info.workspace_m) known("workspace_m", extent);
    known("resolution_m", info.resolution_m);
    known("rate_hz", info.rate_hz);
    known("mass_kg", info.mass_kg);
    known("inertia_kg_m2", info.inertia_kg_m2);
    need(info.buttons >= 0 && info.buttons <= 32, "buttons", info.buttons, "0 to 32");
  } else {
    need(info.max_force_n > 0.0, "max_force_n", info.max_force_n, "> 0");
    need(info.max_torque_n_m > 0.0, "max_torque_n_m", info.max_torque_n_m, "> 0");
    need(info.max_speed_m_per_s > 0.0, "max_speed_m_per_s", info.max_speed_m_per_s, "> 0");
    need(info.workspace_m > 0.0, "workspace_m", info.workspace_m, "> 0");
    known("servo_rate_hz", info.servo_rate_hz);
    known("servo_delay_s", info.servo_delay_s);
    known("servo_lag_s", info.servo_lag_s);
  }
  return need.why;
}
std::string defect(const plugin::ArmInfo& info) {
  Needs need;
  need(info.joints >= 1 && info.joints <= plugin::kMostJoints, "joints", info.joints, "1 to 8");
  need(info.watchdog_s >= 0.0 && std::isfinite(info.watchdog_s), "watchdog_s", info.watchdog_s, ">= 0 and finite");
  for (int i = 0; i < info.joints && need.why.empty(); ++i) {
    const plugin::ArmLimits& limits = info.limits[i];
    const std::string of = fmt::format("limits[{}].", i);
    need(limits.torque > 0.0, of + "torque", limits.torque, "> 0");
    need(limits.speed > 0.0, of + "speed", limits.speed, "> 0");
    need(limits.lower < limits.upper, of + "lower", limits.lower, "below upper");
  }
  return need.why;
}

const char* name_of(const char* name) {
  return name == nullptr ? "" : name;
}

/// What hardware says of itself whose library has this version.
template <class Interface>
auto info_of(const Interface& hardware, std::uint32_t version) {
  auto info = hardware.info();
  // The description of an older robot ends before its servo.
  if constexpr (std::is_same_v<Interface, plugin::Robot>)
    if (version < 3) info.servo_rate_hz = info.servo_delay_s = info.servo_lag_s = 0.0;
  return info;
}

/// The gripper of hardware whose library has this version; null: none. Why it cannot be one goes into `why`.
template <class Interface>
Interface* gripper_of(Interface& hardware, std::uint32_t version, std::string& why) {
  // The functions of an older plug-in end before gripper().
  if (version < 2) return nullptr;
  Interface* const gripper = hardware.gripper();
  if constexpr (kIsDevice<Interface>)
    if (gripper == nullptr && hardware.info().gripper) why = "info() says gripper true, but gripper() returns null";
  if (gripper == nullptr) return nullptr;
  if (gripper == &hardware) {
    why = "gripper() returns the hardware itself; it must be another object";
    return nullptr;
  }
  const auto info = info_of(*gripper, version);
  why = defect(info);
  if (why.empty() && info.dof != 1) why = fmt::format("info() says dof {}; it must be 1", info.dof);
  if (!why.empty()) why = "gripper: " + why;
  return gripper;
}

/// Why hardware does not fit the scene's port; empty: it does.
std::string mismatch(const auto& info, int dof) {
  return info.dof >= dof ? "" : fmt::format("drives dof {}, but dof of the scene is {}", info.dof, dof);
}
std::string mismatch(const plugin::ArmInfo& info, int joints) {
  return joints == 0 || info.joints == joints
             ? ""
             : fmt::format("has {} joints, but the arms of the scene have {}", info.joints, joints);
}

/// What a plug-in has opened. The gripper is the hardware's; null: none.
template <class Interface>
struct Opened {
  std::unique_ptr<Interface> hardware;
  Interface* gripper = nullptr;
  std::uint32_t version = 0;
};

template <class Interface>
Opened<Interface> open(const Kind& kind, const std::string& flag, const PluginChoice& choice, int dof, Seconds period) {
  const plugin::Entry<Interface>& entry = load<Interface>(kind, flag, choice);
  Opened<Interface> opened;
  opened.version = entry.version;
  std::unique_ptr<Interface>& hardware = opened.hardware;
  std::string why;
  try {
    hardware.reset(entry.open({choice.arguments.c_str(), dof, period.si()}));
    if (hardware) {
      const auto info = info_of(*hardware, entry.version);
      why = defect(info);
      if (why.empty()) why = mismatch(info, dof);
      if constexpr (!std::is_same_v<Interface, plugin::JointArm>)
        if (why.empty()) opened.gripper = gripper_of(*hardware, entry.version, why);
    }
  } catch (...) {
    why = current_words();
  }
  if (!why.empty()) refuse(flag, choice, why);
  if (!hardware) refuse(flag, choice, "has opened nothing and does not say why");
  return opened;
}

template <class Quantity>
Quantity coords(const double* six) {
  return Quantity{typename Quantity::Vector{six}};
}
template <int N>
Position<N> position(const double* p, const double* q) {
  if constexpr (N == 6) {
    return {{p[0], p[1], p[2]}, Eigen::Quaterniond{q[0], q[1], q[2], q[3]}};
  } else {
    return Position<N>{typename Position<N>::Vector{p}};
  }
}

/// A status that this program does not know is a fault.
HardwareStatus status_of(plugin::Status s) noexcept {
  constexpr HardwareStatus kKnown[] = {HardwareStatus::ok, HardwareStatus::stale, HardwareStatus::fault,
                                       HardwareStatus::stopped};
  const auto number = static_cast<std::size_t>(s);
  return number < std::size(kKnown) ? kKnown[number] : HardwareStatus::fault;
}

/// Hardware of a plug-in. A call that throws is the last one before release(): from then on every reading is the last good one
/// and a fault, and commands are dropped.
template <class Interface>
class Guarded {
 public:
  /// `path` names the hardware in words.
  Guarded(Interface& hardware, std::string path) : hardware_{hardware}, path_{std::move(path)} {}

  /// Calls use(hardware) unless a call has failed before. True: it has not thrown.
  template <class Use>
  bool call(const char* name, Use use) noexcept {
    if (failed_) return false;
    try {
      use(hardware_);
      return true;
    } catch (...) {
      failed_ = true;
      try {
        trouble_ = path_ + ": " + name + "() threw: " + current_words();
      } catch (...) {
        trouble_.clear();  // no memory left
      }
    }
    return false;
  }
  /// Of every reading: `finite` is whether all of its numbers are. False once they have not been for a tenth of a second; the node
  /// applies no force meanwhile.
  bool plausible(bool finite, Seconds ended) noexcept {
    if (finite) [[likely]] {
      not_finite_ = Seconds{};
      return true;
    }
    not_finite_ += ended;
    if (not_finite_ < Seconds{0.1}) return true;
    try {
      if (!failed_) trouble_ = path_ + ": readings are not finite numbers";
    } catch (...) {
    }
    failed_ = true;
    return false;
  }
  /// Also after a failure, which need not keep the hardware from letting go.
  void release() noexcept {
    const bool failed = std::exchange(failed_, false);
    call("release", [](Interface& h) { h.release(); });
    failed_ = failed_ || failed;
  }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  Interface& hardware_;
  std::string path_, trouble_;
  bool failed_ = false;
  Seconds not_finite_;
};

void describe(const plugin::DeviceInfo& from, DeviceInfo& info) {
  info.name = name_of(from.name);
  info.max_force_n = from.peak_force_n;
  info.mass_kg = from.mass_kg;
  info.inertia_kg_m2 = from.inertia_kg_m2;
  info.limits.torque_n_m = from.peak_torque_n_m;
  info.watchdog = Seconds{from.watchdog_s};
  info.dof = from.dof;
  std::copy_n(from.workspace_m, 3, info.workspace_m.begin());
  info.continuous_force_n = from.continuous_force_n;
  info.resolution_m = from.resolution_m;
  info.rate_hz = from.rate_hz;
  info.buttons = from.buttons;
  info.gripper = from.gripper;
}
void describe(const plugin::RobotInfo& from, RobotInfo& info) {
  info.name = name_of(from.name);
  info.has_force_sensor = from.has_force_sensor;
  info.limits.force_n = from.max_force_n;
  info.limits.torque_n_m = from.max_torque_n_m;
  info.limits.speed_m_per_s = from.max_speed_m_per_s;
  info.limits.workspace_m = from.workspace_m;
  if (from.servo_rate_hz > 0.0)
    info.servo = Servo{.period = Seconds{1.0 / from.servo_rate_hz},
                       .delay = Seconds{from.servo_delay_s},
                       .lag = Seconds{from.servo_lag_s}};
  info.watchdog = Seconds{from.watchdog_s};
}
void describe(const plugin::ArmInfo& from, auto& info) {
  info.name = name_of(from.name);
  info.watchdog = Seconds{from.watchdog_s};
  JointLimits& all = info.limits.joints;
  for (int i = 0; i < from.joints; ++i) {
    const plugin::ArmLimits& limits = from.limits[i];
    all.effort[i] = limits.torque;
    all.speed[i] = limits.speed;
    all.lower[i] = limits.lower;
    all.upper[i] = limits.upper;
  }
  if constexpr (requires { info.dof; })
    info.dof = from.joints;
  else
    info.has_force_sensor = from.has_torque_sensors;
}
template <int N>
void read(const plugin::DeviceReading& r, DeviceSample<N>& s) {
  s = {.x = position<N>(r.position_m, r.attitude),
       .v = coords<Velocity<N>>(r.velocity),
       .applied = coords<Force<N>>(r.applied),
       .status = status_of(r.status),
       .buttons = r.buttons,
       .held = r.held};
}
template <int N>
void read(const plugin::RobotReading& r, RobotSample<N>& s) {
  s = {.x = position<N>(r.position_m, r.attitude),
       .v = coords<Velocity<N>>(r.velocity),
       .f_environment = coords<Force<N>>(r.force),
       .ideal = r.ideal,
       .status = status_of(r.status)};
}
/// Of the first `joints`; the others are zero.
template <class Quantity>
Quantity of_joints(const double* each, int joints) {
  typename Quantity::Vector all = Quantity::Vector::Zero();
  std::copy_n(each, joints, all.data());
  return Quantity{all};
}
/// A leader's motors push the hand.
void read(const plugin::ArmReading& r, int joints, DeviceSample<kJointPort>& s) {
  s = {.x = of_joints<Position<kJointPort>>(r.position, joints),
       .v = of_joints<Velocity<kJointPort>>(r.velocity, joints),
       .applied = -of_joints<Force<kJointPort>>(r.applied, joints),
       .status = status_of(r.status),
       .buttons = r.buttons,
       .held = r.held};
}
/// What a follower senses acts on it.
void read(const plugin::ArmReading& r, int joints, RobotSample<kJointPort>& s) {
  s = {.x = of_joints<Position<kJointPort>>(r.position, joints),
       .v = of_joints<Velocity<kJointPort>>(r.velocity, joints),
       .f_environment = -of_joints<Force<kJointPort>>(r.external, joints),
       .ideal = r.ideal,
       .status = status_of(r.status)};
}
const auto& force_of(const auto& sample) {
  if constexpr (requires { sample.applied; })
    return sample.applied;
  else
    return sample.f_environment;
}
template <int N>
void command(plugin::Device& device, const Force<N>& f) {
  double six[6]{};
  std::copy_n(f.vec().data(), N, six);
  device.actuate(six);
}
template <int N>
void command(plugin::Robot& robot, const RobotCommand<N>& c) {
  plugin::RobotCommand plain;
  std::copy_n(c.f.vec().data(), N, plain.force);
  std::copy_n(c.v_d.vec().data(), N, plain.velocity);
  std::copy_n(c.x_d.translation().data(), std::min(N, 3), plain.position_m);
  if constexpr (N == 6) {
    plain.attitude[0] = c.x_d.attitude().w();
    std::copy_n(c.x_d.attitude().vec().data(), 3, plain.attitude + 1);
  }
  robot.actuate(plain);
}

void command(plugin::JointArm& leader, const Force<kJointPort>& f) {
  plugin::ArmCommand plain;
  const Force<kJointPort> on_arm = -f;
  std::copy_n(on_arm.vec().data(), kJointPort, plain.torque);
  leader.actuate(plain);
}
void command(plugin::JointArm& follower, const RobotCommand<kJointPort>& c) {
  plugin::ArmCommand plain;
  std::copy_n(c.f.vec().data(), kJointPort, plain.torque);
  std::copy_n(c.x_d.translation().data(), kJointPort, plain.position);
  std::copy_n(c.v_d.vec().data(), kJointPort, plain.velocity);
  follower.actuate(plain);
}

/// The types of a Device or Robot, and of its plug-ins.
template <template <int> class Hardware, int N>
struct Types {
  static constexpr bool kArm = N == kJointPort;
  using Interface = std::conditional_t<kArm, plugin::JointArm, plugin::Device>;
  using Info = DeviceInfo;
  using Reading = std::conditional_t<kArm, plugin::ArmReading, plugin::DeviceReading>;
  using Sample = DeviceSample<N>;
  using Command = Force<N>;
  using Clock = MasterClock;
  static constexpr Kind kKind = kArm ? kLeaderPlugin : kDevicePlugin;
};
template <int N>
struct Types<Robot, N> {
  static constexpr bool kArm = N == kJointPort;
  using Interface = std::conditional_t<kArm, plugin::JointArm, plugin::Robot>;
  using Info = RobotInfo;
  using Reading = std::conditional_t<kArm, plugin::ArmReading, plugin::RobotReading>;
  using Sample = RobotSample<N>;
  using Command = RobotCommand<N>;
  using Clock = SlaveClock;
  static constexpr Kind kKind = kArm ? kFollowerPlugin : kRobotPlugin;
};

template <template <int> class Hardware, int N>
class Plugin final : public Hardware<N> {
  using T = Types<Hardware, N>;
  using Interface = typename T::Interface;

 public:
  Plugin(Opened<Interface> opened, const std::string& path) : Plugin{*opened.hardware, path, opened.version} {
    owned_ = std::move(opened.hardware);
    if constexpr (!T::kArm) {
      if (opened.gripper == nullptr) return;
      gripper_ = std::make_unique<Plugin<Hardware, 1>>(*opened.gripper, path, opened.version);
      if constexpr (kIsDevice<Interface>) info_.gripper = true;
    }
  }
  /// `hardware` must outlive this object.
  Plugin(Interface& hardware, const std::string& path, std::uint32_t version) : hardware_{hardware, path} {
    const auto info = info_of(hardware, version);
    describe(info, info_);
    if constexpr (T::kArm) joints_ = info.joints;
  }

  [[nodiscard]] typename T::Info info() const override { return info_; }
  typename T::Sample sense(const Tick<typename T::Clock>& tick) noexcept override {
    typename T::Reading r;
    if (!hardware_.call("sense", [&](Interface& h) {
          r = h.sense(to_seconds(tick.now.time_since_epoch()).si(), tick.ended.si());
        })) [[unlikely]] {
      last_.status = HardwareStatus::fault;
      return last_;
    }
    if constexpr (T::kArm)
      read(r, joints_, last_);
    else
      read(r, last_);
    if (!hardware_.plausible(all_finite(last_.x, last_.v, force_of(last_)), tick.ended))
      last_.status = HardwareStatus::fault;
    return last_;
  }
  void actuate(const typename T::Command& c) noexcept override {
    hardware_.call("actuate", [&](Interface& h) { command(h, c); });
  }
  void start() noexcept override {
    hardware_.call("start", [](Interface& h) { h.start(); });
  }
  void release() noexcept override { hardware_.release(); }
  [[nodiscard]] std::string trouble() const override { return hardware_.trouble(); }
  [[nodiscard]] Hardware<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  std::unique_ptr<Interface> owned_;  ///< null for a gripper
  Guarded<Interface> hardware_;
  typename T::Info info_;
  int joints_ = 0;  ///< of a port of joints
  typename T::Sample last_;
  std::unique_ptr<Plugin<Hardware, 1>> gripper_;
};

}  // namespace

std::optional<PluginChoice> plugin_choice(const std::string& choice) {
  for (std::size_t at = choice.find(".so"); at != choice.npos; at = choice.find(".so", at + 1)) {
    const std::size_t end = at + 3;
    if (end == choice.size()) return PluginChoice{choice, {}};
    if (choice[end] == ':') return PluginChoice{choice.substr(0, end), choice.substr(end + 1)};
  }
  return {};
}

template <template <int> class Hardware, int N>
std::unique_ptr<Hardware<N>> open_plugin(const std::string& flag, const PluginChoice& choice, int dof, Seconds period) {
  using T = Types<Hardware, N>;
  return std::make_unique<Plugin<Hardware, N>>(open<typename T::Interface>(T::kKind, flag, choice, dof, period),
                                               choice.path);
}

#define TWOPORT_OPEN(Hardware, N) \
  template std::unique_ptr<Hardware<N>> open_plugin<Hardware, N>(const std::string&, const PluginChoice&, int, Seconds)
TWOPORT_OPEN(Device, 1);
TWOPORT_OPEN(Device, 3);
TWOPORT_OPEN(Device, 6);
TWOPORT_OPEN(Device, kJointPort);
TWOPORT_OPEN(Robot, 1);
TWOPORT_OPEN(Robot, 3);
TWOPORT_OPEN(Robot, 6);
TWOPORT_OPEN(Robot, kJointPort);

}  // namespace twoport
