#pragma once

#include <string>
#include <vector>

#include "common/scene/parts.h"
#include "lab/study/many_runs.h"

namespace twoport::lab {

/// The operator's path, initial states, rates, architecture and controllers are not optional.
using Block = ScenePart;

/// The optional blocks, in the order of the data flow; a block precedes its parts. Blocks without which the scene
/// cannot run, such as the only mass of the handle, are not listed.
std::vector<Block> blocks(const Scene& scene);

/// Relative difference of two numbers of a summary; 0 if equal, 1 if one is not finite:
///
///     |a - b| / max(|a|, |b|, floor)     floor: 1e-6 J (1e-3 J for *_min_energy_j), 1e-6 m, 1e-3 N, 0.01 deg,
///                                        1e-3 s, 1 (ms, counts, flags)
double relative_change(const std::string& key, double a, double b);

/// The number with the largest relative difference between two runs, except `step_ns`.
struct Contrast {
  std::string key = "nothing";
  double with = 0.0, without = 0.0, change = 0.0;
};

enum class Need {
  needed,      ///< a number changes by the tolerance or more and leaves its scatter; or a verdict or expectation turns
  in_scatter,  ///< numbers change by the tolerance or more, within the range that each has anyway
  spare,       ///< no number changes by the tolerance, in any run
  together,    ///< the same, but not once the other spare ones are gone
};

struct Judged {
  std::string path;
  Need need;
  Contrast most;
  double saved;  ///< of the cost of a tick: 1 - without/with, median of interleaved runs
};

struct Trim {
  std::vector<Judged> blocks;
  Contrast scatter;  ///< of the whole scene over its runs: smallest and largest
  Judged spare;      ///< all spare blocks left out at once; path: them
  Judged loose;      ///< those within the scatter left out too; path: these
};

/// Which blocks change the summary of a scene by less than `tolerance`, 0 < tolerance < 1. Every variant makes eight
/// runs: with the scene's seed, and with the next seven seeds and stiffnesses changed in the twelfth digit,
/// which distinguishes changes from scatter. `repetitions` times, in turn with the whole scene.
/// Throws ConfigError for another tolerance, and for a robot alone, of which a summary has no figures.
Trim trim(const Scene& scene, double tolerance, int repetitions, const Heard& heard = {});
std::string to_text(const Trim& trim, double tolerance);
std::string to_csv(const Trim& trim);

/// Cost of a scene that has blocks up to and with this one, or these: a hand comes with what gives it mass.
struct BlockCost {
  std::string path;
  double tick_ns, ratio;  ///< to the bare scene; medians of interleaved runs
  bool stable;
};
/// The first is the bare scene; then one more block each, in the order of blocks(). The cost of a block includes its
/// effect on the others: a bar may be shorter than the one before.
std::vector<BlockCost> block_costs(const Scene& scene, int repetitions, const Heard& heard = {});
std::string to_text(const std::vector<BlockCost>& costs);
std::string to_csv(const std::vector<BlockCost>& costs);

}  // namespace twoport::lab
