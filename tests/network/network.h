#pragma once

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/live.h"

namespace twoport::test {

inline std::string reason() {
  return std::strerror(errno);
}

/// Root of a user namespace and of a network to come home to, where the user is not root already. Empty, or why not.
inline std::string become_root() {
  if (geteuid() == 0) return {};
  const uid_t user = geteuid();
  const gid_t group = getegid();
  if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
    return "neither root nor permitted a user namespace (" + reason() + ")";
  std::ofstream{"/proc/self/setgroups"} << "deny";
  std::ofstream{"/proc/self/uid_map"} << "0 " << user << " 1";
  std::ofstream{"/proc/self/gid_map"} << "0 " << group << " 1";
  return geteuid() == 0 ? "" : "the user namespace did not take its map";
}

/// A network namespace that has no name: it is there as long as somebody is in it or holds its descriptor, and is
/// gone when this test is, however it ends.
class Network {
 public:
  Network() {
    const int home = open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
    if (unshare(CLONE_NEWNET) == 0) {
      fd_ = open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
      if (setns(home, CLONE_NEWNET) != 0) std::abort();
    } else {
      problem_ = "no network namespace is permitted (" + reason() + ")";
    }
    close(home);
  }
  ~Network() {
    if (fd_ >= 0) close(fd_);
  }
  Network(const Network&) = delete;

  [[nodiscard]] const std::string& problem() const { return problem_; }
  [[nodiscard]] int fd() const { return fd_; }
  /// As another program finds it.
  [[nodiscard]] std::string path() const { return "/proc/" + std::to_string(getpid()) + "/fd/" + std::to_string(fd_); }
  /// Runs a program in it. Empty, or what went wrong.
  [[nodiscard]] std::string run(const Words& words) const {
    Process process{words, {.network = fd_}};
    const Exit end = process.wait(20s);
    if (end == exited(0)) return {};
    std::string all;
    for (const std::string& word : words) all += (all.empty() ? "" : " ") + word;
    return end == exited(127) ? "`" + words[0] + "` is not installed" : "`" + all + "`: " + process.err();
  }
  /// `ip` of iproute2 in it, the words of the command apart by blanks.
  [[nodiscard]] std::string ip(const std::string& command) const {
    Words words{"ip"};
    std::istringstream in{command};
    for (std::string word; in >> word;) words.push_back(word);
    return run(words);
  }
  /// A counter of /proc/net/snmp.
  [[nodiscard]] long counter(const std::string& protocol, const std::string& name) const {
    Process process = finished({"cat", "/proc/net/snmp"}, {.network = fd_});
    std::istringstream in{process.out()};
    std::string names, values, cell;
    while (std::getline(in, names) && std::getline(in, values)) {
      if (names.rfind(protocol + ":", 0) != 0) continue;
      std::istringstream name_in{names}, value_in{values};
      for (std::string value; name_in >> cell && value_in >> value;)
        if (cell == name) return std::stol(value);
    }
    return -1;
  }

 private:
  int fd_ = -1;
  std::string problem_;
};

}  // namespace twoport::test
