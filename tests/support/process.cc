#include "tests/support/process.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <system_error>
#include <thread>
#include <utility>

namespace twoport::test {
namespace {

constexpr int kCouldNotStart = 127;

[[noreturn]] void fail(const std::string& what) {
  throw std::system_error{errno, std::generic_category(), what};
}

/// Between fork and exec. What only root may do is tried and does no harm where it fails.
void take_rights_away() {
  for (const int right : {CAP_SYS_NICE, CAP_IPC_LOCK, CAP_SYS_RESOURCE}) prctl(PR_CAPBSET_DROP, right, 0, 0, 0);
  const rlimit little{64 * 1024, 64 * 1024}, none{0, 0};
  setrlimit(RLIMIT_MEMLOCK, &little);
  setrlimit(RLIMIT_RTPRIO, &none);
}

int new_terminal() {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (terminal < 0 || grantpt(terminal) != 0 || unlockpt(terminal) != 0) fail("pseudo terminal");
  fcntl(terminal, F_SETFL, O_NONBLOCK);
  return terminal;
}

}  // namespace

struct Process::Impl {
  Folder folder;
  pid_t pid = -1;
  Exit end;
  bool ended = false;
  int terminal = -1;
  std::string shown;  ///< on the terminal so far

  ~Impl() {
    if (pid > 0 && !ended) {
      kill(pid, SIGKILL);
      waitpid(pid, nullptr, 0);
    }
    if (terminal >= 0) close(terminal);
  }
  /// A terminal that nobody reads fills up, and its writer waits.
  void read_terminal() {
    char chunk[4096];
    for (ssize_t n; terminal >= 0 && (n = ::read(terminal, chunk, sizeof chunk)) > 0;)
      shown.append(chunk, static_cast<std::size_t>(n));
  }
  bool has_ended() {
    read_terminal();
    int status = 0;
    if (ended || waitpid(pid, &status, WNOHANG) != pid) return ended;
    read_terminal();
    end = WIFSIGNALED(status) ? killed_by(WTERMSIG(status)) : exited(WEXITSTATUS(status));
    return ended = true;
  }
};

Process::Process(std::vector<std::string> command, const Surroundings& s) : impl_{std::make_unique<Impl>()} {
  const auto open_or_fail = [](const std::string& path, int flags) {
    const int fd = open(path.c_str(), flags | O_CLOEXEC, 0600);
    if (fd < 0) fail(path);
    return fd;
  };
  if (s.terminal) impl_->terminal = new_terminal();
  const int in = open_or_fail("/dev/null", O_RDONLY);
  const int out = open_or_fail(impl_->folder / "out", O_WRONLY | O_CREAT | O_APPEND);
  const int err = s.terminal ? open_or_fail(ptsname(impl_->terminal), O_RDWR | O_NOCTTY)
                             : open_or_fail(impl_->folder / "err", O_WRONLY | O_CREAT | O_APPEND);
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);

  const pid_t parent = getpid();
  impl_->pid = fork();
  if (impl_->pid == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
    if (getppid() != parent) _exit(kCouldNotStart);
    dup2(s.terminal ? err : in, STDIN_FILENO), dup2(out, STDOUT_FILENO), dup2(err, STDERR_FILENO);
    if (s.network >= 0 && setns(s.network, CLONE_NEWNET) != 0) _exit(kCouldNotStart);
    if (s.unprivileged) take_rights_away();
    execvp(arguments[0], arguments.data());
    _exit(kCouldNotStart);
  }
  close(in), close(out), close(err);
  if (impl_->pid < 0) fail("fork");
}
Process::~Process() = default;
Process::Process(Process&&) noexcept = default;
Process& Process::operator=(Process&&) noexcept = default;

pid_t Process::pid() const {
  return impl_->pid;
}
void Process::send(int signal) {
  if (!impl_->has_ended()) kill(impl_->pid, signal);
}

void Process::type(std::string_view text) {
  if (impl_->terminal < 0 || ::write(impl_->terminal, text.data(), text.size()) != static_cast<ssize_t>(text.size()))
    fail("terminal");
}

Exit Process::wait(std::chrono::milliseconds timeout) {
  const auto until = std::chrono::steady_clock::now() + timeout;
  while (!impl_->has_ended() && std::chrono::steady_clock::now() < until) std::this_thread::sleep_for(5ms);
  return impl_->end;
}

bool Process::says(std::string_view text, std::chrono::milliseconds timeout) {
  const auto until = std::chrono::steady_clock::now() + timeout;
  for (;;) {
    const bool last = impl_->has_ended() || std::chrono::steady_clock::now() >= until;
    if (err().find(text) != std::string::npos) return true;
    if (last) return false;
    std::this_thread::sleep_for(5ms);
  }
}

std::string Process::out() const {
  return read_text(impl_->folder / "out");
}
std::string Process::err() const {
  impl_->read_terminal();
  return impl_->terminal >= 0 ? impl_->shown : read_text(impl_->folder / "err");
}

Process finished(std::vector<std::string> command, const Surroundings& surroundings) {
  Process process{std::move(command), surroundings};
  process.wait();
  return process;
}

std::uint16_t free_udp_port() {
  // Below the ports that the system gives away, so that no master gets it; each test program looks elsewhere.
  constexpr int kFirst = 20000, kPorts = 12000;
  static int next = getpid() * 37;
  for (int tried = 0; tried < kPorts; ++tried) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const auto port = static_cast<std::uint16_t>(kFirst + next++ % kPorts);
    address.sin_port = htons(port);
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const bool is_free = bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    close(fd);
    if (is_free) return port;
  }
  throw std::runtime_error{"no free UDP port from 20000 to 31999"};
}

std::string read_text(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream{path}.rdbuf();
  return text.str();
}

int count(std::string_view text, std::string_view part) {
  int n = 0;
  for (std::size_t at = text.find(part); at != text.npos; at = text.find(part, at + part.size())) ++n;
  return n;
}

}  // namespace twoport::test
