#include "common/platform/watchdog.h"

#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "common/base/print_error.h"
#include "common/base/thread.h"
#include "common/platform/realtime.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr auto kLook = 100ms;
constexpr int kLooks = 15;             // without a tick
constexpr unsigned kFilesTake_s = 10;  // at most: then SIGALRM ends the program

std::atomic<Watchdog*> watchdog_of_program{nullptr};

}  // namespace

Watchdog::Watchdog(std::string program) : program_{std::move(program)} {
  [[maybe_unused]] static const bool registered = std::atexit(at_exit) == 0;
  watchdog_of_program = this;
  thread_ = std::thread{[this] { run(); }};
}
Watchdog::~Watchdog() {
  watchdog_of_program = nullptr;
  {
    const std::lock_guard lock{mutex_};
    done_ = true;
  }
  changed_.notify_one();
  thread_.join();
}
Watchdog& Watchdog::of_program() noexcept {
  return *watchdog_of_program;
}

void Watchdog::begin(Ending ending) {
  const std::lock_guard lock{mutex_};
  phase_ = Phase::running;
  ending_ = std::move(ending);
  tick();
}
void Watchdog::end() {
  const std::lock_guard lock{mutex_};
  phase_ = Phase::ending;
}

void Watchdog::run() {
  take_ordinary_priority();
  const std::atomic<bool>& stop = stop_on_signals();
  std::uint64_t seen = 0;
  int looks = 0;
  std::unique_lock lock{mutex_};
  while (!changed_.wait_for(lock, kLook, [&] { return done_; })) {
    const std::uint64_t ticks = ticks_.load(std::memory_order_relaxed);
    const bool waits = phase_ == Phase::running || (phase_ == Phase::opening && stop);
    looks = waits && ticks == seen ? looks + 1 : 0;
    seen = ticks;
    if (looks < kLooks) continue;
    give_up(phase_ == Phase::running ? "the hardware has not returned from a call for 1.5 s; it was released as far as "
                                       "it answers"
                                     : "ended by a signal while the hardware was being opened; nothing is recorded",
            false);
  }
}

void Watchdog::give_up(const std::string& why, bool in_exit) {
  std::signal(SIGALRM, SIG_DFL);
  ::alarm(kFilesTake_s);
  if (phase_ == Phase::running) {
    ending_(why, in_exit);
  } else {
    print_error("{}: {}\n", program_, why);
  }
  std::fflush(stdout);
  ::_exit(1);
}

/// exit() by other code than the program's own end, which has no watchdog any more.
void Watchdog::at_exit() {
  Watchdog* const watchdog = watchdog_of_program.exchange(nullptr);
  if (watchdog == nullptr) return;
  const std::lock_guard lock{watchdog->mutex_};  // the watchdog may be giving up, and ends the program
  watchdog->give_up("the hardware has ended the program by exit()", true);
}

}  // namespace twoport
