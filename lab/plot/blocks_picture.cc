#include "lab/plot/blocks_picture.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {

std::string draw(const std::vector<BlockCost>& costs, const std::string& title, const std::string& folder) {
  std::string data;
  double most = 0.0;
  for (const BlockCost& cost : costs) {
    data += fmt::format("\"{}\" {} \"{:.0f} ns, x{:.2f}\" {}\n", cost.path, cost.tick_ns, cost.tick_ns, cost.ratio,
                        cost.stable ? 1 : 0);
    most = std::max(most, cost.tick_ns);
  }
  write_whole(folder + "/blocks.dat", data);
  const auto bars = [](const char* test, const char* colour, const char* name) {
    return fmt::format(
        "'blocks.dat' using ({} ? $2/2 : NaN):0:($2/2):(0.35):ytic(1) with boxxyerror fs solid 1 noborder fc rgb '{}' "
        "title '{}'",
        test, colour, name);
  };
  std::string body = fmt::format(
      "set xlabel 'cost of a master tick, both sides and the world (ns)'\n"
      "set title {}\nset yrange [{}:-1]\nset xrange [0:{}]\nunset grid\nset "
      "grid x lc rgb '#e4e4e4'\n",
      gnuplot_quoted(title + ": blocks of the world added one at a time"), costs.size(), 1.3 * most);
  body += "plot " + bars("$4 > 0", "#1b7f5c", "stable");
  if (std::any_of(costs.begin(), costs.end(), [](const BlockCost& c) { return !c.stable; }))
    body += ", " + bars("$4 < 1", "#d9a441", "unstable");
  body += ", 'blocks.dat' using 2:0:3 with labels left offset 0.5,0 notitle\n";
  write_whole(folder + "/blocks.gp", gnuplot_pages("blocks", 900, 140 + 26 * costs.size(), 10, body));
  return run_gnuplot(folder, "blocks");
}

}  // namespace twoport::lab
