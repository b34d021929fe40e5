#include "lab/plot/impedance_picture.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

/// A block a place: frequency, size and phase displayed, the same of the truth, coherence.
std::string data(const std::vector<DisplayedImpedance>& all) {
  constexpr double kDegree = 180.0 / std::numbers::pi;
  std::string text;
  for (const DisplayedImpedance& z : all) {
    text += "# " + z.place + ": Hz, displayed N/m and deg, true N/m and deg, coherence\n";
    for (const ImpedanceLine& l : z.lines) {
      const double shown = std::hypot(l.displayed_re, l.displayed_im), truth = std::hypot(l.true_re, l.true_im);
      const auto known = [](double size, double value) {
        return size > 0.0 ? fmt::format("{}", value) : std::string{"NaN"};
      };
      text += fmt::format("{} {} {} {} {} {}\n", l.frequency_hz, known(shown, shown),
                          known(shown, kDegree * std::atan2(l.displayed_im, l.displayed_re)), known(truth, truth),
                          known(truth, kDegree * std::atan2(l.true_im, l.true_re)), l.coherence);
    }
    text += "\n\n";
  }
  return text;
}

}  // namespace

std::string draw(const std::vector<DisplayedImpedance>& all, const std::string& scene, const std::string& folder) {
  const std::size_t columns = all.size();
  std::string body = fmt::format("set multiplot layout 3,{} columnsfirst title {}\nset logscale x\nset format x '%g'\n",
                                 columns, gnuplot_quoted(scene + ": what the hand meets"));
  for (std::size_t i = 0; i < columns; ++i) {
    const auto curves = [&](int shown, int truth) {
      return fmt::format(
          "'impedance.dat' index {0} using 1:{1} with linespoints pt 7 ps 0.6 lw 1.5 lc rgb '{3}' title 'displayed', "
          "'' index {0} using 1:{2} with lines dt 2 lw 2 lc rgb '#404040' title 'true'\n",
          i, shown, truth, kStableColour);
    };
    // A curve of nothing but NaN leaves gnuplot without a range.
    bool any = false;
    for (const ImpedanceLine& l : all[i].lines)
      any = any || std::hypot(l.displayed_re, l.displayed_im) + std::hypot(l.true_re, l.true_im) > 0.0;
    body += fmt::format("set title {}\nset key top left inside vertical\nset xlabel ''\n",
                        gnuplot_quoted(any ? all[i].place : all[i].place + ": no force, as it should be"));
    body += any ? "set ylabel 'force / motion [N/m]'\nset logscale y\nset format y '%g'\nset autoscale y\nplot " +
                      curves(2, 4)
                : std::string{
                      "set ylabel 'force / motion [N/m]'\nset yrange [0:1]\nset xrange [0.5:50]\nplot NaN notitle\n"};
    body +=
        "unset logscale y\nset title ''\nset ylabel 'phase [deg]'\nset yrange [-180:180]\nset ytics 90\nset key off\n";
    body += any ? "plot " + curves(3, 5) : std::string{"plot NaN notitle\n"};
    body += "set ytics autofreq\nset yrange [0:1.05]\nset ylabel 'coherence'\nset xlabel 'frequency [Hz]'\n";
    body +=
        any ? fmt::format("plot 'impedance.dat' index {} using 1:6 with linespoints pt 7 ps 0.6 lw 1.5 lc rgb '{}'\n",
                          i, kStableColour)
            : std::string{"plot NaN notitle\n"};
    body += "set autoscale\nset key on\n";
  }
  body += "unset multiplot\n";
  write_whole(folder + "/impedance.dat", data(all));
  write_whole(folder + "/impedance.gp", gnuplot_pages("impedance", 120 + 420 * columns, 760, 10, body));
  return run_gnuplot(folder, "impedance");
}

}  // namespace twoport::lab
