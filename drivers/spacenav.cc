#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <string>

#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "drivers/smoothed_target.h"

// Without its part for X11, whose headers libspnav-dev does not bring.
#define SPNAV_CONFIG_H_  // NOLINT
#include <spnav.h>       // NOLINT

namespace twoport {
namespace {

constexpr double kFullDeflection = 350.0;  // counts, as spacenavd reports them at sensitivity 1
constexpr double kSpeed = 0.1;             // at full deflection [m/s], unless ARGS say otherwise
constexpr double kTurnPerMetre = 10.0;     // angular speed over speed at full deflection [rad/m]
constexpr double kCutoffHz = 10.0;         // of the velocity: events come at 60 to 125 Hz
constexpr double kSilence = 0.5;           // without an event a deflected puck counts as released [s]
constexpr int kMostEvents = 64;            // read in one tick

double speed_from(const std::string& arguments) {
  if (arguments.empty()) return kSpeed;
  char* end = nullptr;
  const double speed = std::strtod(arguments.c_str(), &end);
  if (*end != '\0' || !(speed > 0.0 && speed <= 2.0))
    throw ConfigError{"--device spacenav:" + arguments +
                      ": ARGS is the speed at full deflection, above 0 and at most 2 m/s"};
  return speed;
}

/// libspnav has one connection for the whole program.
class Connection {
 public:
  Connection() {
    if (open_.exchange(true)) throw ConfigError{"--device spacenav: it is open already"};
    if (spnav_open() != 0) {
      open_ = false;
      throw ConfigError{
          "--device spacenav: spacenavd does not answer; install and start it (Debian package spacenavd), or set "
          "SPNAV_SOCKET to its socket"};
    }
  }
  ~Connection() {
    spnav_close();
    open_ = false;
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// The daemon has closed the connection.
  [[nodiscard]] static bool lost() noexcept {
    char byte;
    const ssize_t n = recv(spnav_fd(), &byte, 1, MSG_PEEK | MSG_DONTWAIT);
    return n == 0 || (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
  }

 private:
  static inline std::atomic<bool> open_{false};
};

/// A six-axis puck behind spacenavd, which displays no force. Its deflection is a velocity: x' = v, with v the deflection through
/// a critically damped filter of 10 Hz.
template <int N>
class SpacenavDevice final : public Device<N> {
 public:
  explicit SpacenavDevice(const DriverOptions& o) : speed_{speed_from(o.arguments)}, v_{kCutoffHz} {}

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = "six-axis puck of spacenavd",
            .max_force_n = 0.0,
            .watchdog = Seconds{kSilence},
            .dof = 6,
            .buttons = 32};
  }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    if (!lost_) read();
    silence_ += tick.ended.si();
    if (silence_ > kSilence) target_.setZero();
    const double dt = std::min(tick.ended.si(), 0.1);
    v_.advance(target_, dt);
    x_ = x_ + Displacement<N>{Vector{dt * v_.x()}};
    return {.x = x_,
            .v = Velocity<N>{v_.x()},
            .applied = {},
            .status = lost_ ? HardwareStatus::fault : HardwareStatus::ok,
            .buttons = buttons_};
  }
  void actuate(const Force<N>&) noexcept override {}
  void release() noexcept override { target_.setZero(); }
  [[nodiscard]] std::string trouble() const override { return lost_ ? "spacenavd has closed the connection" : ""; }

 private:
  using Vector = typename Velocity<N>::Vector;

  void read() noexcept {
    spnav_event event;
    for (int left = kMostEvents; left > 0; --left) {
      const int kind = spnav_poll_event(&event);
      if (kind == SPNAV_EVENT_MOTION) {
        const std::array<int, 6> counts{event.motion.x,  event.motion.y,  event.motion.z,
                                        event.motion.rx, event.motion.ry, event.motion.rz};
        for (int i = 0; i < N; ++i) {
          const double share = std::clamp(counts[static_cast<std::size_t>(i)] / kFullDeflection, -1.0, 1.0);
          target_[i] = share * speed_ * (i < 3 ? 1.0 : kTurnPerMetre);
        }
        silence_ = 0.0;
      } else if (kind == SPNAV_EVENT_BUTTON) {
        const std::uint32_t bit = event.button.bnum >= 0 && event.button.bnum < 32 ? 1u << event.button.bnum : 0u;
        buttons_ = event.button.press != 0 ? buttons_ | bit : buttons_ & ~bit;
      } else if (kind == 0) {
        lost_ = Connection::lost();
        return;
      }
    }
  }

  Connection connection_;
  double speed_;
  SmoothedTarget<N> v_;
  Vector target_ = Vector::Zero();
  Position<N> x_;
  double silence_ = 0.0;
  std::uint32_t buttons_ = 0;
  bool lost_ = false;
};

}  // namespace

void add_spacenav(Registry& all) {
  all.devices.add<SpacenavDevice>("spacenav",
                                  "six-axis puck by spacenavd; ARGS is the speed at full deflection in m/s");
}

}  // namespace twoport
