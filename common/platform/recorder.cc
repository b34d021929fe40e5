#include "common/platform/recorder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>

namespace twoport {
template <int N>
void Recorder<N>::drain() {
  Row<N> row;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  for (bool last = false; !last;) {
    last = done_.load(std::memory_order_acquire);
    bool any = false;
    while (ring_.try_pop(row)) {
      any = true;
      if (trace_) trace_->add(row);
      if (!metrics_.add(row)) diverged_.store(true, std::memory_order_relaxed);
    }
    if (any && terminal && row.t_s > shown_s_ + 0.1) show(row);
    if (!last) std::this_thread::sleep_for(std::chrono::milliseconds{20});
  }
  if (terminal && shown_s_ >= 0.0) std::fputs("\n", stderr);
}

template <int N>
void Recorder<N>::show(const Row<N>& row) {
  shown_s_ = row.t_s;
  fmt::print(stderr, "\r{:6.1f} / {:.1f} s   {:8}   force {:6.2f} N   port energy {:+9.4f} J ", row.t_s, duration_s_,
             to_string(row.mode), translational(row.master_f.vec()).norm(), row.master_energy_j);
  std::fflush(stderr);
}

template class Recorder<1>;
template class Recorder<3>;
template class Recorder<6>;

}  // namespace twoport
