#pragma once

#include <string>
#include <vector>

#include "common/link/link_trace.h"
#include "lab/study/map.h"

namespace twoport::lab {

/// What a scene over a link needs, and why.
struct LinkAdvice {
  struct Way {
    DirectionFigures figures{};
    double playout_ms = 0.0;
    [[nodiscard]] double delay_ms() const {
      return 1e3 * nominal_delay_s(figures.least_s, figures.least_s + figures.jitter_p50_s, 1e-3 * playout_ms);
    }
  };
  Way to_slave, to_master;
  double hold_after_s = 0.1, release_after_s = 1.0;
  std::string method;  ///< "none": none holds
  double initial_energy_j = 0.0;
  std::vector<std::string> why;  ///< sentences
  [[nodiscard]] double round_trip_ms() const { return to_slave.delay_ms() + to_master.delay_ms(); }
  [[nodiscard]] double longest_silence_s() const;
};

/// Without a method. Playout: nothing below a millisecond of jitter (99 %), else that jitter, rounded up, at most 2 s. hold_after_s: four
/// times the longest silence, rounded up to 50 ms, at least the default 0.1 s. release_after_s: twice that and the playout, at least the
/// default 1 s.
LinkAdvice advise(const DirectionFigures& to_slave, const DirectionFigures& to_master);

/// The same with the method of least error over this link, with and without the playout. Of `options` scene, overrides, methods,
/// seeds, jobs and one stiffness are read; 0: the scene's own.
LinkAdvice recommend(const LinkTrace& link, MapOptions options, const Heard& heard = {});

/// Blocks of a scene, with the reasons as comments.
std::string to_text(const LinkAdvice& advice);
/// {"scene": {...}, "why": [...], "link": {...}}, the scene as its blocks.
std::string to_json(const LinkAdvice& advice);
std::string to_json(const DirectionFigures& figures);

}  // namespace twoport::lab
