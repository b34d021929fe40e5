#pragma once

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/vector.h"
#include "common/scene/servos.h"
#include "drivers/dynamixel_protocol.h"
#include "sim/sim_joints.h"

namespace twoport::test {

/// What servos move.
class ServoLoad {
 public:
  using Axes = Force<kJointPort>::Vector;
  static constexpr double kStep = 5e-4;  // [s]
  virtual ~ServoLoad() = default;
  /// One step under the torques of the motors.
  virtual void advance(const Axes& torque) = 0;
  [[nodiscard]] virtual Axes q() const = 0;
};
/// Positions that one thread writes and another one reads.
struct SharedAxes {
  std::array<std::atomic<double>, kJointPort> at{};
  void store(const ServoLoad::Axes& q) {
    for (std::size_t i = 0; i < at.size(); ++i) at[i] = q[static_cast<Eigen::Index>(i)];
  }
  [[nodiscard]] ServoLoad::Axes load() const {
    ServoLoad::Axes all;
    for (std::size_t i = 0; i < at.size(); ++i) all[static_cast<Eigen::Index>(i)] = at[i];
    return all;
  }
};
/// It stands where a test puts it.
class PlacedLoad final : public ServoLoad, public SharedAxes {
 public:
  void advance(const Axes&) override {}
  [[nodiscard]] Axes q() const override { return load(); }
};
/// The arm of a scene: a leader in the operator's hand (SimDevice), or a follower at the environment (SimRobot).
template <class Simulated>
class ArmLoad final : public ServoLoad {
 public:
  explicit ArmLoad(const Scene& scene) : arm_{scene, Seconds{kStep}} { q_.store(position()); }
  void advance(const Axes& torque) override {
    const ArmModel& model = arm_.arm()->model();
    Axes beside = torque;
    // The simulated arm carries its weight itself.
    beside.head(model.size()) -= model.gravity_torque(model.pose(arm_.arm()->state().q), sim::ArmPlant::kGravity);
    if constexpr (std::is_same_v<Simulated, sim::SimDevice<kJointPort>>)
      arm_.actuate(Force<kJointPort>{Axes{-beside}});
    else
      arm_.actuate({Force<kJointPort>{beside}, {}, {}});
    arm_.advance();
    q_.store(position());
    outside_j = arm_.arm()->outside_energy().si();
    // An arm whose motors are off falls into the hand.
    if (!torque.isZero() && outside_j < least_outside_j) least_outside_j = outside_j.load();
  }
  [[nodiscard]] Axes q() const override { return q_.load(); }
  std::atomic<double> outside_j{0.0}, least_outside_j{0.0};  ///< work of hand or environment on the arm

 private:
  [[nodiscard]] Axes position() const { return arm_.arm()->joints().x.translation(); }

  Simulated arm_;
  SharedAxes q_;
};
using HeldArm = ArmLoad<sim::SimDevice<kJointPort>>;
using TouchingArm = ArmLoad<sim::SimRobot<kJointPort>>;

/// Dynamixel servos on a pseudo-terminal, as emanual.robotis.com/docs/en/dxl/protocol2 and the control table of XL330-M288 say. Their load
/// is held for kHeld after the motors are on.
class DynamixelServos {
 public:
  using Now = std::chrono::steady_clock;
  using Axes = ServoLoad::Axes;
  static constexpr double kTorquePerCount = 0.354e-3;
  static constexpr double kHeld = 2.0;  // [s]

