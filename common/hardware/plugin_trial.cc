#include <dlfcn.h>
#include <elf.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <link.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <exception>
#include <fstream>

#include "common/hardware/plugin_host.h"

namespace twoport {
namespace {

/// Where the trial process says why it ends.
int trial_pipe = -1;

/// The end of the trial process by an exception, thrown through dlopen or not.
[[noreturn]] void end_trial() {
  const std::string why = std::current_exception() ? "an exception: " + current_words() : "std::terminate()";
  const ssize_t written = ::write(trial_pipe, why.data(), why.size());
  ::_exit(written < 0 ? 2 : 1);
}

/// The table of sections comes last in a file: does it end within?
bool is_cut_off(const std::string& path) {
  std::ifstream file{path, std::ios::binary | std::ios::ate};
  const auto size = static_cast<std::uint64_t>(file.tellg());
  ElfW(Ehdr) header{};
  file.seekg(0);
  if (!file.read(reinterpret_cast<char*>(&header), sizeof header) || std::memcmp(header.e_ident, ELFMAG, SELFMAG) != 0)
    return false;  // of no ELF file dlopen says what is wrong
  return header.e_shoff + std::uint64_t{header.e_shnum} * header.e_shentsize > size;
}

}  // namespace

std::string current_words() {
  try {
    throw;
  } catch (const std::exception& e) {
    return e.what();
  } catch (...) {
    return "an exception that is no std::exception";
  }
}

std::string try_to_load(const std::string& path) {
  constexpr int kPatience_ms = 10'000;
  if (is_cut_off(path)) return "the file is cut off; copy or build it again";
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return {};
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    const rlimit none{0, 0};
    ::setrlimit(RLIMIT_CORE, &none);
    for (const int number : {SIGABRT, SIGBUS, SIGSEGV, SIGILL, SIGFPE, SIGINT, SIGTERM}) std::signal(number, SIG_DFL);
    trial_pipe = ends[1];
    std::set_terminate(end_trial);
    try {
      ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    } catch (...) {
      end_trial();
    }
    ::_exit(0);
  }
  ::close(ends[1]);
  std::string why;
  if (child > 0) {
    // The pipe closes when the trial process ends.
    pollfd end{ends[0], POLLIN, 0};
    std::array<char, 400> text;
    ssize_t size = 0;
    int ready = 0;
    while ((ready = ::poll(&end, 1, kPatience_ms)) < 0 && errno == EINTR) {
    }
    if (ready > 0 && (size = ::read(ends[0], text.data(), text.size())) > 0)
      why = "loading it throws " + std::string{text.data(), static_cast<std::size_t>(size)};
    if (ready == 0) {
      why = fmt::format("loading it has not ended after {} s", kPatience_ms / 1000);
      ::kill(child, SIGKILL);
    }
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (why.empty() && WIFSIGNALED(status))
      why = fmt::format(
          "loading it ends the program by signal {} ({}): the file is damaged, or code that it runs when it is loaded "
          "fails",
          WTERMSIG(status), ::strsignal(WTERMSIG(status)));
    if (why.empty() && WIFEXITED(status) && WEXITSTATUS(status) != 0)
      why = fmt::format("loading it ends the program with status {}", WEXITSTATUS(status));
  }
  ::close(ends[0]);
  return why;
}

}  // namespace twoport
