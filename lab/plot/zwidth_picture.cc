#include "lab/plot/zwidth_picture.h"

#include <fmt/format.h>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"
#include "lab/plot/page.h"
#include "lab/plot/scale.h"

namespace twoport::lab {

std::string draw(const ZWidth& z, const std::string& folder) {
  const Scale damping{z.table.axes[0]}, stiffness{z.table.axes[1]};
  std::string data;
  for (std::size_t m = 0; m < z.methods.size(); ++m) {
    data += fmt::format("# {}: damping [N s/m], stiffness [N/m], stable\n", z.methods[m]);
    for (std::size_t i = m; i < z.table.rows.size(); i += z.methods.size())
      data += fmt::format("{} {} {}\n", z.table.rows[i][0], z.table.rows[i][1], z.table.rows[i][z.stable_column]);
    data += "\n\n";
  }
  data += "# eigenvalues, without a controller: damping, stiffness\n";
  for (const auto& [b, k] : z.border) data += fmt::format("{} {}\n", b, k);

  using Mark = LegendEntry::Mark;
  Page page{z.scene + ": stiffness and damping that are displayed stably",
            {{Mark::dot, kStableColour, "stable"},
             {Mark::dot, kUnstableColour, "unstable"},
             {Mark::line, "black", "limit by eigenvalues, without a controller"}}};
  page.panels(z.methods.size());
  std::string body = damping.commands('x');
  for (std::size_t m = 0; m < z.methods.size(); ++m) {
    const auto dots = [&](const char* verdict, const char* colour) {
      return fmt::format("'zwidth.dat' index {} using ($3 == {} ? $1 : NaN):2 with points pt 7 ps 0.8 lc rgb '{}', ", m,
                         verdict, colour);
    };
    body += stiffness.commands('y', page.at_left(m)) + page.panel(m, z.methods[m], damping.label(), stiffness.label());
    body += "plot " + dots("1", kStableColour) + dots("0", kUnstableColour);
    body += fmt::format("'zwidth.dat' index {} with lines lw 2 lc rgb 'black'\n", z.methods.size());
  }
  write_whole(folder + "/zwidth.dat", data);
  write_whole(folder + "/zwidth.gp", page.pages("zwidth", body));
  return run_gnuplot(folder, "zwidth");
}

}  // namespace twoport::lab
