#pragma once

#include <string>
#include <vector>

#include "common/record/summary.h"
#include "lab/study/table.h"

namespace twoport::lab {

struct GalleryOptions {
  std::string folder = "scenes/edge";
  std::vector<std::string> methods;  ///< empty: every method
  int jobs = 1;
};

/// Every scene of a folder, run with every method.
struct Gallery {
  struct Entry {
    std::string scene;                ///< file name without its ending
    std::vector<Summary> summaries;   ///< one for each method
    std::vector<std::string> missed;  ///< expectations that were not met, one sentence each
  };
  std::vector<std::string> methods;
  std::vector<Entry> entries;
};

/// Throws ConfigError for a folder without scenes, an invalid scene or an unknown method. Only expectations of a method's
/// verdict (`of_method`) are checked.
Gallery gallery(const GalleryOptions& options, const Heard& heard = {});

/// What a run was, in a word: stable, mute (stable, and nothing is felt in more than half of the contact), restless,
/// UNSTABLE, undecided.
std::string in_a_word(const Summary& summary);

/// Who survives what: a row for each scene, a column for each method.
std::string to_text(const Gallery& all);
/// A row for each scene and method.
Table to_table(const Gallery& all);

}  // namespace twoport::lab
