#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/folder.h"

namespace twoport::test {

using namespace std::chrono_literals;

/// How a program ended: with a status, or by a signal.
struct Exit {
  int status = -1, signal = 0;
  friend bool operator==(const Exit&, const Exit&) = default;
  friend std::ostream& operator<<(std::ostream& out, const Exit& e) {
    if (e.signal != 0) return out << "killed by signal " << e.signal;
    return e.status < 0 ? out << "still running" : out << "exit status " << e.status;
  }
};
constexpr Exit exited(int status) {
  return {status, 0};
}
constexpr Exit killed_by(int signal) {
  return {-1, signal};
}

struct Surroundings {
  bool terminal = false;      ///< stdin and stderr are a terminal
  bool unprivileged = false;  ///< no right to real time, whoever runs the test
  int network = -1;           ///< descriptor of the network namespace to run in; -1: this one
};

/// A running program, what it writes captured. It does not outlive this object, nor the test.
class Process {
 public:
  explicit Process(std::vector<std::string> command, const Surroundings& surroundings = {});
  ~Process();
  Process(Process&&) noexcept;
  Process& operator=(Process&&) noexcept;

  [[nodiscard]] pid_t pid() const;
  void send(int signal);
  /// At its terminal.
  void type(std::string_view text);
  /// Waits for the end. Neither status nor signal when it has not come by then.
  Exit wait(std::chrono::milliseconds timeout = 60s);
  [[nodiscard]] bool running() { return wait(0ms) == Exit{}; }
  /// Waits until it has written `text` to stderr.
  bool says(std::string_view text, std::chrono::milliseconds timeout = 30s);
  [[nodiscard]] std::string out() const;
  [[nodiscard]] std::string err() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Runs a program to its end.
Process finished(std::vector<std::string> command, const Surroundings& surroundings = {});

/// A port of 127.0.0.1 that nobody has, and that the system gives nobody who asks for any.
std::uint16_t free_udp_port();

std::string read_text(const std::string& path);
int count(std::string_view text, std::string_view part);

}  // namespace twoport::test
