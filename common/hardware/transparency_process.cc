#include <dlfcn.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <new>

#include "common/base/check.h"
#include "common/hardware/plugin_host.h"
#include "common/hardware/transparency_host.h"

namespace twoport {
namespace {

constexpr long kNap_ns = 50'000;
constexpr int kSpins = 2000;

void nap() noexcept {
  const timespec time{0, kNap_ns};
  ::nanosleep(&time, nullptr);
}

/// Shared by both processes. An answer belongs to the question of its number.
struct Exchange {
  std::atomic<std::uint64_t> asked{0}, answered{0};
  std::atomic<int> opened{0};  ///< 1: yes, -1: no, see `why`
  char why[256]{};
  twoport_transparency_reading reading[2]{};
  twoport_transparency_wish wish[2]{};
};

[[noreturn]] void give_up(Exchange& with, const std::string& why) {
  std::strncpy(with.why, why.c_str(), sizeof with.why - 1);
  with.opened = -1;
  ::_exit(1);
}

/// The child: never returns.
[[noreturn]] void serve(Exchange& with, const std::string& file, const twoport_transparency_session& session) {
  const rlimit none{0, 0};
  ::setrlimit(RLIMIT_CORE, &none);
  for (const int number : {SIGABRT, SIGBUS, SIGSEGV, SIGILL, SIGFPE, SIGTERM}) std::signal(number, SIG_DFL);
  std::signal(SIGINT, SIG_IGN);  // the program ends first
  void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) give_up(with, std::string{"cannot be loaded: "} + ::dlerror());
  void* const symbol = ::dlsym(library, "twoport_transparency_plugin");
  if (symbol == nullptr) give_up(with, "is no transparency layer: it has no function twoport_transparency_plugin");
  const twoport_transparency_entry* const entry = reinterpret_cast<const twoport_transparency_entry* (*)()>(symbol)();
  if (entry == nullptr) give_up(with, "its entry point returns nothing");
  if (entry->version != TWOPORT_TRANSPARENCY_VERSION)
    give_up(with, "is of version " + std::to_string(entry->version) + ", and this program loads version " +
                      std::to_string(TWOPORT_TRANSPARENCY_VERSION));
  if (entry->open == nullptr || entry->step == nullptr) give_up(with, "its entry point lacks open or step");
  void* const layer = entry->open(&session);
  if (layer == nullptr) give_up(with, "open() returns nothing");
  with.opened = 1;
  for (std::uint64_t done = 0;;) {
    std::uint64_t asked = 0;
    for (int i = 0; (asked = with.asked.load(std::memory_order_acquire)) == done; ++i)
      if (i > kSpins) nap();
    twoport_transparency_wish wish{};
    wish.stored_j = -1.0;
    const twoport_transparency_reading reading = with.reading[asked % 2];
    entry->step(layer, &reading, &wish);
    with.wish[asked % 2] = wish;
    with.answered.store(done = asked, std::memory_order_release);
  }
}

class Process final : public TransparencyHost {
 public:
  Process(const std::string& file, const twoport_transparency_session& session, bool waits) : waits_{waits} {
    void* const memory = ::mmap(nullptr, sizeof(Exchange), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) throw ConfigError{"control.transparency.plugin: no memory to share with its process"};
    with_ = new (memory) Exchange;
    const pid_t parent = ::getpid();
    child_ = ::fork();
    if (child_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      if (::getppid() != parent) ::_exit(0);
      serve(*with_, file, session);
    }
    for (int i = 0; i < kPatience && child_ > 0 && with_->opened == 0 && !ended(); ++i) nap();
    if (with_->opened != 1) {
      const std::string why = with_->why[0] != '\0' ? with_->why
                              : child_ < 0          ? "no process can be started"
                                                    : "it does not open";
      close();
      throw ConfigError{"control.transparency.plugin.file " + file + ": " + why};
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() override { close(); }

  bool step(const twoport_transparency_reading& in, twoport_transparency_wish& out) noexcept override {
    const std::uint64_t done = with_->answered.load(std::memory_order_acquire), asked = with_->asked;
    if (!waits_) {
      if (done != 0) out = with_->wish[done % 2];
      if (done != asked) return ++silent_ < kMostSilent;  // still at the last question
      silent_ = 0;
    }
    with_->reading[(asked + 1) % 2] = in;
    with_->asked.store(asked + 1, std::memory_order_release);
    if (!waits_) return true;
    for (int i = 0; with_->answered.load(std::memory_order_acquire) != asked + 1; ++i) {
      if (i < kSpins) {
        ::sched_yield();
      } else if (i > kSpins + kPatience / 10 || ended()) {
        return false;
      } else {
        nap();
      }
    }
    out = with_->wish[(asked + 1) % 2];
    return true;
  }

 private:
  static constexpr int kPatience = 200'000;  ///< naps: 10 s
  static constexpr int kMostSilent = 20;     ///< ticks

  /// Has the child ended?
  bool ended() noexcept {
    if (child_ > 0 && ::waitpid(child_, nullptr, WNOHANG) == child_) child_ = -1;
    return child_ < 0;
  }
  void close() noexcept {
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    if (with_ != nullptr) ::munmap(with_, sizeof(Exchange));
    with_ = nullptr;
  }

  bool waits_;
  pid_t child_ = -1;
  Exchange* with_ = nullptr;
  int silent_ = 0;
};

}  // namespace

std::shared_ptr<TransparencyHost> start_transparency_process(const std::string& file, const std::string& arguments,
                                                             int dof, Seconds period, bool waits) {
  const auto refuse = [&](const std::string& why) {
    throw ConfigError{"control.transparency.plugin.file " + file + ": " + why};
  };
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error))
    refuse("there is no such file; give the path of a shared library");
  // A name without a slash would be searched in the system's folders.
  const std::string path = std::filesystem::absolute(file).string();
  if (const std::string why = try_to_load(path); !why.empty()) refuse("cannot be loaded: " + why);
  return std::make_shared<Process>(path, twoport_transparency_session{dof, period.si(), arguments.c_str()}, waits);
}

}  // namespace twoport
