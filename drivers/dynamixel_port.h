#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "common/base/check.h"
#include "common/base/time.h"
#include "drivers/dynamixel_protocol.h"

namespace twoport::dynamixel {

/// A serial port with servos.
class Port {
 public:
  using Now = std::chrono::steady_clock;

  /// Throws ConfigError, which `words` begins.
  Port(const std::string& words, const std::string& path, int baud)
      : fd_{open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC)} {
    const auto refuse = [&](const std::string& why) {
      if (fd_ >= 0) close(fd_);
      throw ConfigError{words + ": " + why};
    };
    if (fd_ < 0)
      refuse(fmt::format("the port cannot be opened ({}){}", std::strerror(errno),
                         errno == EACCES ? "; your user needs the group dialout" : ""));
    termios t{};
    if (tcgetattr(fd_, &t) != 0) refuse("it is no serial port");
    cfmakeraw(&t);
    t.c_cflag |= CLOCAL | CREAD;
    if (cfsetspeed(&t, rate(baud)) != 0 || tcsetattr(fd_, TCSANOW, &t) != 0)
      refuse(fmt::format("the port does not take {} baud", baud));
    ioctl(fd_, TIOCEXCL);
    // An FTDI chip then passes on what has come after 1 ms instead of 16.
    serial_struct serial{};
    if (ioctl(fd_, TIOCGSERIAL, &serial) == 0) {
      serial.flags |= ASYNC_LOW_LATENCY;
      ioctl(fd_, TIOCSSERIAL, &serial);
    }
  }
  ~Port() {
    ioctl(fd_, TIOCNXCL);
    close(fd_);
  }
  Port(const Port&) = delete;

  /// B0 where this is none that servos know.
  static speed_t rate(int baud) noexcept {
    for (const auto& [number, name] : {std::pair{57600, B57600},
                                       {115200, B115200},
                                       {1000000, B1000000},
                                       {2000000, B2000000},
                                       {3000000, B3000000},
                                       {4000000, B4000000}})
      if (number == baud) return static_cast<speed_t>(name);
    return B0;
  }

  /// To servos that do not answer. One that is cut short by an adapter that is gone is none.
  void tell(const Message& m) noexcept {
    const Packet packet{m};
    static_cast<void>(::write(fd_, packet.bytes().data(), packet.bytes().size()) < 0);
  }
  /// What has come before is no answer.
  void ask(const Message& m) noexcept {
    while (hear()) {
    }
    reader_.clear();
    tell(m);
  }
  /// The next status that comes until then. An echo of what was told is none.
  std::optional<Message> answer(Now::time_point until) noexcept {
    for (bool late = false;;) {
      while (const auto m = reader_.next())
        if (m->instruction == Instruction::status && m->size > 0) return m;
      if (hear()) continue;
      if (late) return {};
      // After that it looks once more: this thread may have been kept from running.
      late = !comes(until - Now::now());
    }
  }

 private:
  bool hear() noexcept {
    std::array<std::uint8_t, 256> bytes;
    const ssize_t n = ::read(fd_, bytes.data(), bytes.size());
    if (n > 0) reader_.add({bytes.data(), static_cast<std::size_t>(n)});
    return n > 0;
  }
  [[nodiscard]] bool comes(Duration within) const noexcept {
    if (within <= within.zero()) return false;
    pollfd heard{fd_, POLLIN, 0};
    const timespec t{within.count() / 1'000'000'000, within.count() % 1'000'000'000};
    const bool any = ppoll(&heard, 1, &t, nullptr) > 0;
    // An adapter that is gone does not let wait.
    if (any && (heard.revents & POLLIN) == 0) std::this_thread::sleep_for(within);
    return any && (heard.revents & POLLIN) != 0;
  }

  int fd_;
  PacketReader reader_;
};

}  // namespace twoport::dynamixel
