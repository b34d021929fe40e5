#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace twoport::lab {

/// Number of hardware threads.
inline int all_cores() {
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// Calls work(0) … work(count - 1), each once, from up to `jobs` threads, in no fixed order; from fewer if the system
/// provides fewer. The first exception stops calls that have not begun and is rethrown.
template <class Work>
void for_each_parallel(std::size_t count, int jobs, Work work) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex guard;
  const auto loop = [&] {
    for (std::size_t i; (i = next.fetch_add(1)) < count;) {
      try {
        work(i);
      } catch (...) {
        const std::lock_guard lock{guard};
        if (!failure) failure = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::thread> others;
  const std::size_t threads = std::min(count, static_cast<std::size_t>(std::max(jobs, 1)));
  others.reserve(threads);
  try {
    while (others.size() + 1 < threads) others.emplace_back(loop);
  } catch (const std::system_error&) {
    // No more threads: those that are there do the work.
  }
  loop();
  for (std::thread& other : others) other.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace twoport::lab
