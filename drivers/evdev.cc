#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "common/scene/scene.h"
#include "drivers/effect_thread.h"
#include "drivers/evdev_stick.h"
#include "drivers/force_feedback.h"
#include "drivers/rumble.h"
#include "drivers/smoothed_target.h"

namespace twoport {
namespace {

constexpr double kReach = 0.05, kTurn = 0.5;  // of the handle at full deflection [m], [rad]
constexpr double kCutoffHz = 15.0;            // of the handle's motion: sticks report at 100 to 250 Hz
constexpr double kFullForce = 1.0,
                 kFullRumble = 5.0;     // at the largest level of an effect, unless ARGS say otherwise [N]
constexpr int kMostEvents = 256;        // read in one tick
constexpr double kOpening = 0.06;       // of a gripper whose scene does not say where its handle begins [m]
constexpr double kGripperTravel = 1.0;  // of buttons, from open to closed [s]

/// PATH, PATH,NEWTONS or nothing.
struct Arguments {
  std::string path;
  std::optional<double> full_force_n;
};
Arguments parse(const std::string& text) {
  Arguments a{text, {}};
  const std::size_t comma = text.find(',');
  if (comma == text.npos) return a;
  a.path = text.substr(0, comma);
  char* end = nullptr;
  a.full_force_n = std::strtod(text.c_str() + comma + 1, &end);
  if (*end != '\0' || !(*a.full_force_n > 0.0 && *a.full_force_n <= 50.0))
    throw ConfigError{"--device evdev:" + text +
                      ": after the comma stands the force of the strongest effect, above 0 and at most 50 N"};
  return a;
}

/// An opened event device.
class EventDevice {
 public:
  explicit EventDevice(const std::string& path) : path_{path} {
    fd_ = open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    writable_ = fd_ >= 0;
    if (fd_ < 0) fd_ = open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    error_ = fd_ < 0 ? errno : -libevdev_new_from_fd(fd_, &device_);
  }
  ~EventDevice() {
    if (device_ != nullptr) libevdev_free(device_);
    if (fd_ >= 0) close(fd_);
  }
  EventDevice(const EventDevice&) = delete;
  EventDevice& operator=(const EventDevice&) = delete;

  /// 0, or why it could not be opened.
  [[nodiscard]] int error() const { return error_; }
  [[nodiscard]] libevdev* get() const { return device_; }
  [[nodiscard]] int fd() const { return fd_; }
  [[nodiscard]] bool writable() const { return writable_; }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
  int fd_ = -1, error_ = 0;
  bool writable_ = false;
  libevdev* device_ = nullptr;
};

std::unique_ptr<EventDevice> open_stick(const std::string& path) {
  auto device = std::make_unique<EventDevice>(path);
  if (device->error() == EACCES)
    throw ConfigError{"--device evdev:" + path +
                      ": no permission; join the group input (sudo usermod -aG input $USER)"};
  if (device->error() != 0) throw ConfigError{"--device evdev:" + path + ": " + std::strerror(device->error())};
  if (!is_stick(device->get()))
    throw ConfigError{"--device evdev:" + path + ": " + libevdev_get_name(device->get()) +
                      " is no joystick: it lacks two axes or buttons of one"};
  return device;
}

std::unique_ptr<EventDevice> first_stick() {
  std::vector<std::string> paths;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{"/dev/input", error})
    if (entry.path().filename().string().starts_with("event")) paths.push_back(entry.path().string());
  std::sort(paths.begin(), paths.end());
  int hidden = 0;
  for (const std::string& path : paths) {
    auto device = std::make_unique<EventDevice>(path);
    if (device->error() == EACCES) ++hidden;
    if (device->error() == 0 && is_stick(device->get())) return device;
  }
  throw ConfigError{"--device evdev: no joystick among " + std::to_string(paths.size()) + " files /dev/input/event*" +
                    (hidden > 0 ? ", of which " + std::to_string(hidden) +
                                      " may not be read; join the group input (sudo usermod -aG input $USER)"
                                : "; connect one, or name its file as in evdev:/dev/input/event5")};
}

/// The effects of an event device.
class EventEffects final : public EffectPort {
 public:
  explicit EventEffects(int fd) : fd_{fd} {}
  bool upload(ff_effect& effect) noexcept override { return ioctl(fd_, EVIOCSFF, &effect) == 0; }
  void erase(int id) noexcept override { ioctl(fd_, EVIOCRMFF, id); }
  bool write(unsigned code, int value) noexcept override {
    input_event event{};
    event.type = EV_FF;
    event.code = static_cast<std::uint16_t>(code);
    event.value = value;
    return ::write(fd_, &event, sizeof event) == static_cast<ssize_t>(sizeof event);
  }

