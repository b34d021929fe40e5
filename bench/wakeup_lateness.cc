// How late PeriodicLoop wakes up. One line: rate, ticks, p50, p99, p99.9 and max in us, misses.
//
// usage: wakeup_lateness [--rate HZ] [--seconds S] [--spin 0|1] [--realtime 0|1]
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string_view>

#include "common/base/check.h"
#include "common/platform/realtime.h"

namespace twoport {
namespace {

double us(Duration d) {
  return static_cast<double>(d.count()) / 1e3;
}

int usage() {
  std::fprintf(stderr, "usage: wakeup_lateness [--rate HZ] [--seconds S] [--spin 0|1] [--realtime 0|1]\n");
  return 2;
}

int measure(const LoopOptions& options, double seconds) {
  const auto loop = std::make_unique<PeriodicLoop>(options);
  for (const std::string& sentence : loop->not_permitted()) std::fprintf(stderr, "%s\n", sentence.c_str());
  const Duration end = to_duration(seconds);
  loop->run(stop_on_signals(), [&](std::int64_t, Duration now) { return now < end; });
  const Histogram& late = loop->lateness();
  std::printf("PeriodicLoop %s %5.0f Hz %7llu ticks  p50 %8.2f  p99 %8.2f  p99.9 %8.2f  max %9.2f us, misses %llu\n",
              options.spin ? "spin " : "sleep", options.rate_hz, static_cast<unsigned long long>(late.count()),
              us(late.percentile(0.5)), us(late.percentile(0.99)), us(late.percentile(0.999)), us(late.max()),
              static_cast<unsigned long long>(loop->deadline_misses()));
  return 0;
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  twoport::LoopOptions options;
  double seconds = 5.0;
  for (int i = 1; i < argc; i += 2) {
    const std::string_view option = argv[i];
    if (i + 1 == argc) return twoport::usage();
    if (option == "--rate") {
      options.rate_hz = std::atof(argv[i + 1]);
    } else if (option == "--seconds") {
      seconds = std::atof(argv[i + 1]);
    } else if (option == "--spin") {
      options.spin = std::atoi(argv[i + 1]) != 0;
    } else if (option == "--realtime") {
      options.realtime = std::atoi(argv[i + 1]) != 0;
    } else {
      return twoport::usage();
    }
  }
  try {
    return twoport::measure(options, seconds);
  } catch (const twoport::ConfigError& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
