#include "lab/plot/boundary_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"
#include "lab/plot/label.h"
#include "lab/plot/page.h"
#include "lab/plot/scale.h"

namespace twoport::lab {
namespace {

constexpr double kBar = 0.6;  // of the distance between two values

/// Blocks of data: bars that are stable, bars that are not, the boundary, values that differ from both ends.
std::string data(const BoundaryCurve& c, const Scale& x) {
  // A row of NaN: gnuplot does not count a block that is empty.
  std::string stable = "# x bar_left bar_right from to, stable\nNaN NaN NaN NaN NaN\n";
  std::string unstable = "# the same, unstable\nNaN NaN NaN NaN NaN\n";
  std::string boundary = "# x boundary\n", odd = "# x, a value that differs from both ends\nNaN NaN\n";
  std::vector<std::size_t> order(c.found.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return x.at(c.along.values[a]) < x.at(c.along.values[b]); });
  for (const std::size_t i : order) {
    const BoundarySearch& found = c.found[i];
    const double place = x.at(c.along.values[i]);
    const auto [left, right] = x.reach(place, kBar);
    const auto add_bar = [&, l = left, r = right](bool is_stable, double from, double to) {
      (is_stable ? stable : unstable) += fmt::format("{} {} {} {} {}\n", place, l, r, from, to);
    };
    if (!found.boundary) {
      add_bar(found.stable_at_low, c.vary.low, c.vary.high);
      boundary += fmt::format("{} NaN\n", place);  // interrupts the line
      if (found.disagreement) odd += fmt::format("{} {}\n", place, *found.disagreement);
      continue;
    }
    add_bar(found.stable_at_low, c.vary.low, found.boundary->stable);
    add_bar(!found.stable_at_low, found.boundary->stable, c.vary.high);
    boundary += fmt::format("{} {}\n", place, found.boundary->stable);
  }
  return stable + "\n\n" + unstable + "\n\n" + boundary + "\n\n" + odd + "\n\n";
}

}  // namespace

std::string draw(const BoundaryCurve& c, const std::string& folder) {
  const Scale x{c.along};
  const bool logarithmic = c.vary.low > 0.0 && c.vary.high > 30.0 * c.vary.low;
  using Mark = LegendEntry::Mark;
  std::vector<LegendEntry> legend{{Mark::box, kStableColour, "stable"},
                                  {Mark::box, kUnstableColour, "unstable"},
                                  {x.words() ? Mark::dot : Mark::line, "black", "boundary"}};
  if (std::any_of(c.found.begin(), c.found.end(), [](const BoundarySearch& s) { return s.disagreement.has_value(); }))
    legend.push_back({Mark::cross, "black", "not as at both ends"});
  Page page{c.scene + ": where the run stops being stable", legend};
  const bool slanted = page.slants(x);
  std::string body = x.commands('x', true, slanted) + page.panel(0, "", x.label(), label_of_paths(c.vary.paths));
  body += fmt::format("set yrange [{}:{}]\nunset grid\n", c.vary.low, c.vary.high);
  if (logarithmic) body += "set logscale y\n" + log_ticks('y', c.vary.low, c.vary.high);
  const auto bars = [](int index, const char* colour) {
    return fmt::format("'boundary.dat' index {} using 1:4:2:3:4:5 with boxxyerror fs solid 1 noborder fc rgb '{}', ",
                       index, colour);
  };
  body += "plot " + bars(0, kStableColour) + bars(1, kUnstableColour);
  body += fmt::format(
      "'boundary.dat' index 2 using 1:2 with {} lc rgb 'black' lw 2 pt 7 ps 1, 'boundary.dat' index 3 using 1:2 with "
      "points pt 2 ps 1.2 lw 2 lc rgb 'black'\n",
      x.words() ? "points" : "linespoints");
  write_whole(folder + "/boundary.dat", data(c, x));
  write_whole(folder + "/boundary.gp", page.pages("boundary", body));
  return run_gnuplot(folder, "boundary");
}

}  // namespace twoport::lab
