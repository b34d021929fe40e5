#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <thread>

#include "common/base/check.h"
#include "common/scene/scene.h"
#include "drivers/drivers.h"
#include "tests/support/folder.h"

namespace twoport::spacenav_test {
namespace {

constexpr double kPeriod = 1e-3;

/// Speaks the protocol of spacenavd: events of eight 32-bit numbers; `answers`: also the request for a version of it.
class Daemon {
 public:
  explicit Daemon(bool answers = true) {
    listener_ = socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = folder_ / "spnav.sock";
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    if (bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 || listen(listener_, 1) != 0)
      throw std::runtime_error{"no socket at " + path};
    setenv("SPNAV_SOCKET", path.c_str(), 1);
    thread_ = std::thread{[this, answers] {
      client_ = accept(listener_, nullptr, nullptr);
      std::int32_t request = 0;
      if (client_ >= 0 && answers && ::read(client_, &request, sizeof request) == sizeof request)
        static_cast<void>(!::write(client_, &request, sizeof request));
    }};
  }
  ~Daemon() {
    shutdown(listener_, SHUT_RDWR);
    if (thread_.joinable()) thread_.join();
    hang_up();
    close(listener_);
    unsetenv("SPNAV_SOCKET");
  }
  void send(const std::array<std::int32_t, 8>& event) {
    if (thread_.joinable()) thread_.join();
    ASSERT_EQ(::write(client_, event.data(), sizeof event), static_cast<ssize_t>(sizeof event));
  }
  void motion(int x, int y, int z, int rx, int ry, int rz) { send({0, x, y, z, rx, ry, rz, 8}); }
  void press(int button) { send({1, button, 0, 0, 0, 0, 0, 0}); }
  void let(int button) { send({2, button, 0, 0, 0, 0, 0, 0}); }
  void hang_up() {
    if (client_ >= 0) close(client_);
    client_ = -1;
  }

 private:
  test::Folder folder_;
  int listener_ = -1, client_ = -1;
  std::thread thread_;
};

const Scene kScene{};
bool is_built() {
  return all_drivers().devices.lines().find("spacenav\tnot in this build") == std::string::npos;
}
#define SKIP_WITHOUT_SPACENAV() \
  if (!is_built()) GTEST_SKIP() << "skipped: libspnav was missing when the programs were built"

template <int N>
struct Rig {
  explicit Rig(const std::string& choice = "spacenav")
      : device{all_drivers().devices.open<N>(choice, kScene, Seconds{kPeriod})} {}
  DeviceSample<N> ticks(int count) {
    DeviceSample<N> s;
    for (int i = 0; i < count; ++i)
      s = device->sense({Instant<MasterClock>{tick_time(++k, 1.0 / kPeriod)}, Seconds{kPeriod}});
    return s;
  }
  std::unique_ptr<Device<N>> device;
  long k = 0;
};

TEST(Spacenav, DeflectionIsAVelocityAndHasNoStep) {
  SKIP_WITHOUT_SPACENAV();
  Daemon daemon;
  Rig<6> rig;
  EXPECT_EQ(rig.device->info().max_force_n, 0.0);
  EXPECT_EQ(rig.ticks(10).v.squared_norm(), 0.0);
  daemon.motion(350, -175, 0, 0, 0, 700);
  const DeviceSample<6> first = rig.ticks(1);
  EXPECT_LT(std::abs(first.v[0]), 0.01);  // 10 Hz, 1 ms: below (w T)² = 0.4 % of 0.1 m/s, and a tenth of it by far
  EXPECT_GT(first.v[0], 0.0);
  const DeviceSample<6> s = rig.ticks(400);  // 25 time constants of the filter
  EXPECT_NEAR(s.v[0], 0.1, 1e-6);
  EXPECT_NEAR(s.v[1], -0.05, 1e-6);
  EXPECT_NEAR(s.v[5], 1.0, 1e-5);  // a deflection beyond the full one counts as full
  // The position is the sum of the velocities that were reported, to the last bits.
  const DeviceSample<6> next = rig.ticks(1);
  EXPECT_NEAR((next.x - s.x).vec()[0], kPeriod * next.v[0], 1e-15);
}

TEST(Spacenav, OfADaemonThatIsSilentCountsAsReleased) {
  SKIP_WITHOUT_SPACENAV();
  Daemon daemon{false};  // an old daemon, which does not answer the request either
  Rig<3> rig{"spacenav:0.2"};
  daemon.motion(350, 0, 0, 0, 0, 0);
  EXPECT_NEAR(rig.ticks(400).v[0], 0.2, 1e-6);
  EXPECT_LT(rig.ticks(600).v[0], 1e-6);
  daemon.motion(350, 0, 0, 0, 0, 0);
  rig.ticks(400);
  rig.device->release();
  EXPECT_LT(rig.ticks(400).v[0], 1e-6);
}

TEST(Spacenav, HasButtonsAndReportsAFaultWhenTheDaemonGoes) {
  SKIP_WITHOUT_SPACENAV();
  Daemon daemon;
  Rig<1> rig;
  daemon.press(0);
  daemon.press(5);
  EXPECT_EQ(rig.ticks(1).buttons, 0b100001u);
  daemon.let(0);
  EXPECT_EQ(rig.ticks(1).buttons, 0b100000u);
  EXPECT_EQ(rig.ticks(1).status, HardwareStatus::ok);
  daemon.hang_up();
  EXPECT_EQ(rig.ticks(1).status, HardwareStatus::fault);
  EXPECT_EQ(rig.device->trouble(), "spacenavd has closed the connection");
}

TEST(Spacenav, IsRefusedInWords) {
  SKIP_WITHOUT_SPACENAV();
  setenv("SPNAV_SOCKET", "/nowhere/spnav.sock", 1);
  EXPECT_THROW(Rig<3>{}, ConfigError);
  EXPECT_THROW(Rig<3>{"spacenav:fast"}, ConfigError);
  unsetenv("SPNAV_SOCKET");
  Daemon daemon;
  Rig<3> rig;
  EXPECT_THROW(Rig<3>{}, ConfigError) << "there is one connection";
}

}  // namespace
}  // namespace twoport::spacenav_test
