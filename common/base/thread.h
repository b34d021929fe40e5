#pragma once

#include <pthread.h>
#include <sched.h>
#include <time.h>

#include <chrono>

namespace twoport {

/// The calling thread works beside the cycle: it gives up a real-time priority that it has inherited, as of a program that
/// was started with chrt.
inline void take_ordinary_priority() noexcept {
  const sched_param none{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
}

/// The processor time that the calling thread has used: what else the machine does is not in it.
struct ThreadClock {
  static std::chrono::nanoseconds now() noexcept {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return std::chrono::seconds{t.tv_sec} + std::chrono::nanoseconds{t.tv_nsec};
  }
};

}  // namespace twoport
