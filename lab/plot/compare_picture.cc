#include "lab/plot/compare_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"
#include "lab/plot/page.h"

namespace twoport::lab {
namespace {

/// √(Σ column_i²) over the translational axes.
std::string norm_of(const char* column, int dof) {
  std::string sum;
  for (int i = 0; i < std::min(dof, 3); ++i) sum += fmt::format("{}column('{}_{}')**2", i == 0 ? "" : "+", column, i);
  return "(sqrt(" + sum + "))";
}

}  // namespace

std::string draw(const Comparison& all, const std::string& folder) {
  using Mark = LegendEntry::Mark;
  Page page{all.scene + ": force at the environment and at the hand",
            {{Mark::line, kUnstableColour, "environment"}, {Mark::line, kStableColour, "felt by the hand"}}};
  page.panels(all.methods.size());
  // One scale for all that is stable; what is not is cut.
  constexpr std::uint64_t kPoints = 3000;  // of a curve
  double most = 0.0;
  for (const Summary& s : all.summaries)
    if (s.verdict_kind() != "UNSTABLE") most = std::max(most, s.robot_max_force_n());
  std::string body = "set datafile separator ','\n";
  if (most > 0.0) body += fmt::format("set yrange [0:{}]\n", 1.1 * most);
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const std::string file = gnuplot_quoted(all.methods[m] + "/trace.csv");
    body += page.panel(m, all.methods[m] + ": " + all.summaries[m].verdict_kind(), {"time", "s"}, {"force", "N"});
    body += fmt::format(
        "plot {0} using 't_s':{1} every {5} with lines lw 1.2 lc rgb '{2}', {0} using 't_s':{3} every {5} with lines "
        "lw "
        "1.2 lc rgb '{4}'\n",
        file, norm_of("env_f", all.dof), kUnstableColour, norm_of("master_f", all.dof), kStableColour,
        all.summaries[m].steps() / kPoints + 1);
  }
  write_whole(folder + "/compare.gp", page.pages("compare", body));
  return run_gnuplot(folder, "compare");
}

}  // namespace twoport::lab