  DynamixelServos(std::vector<ServoMount> mounts, ServoLoad& load) : mounts_{std::move(mounts)}, load_{load} {
    fd_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd_ < 0 || grantpt(fd_) != 0 || unlockpt(fd_) != 0) throw std::runtime_error{"no pseudo-terminal"};
    port_ = ptsname(fd_);
    termios t{};
    const int other = open(port_.c_str(), O_RDWR | O_NOCTTY);
    tcgetattr(other, &t);
    cfmakeraw(&t);
    tcsetattr(other, TCSANOW, &t);
    close(other);
    tables_.resize(mounts_.size());
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      put(i, {0, 2}, 1200);
      put(i, dynamixel::kReturnDelay, 250);
      put(i, dynamixel::kOperatingMode, 3);
      put(i, dynamixel::kTemperatureLimit, 70);
      put(i, dynamixel::kCurrentLimit, 1750);
      put(i, dynamixel::kStatusReturn, 1);
      put(i, {146, 1}, 31);
    }
    move(0.0);
  }
  ~DynamixelServos() {
    going_ = false;
    if (thread_.joinable()) thread_.join();
    close(fd_);
  }
  DynamixelServos(const DynamixelServos&) = delete;

  void start() {
    thread_ = std::thread{[this] { run(); }};
  }
  /// Before start().
  void put(std::size_t i, dynamixel::Item item, std::uint32_t value) {
    for (std::size_t b = 0; b < item.bytes; ++b)
      tables_[i][item.address + b] = static_cast<std::uint8_t>(value >> 8 * b);
  }
  [[nodiscard]] const std::string& port() const { return port_; }

  // What a test does to them. Numbers of servos from 1; 0: none.
  std::atomic<int> unplugged{0};  ///< it and those behind it
  std::atomic<int> hot{0}, broken{0}, damages_every{0};
  std::atomic<int> restarted{0};  ///< once, without being silent
  std::atomic<int> lost{0};       ///< address of which the next write is lost, of one servo or of all, unless of 0
  std::atomic<int> refused{0};    ///< address that servo 3 does not take
  std::atomic<bool> halves{false}, echoes{false}, noisy{false}, counts_turns{true};

  // What they were told.
  std::array<std::atomic<int>, kJointPort> current{};  ///< [counts]
  std::atomic<bool> on{false}, watched{false};         ///< all motors; by their watchdogs
  std::atomic<long> reads{0};
  /// From the last answer of a servo that is unplugged to the release of all; below 0: not yet.
  std::atomic<double> released_s{-1.0};

 private:
  using Message = dynamixel::Message;
  using Instruction = dynamixel::Instruction;

  [[nodiscard]] std::uint32_t get(std::size_t i, dynamixel::Item item) const {
    std::uint32_t value = 0;
    for (std::size_t b = 0; b < item.bytes; ++b)
      value |= static_cast<std::uint32_t>(tables_[i][item.address + b]) << 8 * b;
    return value;
  }
  [[nodiscard]] int goal(std::size_t i) const { return static_cast<std::int16_t>(get(i, dynamixel::kGoalCurrent)); }
  [[nodiscard]] bool is_on(std::size_t i) const { return get(i, dynamixel::kTorqueEnable) != 0; }

  /// Goes on to now, and shows the present values.
  void move(double span_s) {
    bool all = true;
    if (const int i = restarted.exchange(0); i > 0)
      for (const dynamixel::Item item : {dynamixel::kTorqueEnable, dynamixel::kBusWatchdog, dynamixel::kGoalCurrent})
        put(static_cast<std::size_t>(i - 1), item, 0);
    bool watch = true;
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      all = all && is_on(i);
      watch = watch && get(i, dynamixel::kBusWatchdog) == 5;
    }
    watched = watch;
    on_s_ = all ? on_s_ + span_s : 0.0;
    begun_ = begun_ || on_s_ > kHeld;
    on = all;
    Axes torque = Axes::Zero();
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      current[i] = is_on(i) ? goal(i) : 0;
      torque[static_cast<Eigen::Index>(i)] = (mounts_[i].reversed ? -1.0 : 1.0) * kTorquePerCount * current[i];
    }
    // The world of a thread that was late stands still meanwhile: to make up for it would be late again.
    ahead_s_ = std::min(ahead_s_ + span_s, 2e-3);
    const Axes before = load_.q();
    int steps = 0;
    for (; begun_ && ahead_s_ >= ServoLoad::kStep; ahead_s_ -= ServoLoad::kStep, ++steps) load_.advance(torque);
    if (!begun_) ahead_s_ = 0.0;
    const Axes q = load_.q();
    for (std::size_t i = 0; i < tables_.size(); ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      const double sign = mounts_[i].reversed ? -1.0 : 1.0, angle = sign * q[axis] + mounts_[i].zero_rad;
      auto counts = static_cast<int>(std::lround(angle / (2.0 * std::numbers::pi) * dynamixel::kCountsPerTurn));
      if (!counts_turns) counts &= dynamixel::kCountsPerTurn - 1;
      put(i, dynamixel::kPosition, static_cast<std::uint32_t>(counts));
      const double v = steps > 0 ? sign * (q[axis] - before[axis]) / (steps * ServoLoad::kStep) : 0.0;
      put(i, {128, 4}, static_cast<std::uint32_t>(static_cast<int>(std::lround(v / 0.02398))));
      put(i, {126, 2}, static_cast<std::uint32_t>(current[i].load()));
      const int number = static_cast<int>(i) + 1;
      if (hot == number) put(i, {146, 1}, 66);
      if (broken == number) {
        put(i, dynamixel::kHardwareError, 0x20);
        put(i, dynamixel::kTorqueEnable, 0);
      }
      const std::uint32_t watchdog = get(i, dynamixel::kBusWatchdog);
      if (watchdog > 0 && watchdog < 128 &&
          Now::now() - told_ > watchdog * std::chrono::milliseconds{dynamixel::kWatchdogStepMs}) {
        put(i, dynamixel::kBusWatchdog, 255);
        put(i, dynamixel::kGoalCurrent, 0);
      }
    }
    if (unplugged > 0 && released_s < 0.0) {
      bool zero = true;
      for (std::size_t i = 0; i < tables_.size(); ++i)
        zero = zero && (current[i] == 0 || static_cast<int>(i) + 1 >= unplugged);
      if (zero) released_s = std::chrono::duration<double>{Now::now() - answered_}.count();
    }
  }
  /// An error of a status.
  std::uint8_t write(std::size_t i, dynamixel::Item item, std::uint32_t value) {
    if ((item.address < 64 && is_on(i)) || (item.address == refused && mounts_[i].id == 3 && value != 0)) return 7;
    const bool goal_stands = get(i, dynamixel::kBusWatchdog) == 255 && item.address == dynamixel::kGoalCurrent.address;
    const bool beyond = item.address == dynamixel::kGoalCurrent.address &&
                        std::abs(static_cast<std::int16_t>(value)) > static_cast<int>(get(i, dynamixel::kCurrentLimit));
    if (goal_stands || beyond) return 4;
    put(i, item, value);
    return 0;
  }
  void obey(const Message& m) {
    const auto item = [&] {
      return dynamixel::Item{static_cast<std::uint16_t>(m.at(0, 2)), static_cast<std::uint8_t>(m.at(2, 2))};
    };
    told_ = Now::now();
    const bool sync = m.instruction == Instruction::sync_write;
    if ((sync || m.instruction == Instruction::write) && lost > 0 && static_cast<int>(m.at(0, 2)) == lost &&
        m.at(sync ? 5 : 2, 1) != 0) {
      lost = 0;
      return;
    }
    for (std::size_t i = 0; i < tables_.size(); ++i)
      if (mounts_[i].id == m.id) {
        if (m.instruction == Instruction::ping) answer(i, {0, 3}, 0);
        if (m.instruction == Instruction::read) answer(i, item(), 0);
        if (m.instruction == Instruction::write) {
          const dynamixel::Item to{static_cast<std::uint16_t>(m.at(0, 2)), static_cast<std::uint8_t>(m.size - 2)};
          const std::uint8_t error = write(i, to, m.at(2, to.bytes));
          if (get(i, dynamixel::kStatusReturn) == 2) answer(i, {0, 0}, error);
        }
      }
    if (m.instruction == Instruction::sync_read) ++reads;
    for (std::size_t at = 4; at < m.size;) {
      const auto of =
          std::find_if(mounts_.begin(), mounts_.end(), [&](const ServoMount& s) { return s.id == m.parameters[at]; });
      if (of == mounts_.end()) break;
      const auto i = static_cast<std::size_t>(of - mounts_.begin());
      if (m.instruction == Instruction::sync_read) {
        // Each waits for the one before.
        if (!answer(i, item(), 0)) break;
        at += 1;
      } else if (m.instruction == Instruction::sync_write) {
        if (!gone(i)) write(i, item(), m.at(at + 1, item().bytes));
        at += 1u + item().bytes;
      } else {
        break;
      }
    }
  }
  [[nodiscard]] bool gone(std::size_t i) const { return unplugged > 0 && static_cast<int>(i) + 1 >= unplugged; }
  bool answer(std::size_t i, dynamixel::Item item, std::uint8_t error) {
    if (gone(i)) return false;
    if (unplugged == 0) answered_ = Now::now();
    const bool alert = get(i, dynamixel::kHardwareError) != 0;
    Message status{.id = static_cast<std::uint8_t>(mounts_[i].id)};
    status.add(error | (alert ? dynamixel::kAlert : 0u), 1);
    for (std::size_t b = 0; b < item.bytes; ++b) status.add(tables_[i][item.address + b], 1);
    const dynamixel::Packet packet{status};
    std::vector<std::uint8_t> bytes{packet.bytes().begin(), packet.bytes().end()};
    if (damages_every > 0 && ++answers_ % damages_every == 0) bytes[bytes.size() / 2] ^= 0x10;
    if (noisy) bytes.insert(bytes.begin(), {0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x90, 0x00});
    const std::size_t half = halves ? bytes.size() / 2 : bytes.size();
    send({bytes.data(), half});
    if (half < bytes.size()) {
      std::this_thread::sleep_for(std::chrono::microseconds{100});
      send({bytes.data() + half, bytes.size() - half});
    }
    return true;
  }
  void send(dynamixel::Bytes bytes) const { static_cast<void>(::write(fd_, bytes.data(), bytes.size()) < 0); }

  void run() {
    const sched_param priority{75};
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
    dynamixel::PacketReader reader;
    for (auto last = told_ = Now::now(); going_;) {
      pollfd heard{fd_, POLLIN, 0};
      poll(&heard, 1, 1);
      const auto now = Now::now();
      const double span = std::chrono::duration<double>{now - last}.count();
      last = now;
      move(span);
      std::array<std::uint8_t, 512> bytes;
      const ssize_t n = read(fd_, bytes.data(), bytes.size());
      // Nobody has opened the port.
      if (n < 0 && errno == EIO) std::this_thread::sleep_for(std::chrono::milliseconds{1});
      if (n <= 0) continue;
      if (echoes) send({bytes.data(), static_cast<std::size_t>(n)});
      reader.add({bytes.data(), static_cast<std::size_t>(n)});
      while (const auto m = reader.next()) obey(*m);
      move(0.0);
    }
  }

  std::vector<ServoMount> mounts_;
  ServoLoad& load_;
  int fd_ = -1;
  std::string port_;
  std::vector<std::array<std::uint8_t, 256>> tables_;
  bool begun_ = false;
  double ahead_s_ = 0.0, on_s_ = 0.0;
  long answers_ = 0;
  Now::time_point told_, answered_;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

}  // namespace twoport::test
