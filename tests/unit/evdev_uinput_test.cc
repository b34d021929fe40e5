#include <fcntl.h>
#include <gtest/gtest.h>
#include <libevdev/libevdev-uinput.h>
#include <libevdev/libevdev.h>
#include <linux/uinput.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "common/scene/scene.h"
#include "drivers/drivers.h"

// The driver against a joystick that the kernel believes in. Skipped, in words, where /dev/uinput may not be used.
namespace twoport::evdev_uinput_test {
namespace {

constexpr double kPeriod = 1e-3;

class VirtualStick {
 public:
  VirtualStick() {
    libevdev* d = libevdev_new();
    libevdev_set_name(d, "twoport test stick");
    for (const auto code : {unsigned{ABS_X}, unsigned{ABS_Y}}) {
      input_absinfo a{};
      a.minimum = -1000;
      a.maximum = 1000;
      libevdev_enable_event_code(d, EV_ABS, code, &a);
    }
    libevdev_enable_event_code(d, EV_KEY, BTN_TRIGGER, nullptr);
    libevdev_enable_event_code(d, EV_FF, FF_CONSTANT, nullptr);
    fd_ = open("/dev/uinput", O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (fd_ >= 0 && libevdev_uinput_create_from_device(d, fd_, &device_) != 0) device_ = nullptr;
    libevdev_free(d);
    if (device_ != nullptr) thread_ = std::thread{[this] { serve(); }};
  }
  ~VirtualStick() {
    going_ = false;
    if (thread_.joinable()) thread_.join();
    if (device_ != nullptr) libevdev_uinput_destroy(device_);
    if (fd_ >= 0) close(fd_);
  }
  VirtualStick(const VirtualStick&) = delete;
  VirtualStick& operator=(const VirtualStick&) = delete;

  [[nodiscard]] bool works() const { return device_ != nullptr; }
  [[nodiscard]] std::string path() const { return libevdev_uinput_get_devnode(device_); }
  void move(int x, int y, int trigger) {
    libevdev_uinput_write_event(device_, EV_ABS, ABS_X, x);
    libevdev_uinput_write_event(device_, EV_ABS, ABS_Y, y);
    libevdev_uinput_write_event(device_, EV_KEY, BTN_TRIGGER, trigger);
    libevdev_uinput_write_event(device_, EV_SYN, SYN_REPORT, 0);
  }
  std::atomic<int> level{0}, direction{-1}, plays{0};

 private:
  /// Accepts effects and counts plays, as a driver in the kernel does.
  void serve() {
    while (going_) {
      pollfd waits{fd_, POLLIN, 0};
      if (poll(&waits, 1, 20) <= 0) continue;
      input_event event;
      while (::read(fd_, &event, sizeof event) == static_cast<ssize_t>(sizeof event)) {
        if (event.type == EV_UINPUT && event.code == UI_FF_UPLOAD) {
          uinput_ff_upload upload{};
          upload.request_id = static_cast<std::uint32_t>(event.value);
          ioctl(fd_, UI_BEGIN_FF_UPLOAD, &upload);
          level = upload.effect.u.constant.level;
          direction = upload.effect.direction;
          upload.retval = 0;
          ioctl(fd_, UI_END_FF_UPLOAD, &upload);
        } else if (event.type == EV_UINPUT && event.code == UI_FF_ERASE) {
          uinput_ff_erase erase{};
          erase.request_id = static_cast<std::uint32_t>(event.value);
          ioctl(fd_, UI_BEGIN_FF_ERASE, &erase);
          erase.retval = 0;
          ioctl(fd_, UI_END_FF_ERASE, &erase);
        } else if (event.type == EV_FF) {
          plays = event.value > 0 ? plays + 1 : 0;
        }
      }
    }
  }

  int fd_ = -1;
  libevdev_uinput* device_ = nullptr;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

TEST(EvdevDevice, ReadsAStickOfTheKernelAndPlaysItsForce) {
  VirtualStick stick;
  if (!stick.works()) GTEST_SKIP() << "skipped: /dev/uinput is not there, or may not be opened";
  std::this_thread::sleep_for(std::chrono::milliseconds{300});  // until the file of the device is there
  const Scene scene{};
  const auto device = all_drivers().devices.open<3>("evdev:" + stick.path() + ",2", scene, Seconds{kPeriod});
  EXPECT_NE(device->info().name.find("twoport test stick"), std::string::npos);
  EXPECT_EQ(device->info().max_force_n, 2.0);
  EXPECT_EQ(device->info().buttons, 1);
  stick.move(1000, -500, 1);
  DeviceSample<3> s;
  for (int k = 0; k < 400; ++k) {
    s = device->sense({Instant<MasterClock>{tick_time(k, 1.0 / kPeriod)}, Seconds{kPeriod}});
    device->actuate(Force<3>{Eigen::Vector3d{-1.0, 0.0, 0.0}});  // the hand is pushed to the right
    std::this_thread::sleep_for(std::chrono::milliseconds{1});
  }
  EXPECT_NEAR(s.x.translation()[0], 0.05, 1e-6);
  EXPECT_NEAR(s.x.translation()[1], 0.025, 1e-6);
  EXPECT_EQ(s.buttons, 1u);
  EXPECT_EQ(s.applied[0], -1.0);
  EXPECT_EQ(stick.direction, 0xC000);
  EXPECT_EQ(stick.level, 0x4000);
  EXPECT_GT(stick.plays, 5);
  device->release();
  std::this_thread::sleep_for(std::chrono::milliseconds{200});  // a ramp of 50 ms, on a busy machine
  EXPECT_EQ(stick.level, 0);
}

}  // namespace
}  // namespace twoport::evdev_uinput_test
