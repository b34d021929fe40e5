#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace twoport::test {

using Datagram = std::vector<std::uint8_t>;

/// A UDP socket on 127.0.0.1.
class Socket {
 public:
  explicit Socket(std::uint16_t port = 0) {
    const sockaddr_in local = address(port);
    if (bind(fd_, reinterpret_cast<const sockaddr*>(&local), sizeof local) != 0) std::abort();
  }
  ~Socket() { close(fd_); }
  Socket(const Socket&) = delete;

  void send(const Datagram& bytes, std::uint16_t port) const {
    const sockaddr_in to = address(port);
    sendto(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  /// The next datagram that waits, and the port it is from.
  std::optional<std::pair<Datagram, std::uint16_t>> receive() const {
    Datagram bytes(2048);
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n =
        recvfrom(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size);
    if (n < 0) return std::nullopt;
    bytes.resize(static_cast<std::size_t>(n));
    return std::pair{bytes, ntohs(from.sin_port)};
  }
  [[nodiscard]] pollfd readable() const { return {fd_, POLLIN, 0}; }

 private:
  static sockaddr_in address(std::uint16_t port) {
    sockaddr_in a{};
    a.sin_family = AF_INET;
    a.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    a.sin_port = htons(port);
    return a;
  }
  int fd_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
};

/// Stands between master and slave, passes every datagram on and keeps a copy. What it sends besides comes, for each of
/// the two, from the address of the other.
class Relay {
 public:
  /// The master's --peer is `port`; the slave listens at `slave_port`. `also` runs in the relay's thread, about once a
  /// millisecond while both are known. A datagram of which `passes(to_slave)` is false is kept, but not passed on.
  Relay(std::uint16_t port, std::uint16_t slave_port, std::function<void(Relay&)> also = {},
        std::function<bool(bool)> passes = {})
      : towards_master_{port},
        slave_port_{slave_port},
        also_{std::move(also)},
        passes_{std::move(passes)},
        thread_{[this] { run(); }} {}
  ~Relay() { stop(); }
  Relay(const Relay&) = delete;

  void to_master(const Datagram& bytes) const { towards_master_.send(bytes, master_port); }
  void to_slave(const Datagram& bytes) const { towards_slave_.send(bytes, slave_port_); }

  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }

  /// Read them after stop(), or in `also`.
  std::vector<Datagram> from_master, from_slave;
  std::uint16_t master_port = 0;

 private:
  void run() {
    auto last = std::chrono::steady_clock::now();
    while (!stop_) {
      pollfd both[] = {towards_master_.readable(), towards_slave_.readable()};
      poll(both, 2, 1);
      while (const auto d = towards_master_.receive()) {
        master_port = d->second;
        from_master.push_back(d->first);
        if (!passes_ || passes_(true)) to_slave(d->first);
      }
      while (const auto d = towards_slave_.receive()) {
        from_slave.push_back(d->first);
        if (!passes_ || passes_(false)) to_master(d->first);
      }
      const auto now = std::chrono::steady_clock::now();
      if (!also_ || from_slave.empty() || now - last < std::chrono::milliseconds{1}) continue;
      last = now;
      also_(*this);
    }
  }

  Socket towards_master_, towards_slave_;
  std::uint16_t slave_port_;
  std::function<void(Relay&)> also_;
  std::function<bool(bool)> passes_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace twoport::test
