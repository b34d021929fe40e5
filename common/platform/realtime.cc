#include "common/platform/realtime.h"

#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <ctime>
#include <initializer_list>

#include "common/base/check.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr Duration kSpin = 50us;
constexpr Duration kLead = 1ms;  // from begin to tick 0
constexpr double kMaxRateHz = 100e3;

std::atomic<bool> stop_requested{false};
std::atomic<unsigned> hand_switches{0};
static_assert(std::atomic<unsigned>::is_always_lock_free);
static_assert(std::atomic<bool>::is_always_lock_free);  // as a signal handler needs it

Duration monotonic() noexcept {
  return std::chrono::steady_clock::now().time_since_epoch();
}

bool handle(std::initializer_list<int> signals, void (*handler)(int), int flags = 0) noexcept {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = flags;
  sigemptyset(&action.sa_mask);
  return std::all_of(signals.begin(), signals.end(), [&](int s) { return sigaction(s, &action, nullptr) == 0; });
}

/// May return early, upon a signal.
void sleep_until(Duration moment) noexcept {
  const auto whole = std::chrono::duration_cast<std::chrono::seconds>(moment);
  const timespec t{static_cast<std::time_t>(whole.count()), static_cast<long>((moment - whole).count())};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

void relax() noexcept {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#endif
}

/// Touches the stack that the loop will use, so that it is mapped.
void touch_stack() noexcept {
  std::array<volatile char, 256 * 1024> stack;
  for (std::size_t i = 0; i < stack.size(); i += 1024) stack[i] = 0;
}

}  // namespace

const std::atomic<bool>& stop_on_signals() {
  // SIGHUP: the terminal has gone. SIGXCPU: `ulimit -t`, RLIMIT_RTTIME; what has been opened is released.
  handle({SIGINT, SIGTERM, SIGHUP, SIGXCPU}, [](int) { stop_requested.store(true, std::memory_order_relaxed); });
  // SIGPIPE: the reader of our output has gone. SIGXFSZ: `ulimit -f`; the write fails, as on a full disk.
  handle({SIGPIPE, SIGXFSZ}, SIG_IGN);
  return stop_requested;
}

unsigned switches_by_hand() noexcept {
  [[maybe_unused]] static const bool installed = handle(
      {SIGUSR1}, [](int) { hand_switches.fetch_add(1, std::memory_order_relaxed); }, SA_RESTART);
  return hand_switches.load(std::memory_order_relaxed);
}

PeriodicLoop::PeriodicLoop(const LoopOptions& options) : options_{options} {
  if (!(options.rate_hz > 0.0 && options.rate_hz <= kMaxRateHz))
    throw ConfigError("loop: rate_hz must be above 0 and at most 100000, got " + std::to_string(options.rate_hz));
  if (options.priority < 1 || options.priority > 99)
    throw ConfigError("loop: priority must be from 1 to 99, got " + std::to_string(options.priority));
  if (!options.realtime) return;
  lock_memory();
  stay_awake();
  sharpen_timer();
  take_priority();
}

PeriodicLoop::~PeriodicLoop() {
  if (previous_policy_ >= 0) {
    const sched_param parameter{previous_priority_};
    pthread_setschedparam(pthread_self(), previous_policy_, &parameter);
  }
  if (previous_slack_ns_ >= 0) prctl(PR_SET_TIMERSLACK, static_cast<unsigned long>(previous_slack_ns_), 0, 0, 0);
  if (latency_fd_ >= 0) close(latency_fd_);
  if (locked_) munlockall();
}

void PeriodicLoop::lock_memory() {
  // Under a limit, locking future memory would make a later allocation fail: then lock present memory only.
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const rlimit none{RLIM_INFINITY, RLIM_INFINITY};
  const bool unlimited = limit.rlim_cur == RLIM_INFINITY || setrlimit(RLIMIT_MEMLOCK, &none) == 0;
  touch_stack();
  locked_ = mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) == 0;
  if (!locked_)
    not_permitted_.push_back(std::string{"memory is not locked ("} + std::strerror(errno) +
                             "): a page fault may delay a tick; run as root or raise `ulimit -l` to unlimited");
}

void PeriodicLoop::take_priority() {
  sched_param parameter{};
  int policy = 0;
  pthread_getschedparam(pthread_self(), &policy, &parameter);
  const sched_param wanted{options_.priority};
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted);
  if (error == 0) {
    previous_policy_ = policy;
    previous_priority_ = parameter.sched_priority;
  } else {
    not_permitted_.push_back("no SCHED_FIFO priority " + std::to_string(options_.priority) + " (" +
                             std::strerror(error) +
                             "): other programs may delay a tick by milliseconds; run as root or raise `ulimit -r`");
  }
}

void PeriodicLoop::stay_awake() {
  latency_fd_ = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
  const std::int32_t no_latency = 0;
  if (latency_fd_ >= 0 && ::write(latency_fd_, &no_latency, sizeof no_latency) == sizeof no_latency) return;
  not_permitted_.push_back(
      std::string{"/dev/cpu_dma_latency cannot be held at 0 ("} + std::strerror(errno) +
      "): waking an idle core takes tens of microseconds longer; run as root or allow writing to it");
  if (latency_fd_ >= 0) close(latency_fd_);
  latency_fd_ = -1;
}

void PeriodicLoop::sharpen_timer() {
  previous_slack_ns_ = prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0);
  if (prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0) == 0) return;
  previous_slack_ns_ = -1;
  not_permitted_.push_back(std::string{"timer slack of 1 ns refused ("} + std::strerror(errno) +
                           "): ticks are up to 50 us late; only SCHED_FIFO avoids this");
}

void PeriodicLoop::begin() {
  start_ = monotonic() + kLead;
  last_ = -1;
}

std::int64_t PeriodicLoop::next(const std::atomic<bool>& stop) noexcept {
  std::int64_t k = last_ + 1;
  const Duration due = deadline(k);
  const Duration until = options_.spin ? due - kSpin : due;
  Duration now = monotonic();
  while (now < until && !stop.load(std::memory_order_relaxed)) {
    sleep_until(until);
    now = monotonic();
  }
  while (now < due && !stop.load(std::memory_order_relaxed)) {
    relax();
    now = monotonic();
  }
  if (stop.load(std::memory_order_relaxed)) return -1;
  late_ = now - due;
  lateness_.add(late_);

  // More than a period late: continue with the newest tick that is due.
  if (deadline(k + 1) <= now) {
    const Duration since = now - start_;
    k = std::max(k + 1, static_cast<std::int64_t>(to_seconds(since).si() * options_.rate_hz));
    while (deadline(k + 1) <= now) ++k;
    while (deadline(k) > now) --k;
    deadline_misses_ += static_cast<std::uint64_t>(k - last_ - 1);
  }
  last_ = k;
  return k;
}

}  // namespace twoport
