#include "lab/plot/map_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"
#include "lab/plot/page.h"

namespace twoport::lab {
namespace {

/// The values that places take, each once, in their order, and the words of their ticks.
class Ticks {
 public:
  Ticks(const Map& map, double MapPlace::*of) : of_{of} {
    for (const MapPlace& p : map.places) values_.push_back(p.*of);
    std::sort(values_.begin(), values_.end());
    values_.erase(std::unique(values_.begin(), values_.end()), values_.end());
  }
  [[nodiscard]] double at(const MapPlace& p) const {
    return static_cast<double>(std::lower_bound(values_.begin(), values_.end(), p.*of_) - values_.begin());
  }
  [[nodiscard]] std::string commands(char axis, double scale, bool with_words = true) const {
    std::string all =
        fmt::format("set {}range [-0.5:{}]\nset {}tics (", axis, static_cast<double>(values_.size()) - 0.5, axis);
    for (std::size_t i = 0; i < values_.size(); ++i)
      all += fmt::format("{}'{}' {}", i == 0 ? "" : ", ",
                         with_words ? fmt::format("{:g}", scale * values_[i]) : std::string{}, i);
    return all + ") font ',8'\n";
  }

 private:
  double MapPlace::*of_;
  std::vector<double> values_;
};

constexpr const char* kBoxes = "using 1:2:($1-0.5):($1+0.5):($2-0.5):($2+0.5)";
const Label kRoundTrip{"round trip", "ms"}, kStiffness{"wall stiffness", "kN/m"};
// Distinct for most eyes; the first is the first method of the list.
constexpr const char* kColours[] = {"#2a788e", "#f4a582", "#7a5195", "#bcbd22", "#ef5675", "#1f77b4", "#8c564b",
                                    "#2ca02c", "#e377c2", "#ffa600", "#17becf", "#444444", "#a05d00", "#9edae5"};
constexpr const char* kNoMethod = "#d0d0d0";

std::string draw_holds(const Map& map, const Ticks& x, const Ticks& y, const std::string& folder) {
  std::string data;
  Page page{map.scene + ": share of losses at which a method is stable, quiet and presses", {}};
  page.panels(map.methods.size()).colour_bar({"share of the losses", ""}, 0.0, 1.0, false);
  std::string body =
      "unset grid\nset palette defined (0 '#f4a582', 0.5 '#f0f0f0', 1 '#2a788e')\n" + x.commands('x', 1.0);
  for (std::size_t m = 0; m < map.methods.size(); ++m) {
    std::map<std::pair<double, double>, std::pair<int, int>> share;  // holds, of
    for (std::size_t p = 0; p < map.places.size(); ++p) {
      auto& [holds, of] = share[{x.at(map.places[p]), y.at(map.places[p])}];
      holds += map.at(m, p).holds();
      ++of;
    }
    data += fmt::format("# {}: round trip, stiffness (numbers of ticks), share\n", map.methods[m]);
    for (const auto& [at, of] : share)
      data += fmt::format("{} {} {}\n", at.first, at.second, static_cast<double>(of.first) / of.second);
    data += "\n\n";
    body += y.commands('y', 1e-3, page.at_left(m)) + page.panel(m, map.methods[m], kRoundTrip, kStiffness);
    body += fmt::format("plot 'map.dat' index {} {}:3 with boxxyerror fs solid 1 noborder lc palette\n", m, kBoxes);
  }
  write_whole(folder + "/map.dat", data);
  write_whole(folder + "/map.gp", page.pages("map", body));
  return run_gnuplot(folder, "map");
}

std::string draw_best(const Map& map, const Ticks& x, const Ticks& y, const std::string& folder) {
  using Loss = std::pair<double, double>;  // probability, burst
  std::map<Loss, std::vector<std::size_t>> by_loss;
  for (std::size_t p = 0; p < map.places.size(); ++p)
    by_loss[{map.places[p].loss, map.places[p].burst_packets}].push_back(p);
  // Only what is drawn.
  std::vector<std::size_t> best(map.places.size());
  for (std::size_t p = 0; p < map.places.size(); ++p) best[p] = best_method(map, p);
  const auto is_drawn = [&](std::size_t m) { return std::find(best.begin(), best.end(), m) != best.end(); };
  std::vector<LegendEntry> legend;
  for (std::size_t m = 0; m < map.methods.size(); ++m)
    if (is_drawn(m)) legend.push_back({LegendEntry::Mark::box, kColours[m % std::size(kColours)], map.methods[m]});
  if (is_drawn(map.methods.size())) legend.push_back({LegendEntry::Mark::box, kNoMethod, "none holds"});
  Page page{map.scene + ": the method with the least error", legend};
  page.panels(by_loss.size());
  std::string data, body = "unset grid\n" + x.commands('x', 1.0);
  std::size_t i = 0;
  for (const auto& [loss, places] : by_loss) {
    data += fmt::format("# loss {} in bursts of {}: round trip, stiffness (numbers of ticks), number of the method\n",
                        loss.first, loss.second);
    for (const std::size_t p : places)
      data += fmt::format("{} {} {}\n", x.at(map.places[p]), y.at(map.places[p]), best[p]);
    data += "\n\n";
    const std::string title = fmt::format("loss {:g} %{}", 100.0 * loss.first,
                                          loss.second > 1.0 ? fmt::format(", bursts of {:g}", loss.second) : "");
    body += y.commands('y', 1e-3, page.at_left(i)) + page.panel(i, title, kRoundTrip, kStiffness) + "plot ";
    for (std::size_t m = 0; m <= map.methods.size(); ++m)
      body += fmt::format(
          "{}'map_best.dat' index {} using ($3 == {} ? $1 : NaN):2:($1-0.5):($1+0.5):($2-0.5):($2+0.5) with "
          "boxxyerror fs solid 1 noborder fc rgb '{}'",
          m == 0 ? "" : ", ", i, m, m == map.methods.size() ? kNoMethod : kColours[m % std::size(kColours)]);
    body += '\n';
    ++i;
  }
  write_whole(folder + "/map_best.dat", data);
  write_whole(folder + "/map_best.gp", page.pages("map_best", body));
  return run_gnuplot(folder, "map_best");
}

}  // namespace

std::string draw(const Map& map, const std::string& folder) {
  const Ticks x{map, &MapPlace::round_trip_ms}, y{map, &MapPlace::stiffness_n_per_m};
  return draw_holds(map, x, y, folder) + "\n" + draw_best(map, x, y, folder);
}

}  // namespace twoport::lab
