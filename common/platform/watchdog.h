#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace twoport {

/// Ends a live program whose hardware does not return from a call, which no signal can, or which the hardware ends by exit(). A
/// thread of its own, that counts its own wake-ups: a program that was stopped as a whole, or that gets no processor, does not hang.
///
///     until begin()     hardware is opened, which may take long: the program is ended 1.5 s after a signal
///     until end()       ticks: the program is ended 1.5 s after the last one, as the caller has said
///     from then on      files are written, and hardware is closed: the program ends by itself
///
/// The exit status is 1.
class Watchdog {
 public:
  /// One at a time. `program` begins its sentences.
  explicit Watchdog(std::string program);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  /// Of this program. There is one while live_program() runs.
  static Watchdog& of_program() noexcept;

  /// Releases the hardware as far as can be and leaves the files; `why`: a sentence. Called in the watchdog's thread or `in_exit`, when
  /// static objects of the hardware may be gone; the loop stands.
  using Ending = std::function<void(const std::string& why, bool in_exit)>;
  void begin(Ending ending);
  void tick() noexcept { ticks_.fetch_add(1, std::memory_order_relaxed); }
  void end();

 private:
  enum class Phase { opening, running, ending };

  void run();
  [[noreturn]] void give_up(const std::string& why, bool in_exit);  ///< with mutex_
  static void at_exit();

  std::string program_;
  std::atomic<std::uint64_t> ticks_{0};
  std::mutex mutex_;  ///< of all below
  std::condition_variable changed_;
  Phase phase_ = Phase::opening;
  Ending ending_;
  bool done_ = false;
  std::thread thread_;
};

}  // namespace twoport