 private:
  int fd_;
};

/// The trigger or two buttons of a stick as a gripper: the position of its handle, from closed (0) to where the scene's gripper begins.
/// It displays no force. The stick's driver reads the events.
class StickGripperDevice final : public Device<1> {
 public:
  /// `stick` must outlive it.
  StickGripperDevice(const EventDevice& stick, const bool& lost, const StickGripper& of, double opening_m)
      : stick_{stick}, lost_{lost}, of_{of}, opening_m_{opening_m}, motion_{kCutoffHz, Force<1>::Vector{opening_m}} {}

  [[nodiscard]] DeviceInfo info() const override {
    return {
        .name = std::string{of_.trigger != 0 ? "trigger" : "two buttons"} + " of " + libevdev_get_name(stick_.get()),
        .max_force_n = 0.0,
        .watchdog = Seconds{1.0},
        .dof = 1,
        .workspace_m = {opening_m_, 0.0, 0.0}};
  }
  DeviceSample<1> sense(const Tick<MasterClock>& tick) noexcept override {
    const double dt_s = std::min(tick.ended.si(), 0.1);
    open_ = stick_opening(stick_.get(), of_, open_, dt_s, kGripperTravel);
    motion_.advance(Force<1>::Vector{open_ * opening_m_}, dt_s);
    DeviceSample<1> sample{.x = position_at<1>(motion_.x()), .v = Velocity<1>{motion_.v()}, .applied = {}};
    if (lost_) sample.status = HardwareStatus::fault;
    return sample;
  }
  void actuate(const Force<1>&) noexcept override {}
  void release() noexcept override {}

