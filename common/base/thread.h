#pragma once

#include <pthread.h>
#include <sched.h>

namespace twoport {

/// The calling thread works beside the cycle: it gives up a real-time priority that it has inherited, as of a program that
/// was started with chrt.
inline void take_ordinary_priority() noexcept {
  const sched_param none{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
}

}  // namespace twoport
