#include "tools/doctor/loop.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cinttypes>
#include <cstdio>
#include <exception>
#include <thread>

#include "common/platform/realtime.h"
#include "tools/doctor/text.h"

namespace twoport::doctor {
namespace {

/// What the system counts of this thread.
struct ThreadCounters {
  long switches = 0, faults = 0;
  int processor = 0;
  std::int64_t waited_ns = 0;
};

class ThreadWatch {
 public:
  ThreadWatch() : fd_{open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC)} {}
  ~ThreadWatch() {
    if (fd_ >= 0) close(fd_);
  }
  ThreadWatch(const ThreadWatch&) = delete;
  ThreadWatch& operator=(const ThreadWatch&) = delete;

  [[nodiscard]] ThreadCounters read() const noexcept {
    rusage usage{};
    getrusage(RUSAGE_THREAD, &usage);
    ThreadCounters c{usage.ru_nivcsw, usage.ru_majflt, sched_getcpu(), 0};
    std::array<char, 96> text;
    const ssize_t size = fd_ >= 0 ? pread(fd_, text.data(), text.size() - 1, 0) : 0;
    text[static_cast<std::size_t>(std::max<ssize_t>(size, 0))] = '\0';
    std::sscanf(text.data(), "%*d %" SCNd64, &c.waited_ns);  // running, waiting, slices
    return c;
  }

 private:
  int fd_;
};

/// Runs `work` on a new thread to its end; what it throws is thrown here.
template <class Work>
void on_own_thread(Work work) {
  std::exception_ptr failed;
  std::thread{[&] {
    try {
      work();
    } catch (...) {
      failed = std::current_exception();
    }
  }}.join();
  if (failed) std::rethrow_exception(failed);
}

double us(Duration d) {
  return 1e-3 * static_cast<double>(d.count());
}

}  // namespace

LoopFigures measure_loop(const LoopRequest& request) {
  LoopFigures f;
  f.rate_hz = request.rate_hz;
  on_own_thread([&] {
    PeriodicLoop loop{{.rate_hz = request.rate_hz, .realtime = request.realtime, .spin = request.spin}};
    f.not_permitted = loop.not_permitted();
    const ThreadWatch watch;
    const Duration late_after = to_duration(0.1 / request.rate_hz);
    const auto end = static_cast<std::int64_t>(request.seconds * request.rate_hz);
    ThreadCounters before = watch.read();
    const std::atomic<bool> never{false};
    loop.run(never, [&](std::int64_t k, Duration) {
      const ThreadCounters now = watch.read();
      ++f.ticks;
      if (loop.late() > late_after) {
        ++f.late;
        const Duration waited{now.waited_ns - before.waited_ns};
        if (now.faults > before.faults)
          ++f.faulted;
        else if (now.switches > before.switches)
          ++f.preempted;
        else if (now.processor != before.processor)
          ++f.moved;
        else if (2 * waited > loop.late())
          ++f.waited;
        else
          ++f.unexplained;
      }
      before = now;
      return k + 1 < end;
    });
    f.lateness = loop.lateness();
    f.skipped = loop.deadline_misses();
  });
  return f;
}

Permissions probe_permissions() {
  Permissions p;
  on_own_thread([&] {
    rlimit limit{};
    if (getrlimit(RLIMIT_RTPRIO, &limit) == 0)
      p.rt_priority_limit = limit.rlim_cur == RLIM_INFINITY ? 99 : static_cast<int>(limit.rlim_cur);
    const sched_param wanted{80};
    p.rt_errno = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted);
    if (p.rt_errno == 0) {
      const sched_param normal{0};
      pthread_setschedparam(pthread_self(), SCHED_OTHER, &normal);
    }
    if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0)
      p.memory_lock_bytes = limit.rlim_cur == RLIM_INFINITY ? -1 : static_cast<std::int64_t>(limit.rlim_cur);
    p.lock_errno = mlockall(MCL_CURRENT) == 0 ? 0 : errno;
    if (p.lock_errno == 0) munlockall();
    const int fd = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    p.latency_errno = fd >= 0 ? 0 : errno;
    if (fd >= 0) close(fd);
    p.timer_slack_ns = prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0);
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) == 0) p.processors = CPU_COUNT(&set);
    utsname name{};
    if (uname(&name) == 0) p.kernel = name.version;
  });
  return p;
}

std::optional<std::string> read_file(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return {};
  std::string text;
  std::array<char, 4096> part;
  ssize_t size;
  while ((size = read(fd, part.data(), part.size())) > 0 && text.size() < (1u << 20))
    text.append(part.data(), static_cast<std::size_t>(size));
  close(fd);
  if (size < 0) return {};
  return text;
}

Grade grade(const LoopFigures& f) {
  const double p99 = 1e-9 * static_cast<double>(f.lateness.percentile(0.99).count()) * f.rate_hz;  // of a period
  if (f.skipped == 0 && p99 <= 0.1) return Grade::good;
  if (1000 * f.skipped <= f.ticks + f.skipped && p99 <= 0.25) return Grade::notice;
  return Grade::bad;
}

std::string describe(const LoopFigures& f) {
  return fmt::format(
      "{:g} Hz: a tick is late by {:.0f} us in the median, {:.0f} us at 99 %, {:.0f} us at most; {} of {} ticks "
      "skipped",
      f.rate_hz, us(f.lateness.percentile(0.5)), us(f.lateness.percentile(0.99)), us(f.lateness.max()), f.skipped,
      f.ticks + f.skipped);
}

std::string blame(const LoopFigures& f) {
  if (f.late == 0) return {};
  std::string parts;
  const auto add = [&](std::uint64_t count, const char* what) {
    if (count > 0) parts += fmt::format("{}{} {}", parts.empty() ? "" : ", ", count, what);
  };
  add(f.preempted, "another program had the processor");
  add(f.waited, "the loop waited for a processor");
  add(f.moved, "it was moved to another processor");
  add(f.faulted, "memory came from disk");
  add(f.unexplained, "an interrupt, the kernel or the host of a virtual machine");
  return fmt::format("of {} ticks later than a tenth of a period: {}", f.late, parts);
}

}  // namespace twoport::doctor