 private:
  const EventDevice& stick_;
  const bool& lost_;
  StickGripper of_;
  double opening_m_, open_ = 1.0;
  SmoothedTarget<1> motion_;
};

/// Where the handle of the scene's gripper begins: that is open.
double opening_of(const Scene& scene) {
  if (!scene.gripper || !scene.gripper->device || scene.gripper->device->position_m.empty()) return kOpening;
  const double opening = scene.gripper->device->position_m[0];
  return opening > 0.0 ? opening : kOpening;
}

/// A joystick or gamepad: the deflection is the position of a handle within 50 mm (and 0.5 rad). Its constant-force effect, where
/// it has one, displays the force to the right and forward, else its rumble the size of the force; the strength of the strongest effect in
/// newtons is what ARGS say. A vibration does no work; `applied` is then the force that it stands for, so that the robot presses as hard as the
/// hand is told.
template <int N>
class EvdevDevice final : public Device<N> {
 public:
  explicit EvdevDevice(const DriverOptions& o)
      : arguments_{parse(o.arguments)},
        device_{arguments_.path.empty() ? first_stick() : open_stick(arguments_.path)},
        motion_{kCutoffHz},
        effects_{device_->fd()} {
    const unsigned effect = device_->writable() ? stick_effect(device_->get()) : 0;
    if (effect == FF_CONSTANT) open_effect(force_, kFullForce);
    if (effect == FF_RUMBLE) open_effect(rumble_, kFullRumble);
    if (const StickGripper of = stick_gripper(device_->get()))
      gripper_ = std::make_unique<StickGripperDevice>(*device_, lost_, of, opening_of(o.scene));
  }

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = std::string{libevdev_get_name(device_->get())} + " at " + device_->path() +
                    (rumble_ ? ", rumble in place of force" : ""),
            .max_force_n = most_n_,
            .watchdog = to_seconds(ForceFeedback::kEffectLength),
            .dof = 6,
            .workspace_m = {2.0 * kReach, 2.0 * kReach, 2.0 * kReach},
            .buttons = stick_buttons(device_->get()),
            .gripper = gripper_ != nullptr};
  }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    if (!lost_) read();
    const StickState state = stick_state(device_->get());
    typename Velocity<N>::Vector target;
    for (int i = 0; i < N; ++i) target[i] = state.axis[static_cast<std::size_t>(i)] * (i < 3 ? kReach : kTurn);
    motion_.advance(target, std::min(tick.ended.si(), 0.1));
    DeviceSample<N> sample{.x = position_at<N>(motion_.x()), .v = Velocity<N>{motion_.v()}, .applied = {}};
    if (force_) {
      typename Force<N>::Vector applied = Force<N>::Vector::Zero();
      const ForceFeedback::Vector push = force_->effect().played();
      for (int i = 0; i < std::min(N, 2); ++i) applied[i] = -push[static_cast<std::size_t>(i)];
      sample.applied = Force<N>{applied};
    }
    if (rumble_) sample.applied = told_;
    sample.buttons = state.buttons;
    if (lost_) sample.status = HardwareStatus::fault;
    return sample;
  }
  void actuate(const Force<N>& f) noexcept override {
    if (force_) force_->effect().push(-f[0], N > 1 ? -f[std::min(1, N - 1)] : 0.0);
    if (!rumble_) return;
    told_ = f;
    rumble_->effect().push(f.vec().template head<std::min(N, 3)>().norm());
  }
  void release() noexcept override {
    if (force_) force_->effect().let_go();
    if (!rumble_) return;
    told_ = Force<N>{};
    rumble_->effect().let_go();
  }
  [[nodiscard]] std::string trouble() const override { return lost_ ? device_->path() + " is gone" : ""; }
  [[nodiscard]] Device<1>* gripper() noexcept override { return gripper_.get(); }

 private:
  void read() noexcept {
    unsigned flag = LIBEVDEV_READ_FLAG_NORMAL;
    for (int left = kMostEvents; left > 0; --left) {
      input_event event;
      const int status = libevdev_next_event(device_->get(), flag, &event);
      if (status == -EAGAIN && flag == LIBEVDEV_READ_FLAG_SYNC) {
        flag = LIBEVDEV_READ_FLAG_NORMAL;
      } else if (status == -EAGAIN || status == -EINTR) {
        return;
      } else if (status < 0) {
        lost_ = true;
        return;
      } else {
        // Events were dropped: libevdev reads the state anew.
        flag = status == LIBEVDEV_READ_STATUS_SYNC ? LIBEVDEV_READ_FLAG_SYNC : LIBEVDEV_READ_FLAG_NORMAL;
      }
    }
  }

  template <class Effect>
  void open_effect(std::unique_ptr<EffectThread<Effect>>& thread, double full_n) {
    full_n = arguments_.full_force_n.value_or(full_n);
    thread = std::make_unique<EffectThread<Effect>>(effects_, full_n);
    if (thread->works())
      most_n_ = full_n;
    else
      thread.reset();
  }

  Arguments arguments_;
  std::unique_ptr<EventDevice> device_;
  SmoothedTarget<N> motion_;
  EventEffects effects_;
  double most_n_ = 0.0;                                 ///< it displays; 0: no force
  std::unique_ptr<EffectThread<ForceFeedback>> force_;  ///< null: none
  std::unique_ptr<EffectThread<Rumble>> rumble_;        ///< null: none
  Force<N> told_;                                       ///< what the rumble stands for
  bool lost_ = false;
  std::unique_ptr<StickGripperDevice> gripper_;  ///< null: it has neither trigger nor two buttons
};

}  // namespace

void add_evdev(Registry& all) {
  all.devices.add<EvdevDevice>("evdev", "joystick or gamepad; ARGS is PATH[,NEWTONS], as /dev/input/event5,2");
}

}  // namespace twoport
