#include "lab/paper_figures.h"

#include <fmt/format.h>

#include <iterator>
#include <numbers>

#include "common/base/file.h"
#include "common/record/metrics.h"
#include "lab/paper.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

using Eigen::Vector3d;
using Rows = std::vector<Row<3>>;
constexpr std::uint64_t kSeed = 1;  ///< of what is drawn
constexpr const char *kBlue = "#2a788e", *kRed = "#ca5a32", *kGreen = "#3b8a3b", *kGrey = "#808080", *kWall = "#e8dcc4";
const Vector3d kNormal{0.5 * std::numbers::sqrt3, 0.5, 0.0};

Rows recorded(const char* experiment, const char* method, const char* sensor = "ideal") {
  return record(paper_case(experiment, "light", sensor, method), kSeed);
}

/// Blocks of numbers, as gnuplot's `index` counts them.
class Data {
 public:
  template <class... Numbers>
  void line(const Numbers&... x) {
    ((fmt::format_to(std::back_inserter(text_), "{:.7g} ", static_cast<double>(x))), ...);
    text_ += '\n';
  }
  void gap() { text_ += '\n'; }
  void block() { text_ += "\n\n"; }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
};

void save(const std::string& folder, const std::string& name, const Data& data, std::size_t width, std::size_t height,
          const std::string& body) {
  write_whole(folder + "/" + name + ".dat", data.text());
  write_whole(folder + "/" + name + ".gp", gnuplot_pages(name, width, height, 11, body));
}

/// The flat wall seen along z, x < -y tan 30°, as the first of what is plotted.
std::string wall() {
  return fmt::format(
      "'+' using (-$1*tan(pi/6)):1 with filledcurves y1 fc rgb '{0}' notitle, "
      "'+' using (-$1*tan(pi/6)):1 with lines lw 2 lc rgb '#6b5b3a' notitle, ",
      kWall);
}

/// Forces on the hand, -f, drawn from where the tool centre point is: a vector each, every `step` ticks in contact.
void vectors(Data& data, const Rows& rows, std::size_t step, double mm_per_n) {
  for (std::size_t k = 0; k < rows.size(); k += step) {
    const Row<3>& r = rows[k];
    if (r.t_s < PaperNumbers::kFrom_s || r.master_f_wanted.squared_norm() == 0.0) continue;
    const Vector3d x = 1e3 * r.master_x.translation(), f = -mm_per_n * r.master_f.vec();
    data.line(x.x(), x.y(), f.x(), f.y());
  }
  data.block();
}

/// (a) without and (b) with multi-dof adaptation, side by side.
void force_vectors(const std::string& folder, const std::string& name, const char* experiment, double reach_mm,
                   double mm_per_n, std::size_t step) {
  Data data;
  for (const char* method : {"classic", "projected"}) vectors(data, recorded(experiment, method), step, mm_per_n);
  const double bar = 0.8 * reach_mm;
  std::string body = fmt::format(
      "set multiplot layout 1,2\nset size ratio -1\nunset key\nset xrange [{0}:{1}]\nset yrange [{0}:{1}]\n"
      "set xlabel 'x [mm]'\nset ylabel 'y [mm]'\nset trange [{0}:{1}]\n"
      "set arrow 98 from {2},{3} to {4},{3} heads size screen 0.004,90 lw 1.5 front\nset label 98 '1 N' at {5},{6} "
      "center front\n",
      -reach_mm, reach_mm, -bar, -bar, -bar + mm_per_n, -bar + 0.5 * mm_per_n, -bar + 0.07 * reach_mm);
  const char* titles[] = {"(a) without multi-dof adaptation", "(b) with multi-dof adaptation"};
  for (int i = 0; i < 2; ++i)
    body += fmt::format(
        "set title '{}'\nplot {}'{}.dat' index {} using 1:2:3:4 with vectors head size screen 0.006,20 lw 0.8 lc rgb "
        "'{}'\n",
        titles[i], wall(), name, i, i == 0 ? kRed : kBlue);
  save(folder, name, data, 1200, 620, body + "unset multiplot\n");
}

void figure_4_6(const std::string& folder) {
  // The tick of the surface following where the classic controller turns the force furthest, of those with a force
  // above 1 N that the other one would not turn about.
  const Rows rows = recorded("slide", "classic");
  double furthest = 0.0;
  Row<3> r;
  for (const Row<3>& each : rows) {
    const Vector3d &f = each.master_f.vec(), &wanted = each.master_f_wanted.vec();
    const double power = each.master_v.vec().dot(wanted), dissipated = each.master_v.vec().dot(f - wanted);
    if (each.t_s < PaperNumbers::kFrom_s || wanted.norm() < 1.0 || dissipated <= 0.0 || -dissipated / power > 0.8)
      continue;
    if (const double turned = angle(f, wanted); turned > furthest) furthest = turned, r = each;
  }

  const Vector3d v = r.master_v.vec(), f_vr = -r.master_f_wanted.vec();
  const Vector3d classic = -(r.master_f.vec() - r.master_f_wanted.vec());
  // The same energy along the force instead: α v_p, with (α v_p)·v = (α v)·v.
  const Vector3d projected = f_vr * (classic.dot(v) / f_vr.dot(v));
  Data data;
  const double speed = 1.0 / v.norm();
  for (const Vector3d& f_pc : {classic, projected}) {
    data.line(0, 0, speed * v.x(), speed * v.y());
    data.line(0, 0, f_vr.x(), f_vr.y());
    data.line(f_vr.x(), f_vr.y(), f_pc.x(), f_pc.y());
    data.line(0, 0, (f_vr + f_pc).x(), (f_vr + f_pc).y());
    data.block();
  }
  const double reach = 1.1 * std::max({f_vr.norm(), (f_vr + classic).norm(), 1.0});
  std::string body = fmt::format(
      "set multiplot layout 1,2 title 'One tick, t = {:.4f} s: v = {:.3f} m/s (drawn as 1 N), energy due {:.3g} mJ, "
      "the same in both'\n"
      "set size ratio -1\nset key inside bottom left vertical samplen 2\nset xrange [{}:{}]\nset yrange [{}:{}]\nset "
      "xlabel 'force on the hand, x [N]'\nset ylabel 'y [N]'\nset trange [{}:{}]\n",
      r.t_s, v.norm(), -1e3 * classic.dot(v) / 2000.0, -reach, reach, -reach, reach, -reach, reach);
  const char* titles[] = {"Fig. 4: standard PO/PC", "Fig. 6: multi-dof PO/PC"};
  for (int i = 0; i < 2; ++i) {
    const auto arrow = [&](int line, const char* colour, int width, const char* title) {
      return fmt::format(
          "'fig4_6.dat' index {} every ::{}::{} using 1:2:3:4 with vectors head filled size screen 0.012,18 lw {} lc "
          "rgb '{}' title '{}'",
          i, line, line, width, colour, title);
    };
    body += fmt::format("set title '{}: f_res turned by {:.1f} deg'\nplot {}{}, {}, {}, {}\n", titles[i],
                        180.0 / std::numbers::pi * angle(Vector3d{f_vr + (i == 0 ? classic : projected)}, f_vr), wall(),
                        arrow(0, kGrey, 2, "v"), arrow(3, kGreen, 5, "f_res"), arrow(1, kBlue, 2, "f_VR"),
                        arrow(2, kRed, 2, "f_PC"));
  }
  save(folder, "fig4_6", data, 1200, 660, body + "unset multiplot\n");
}

void figure_7(const std::string& folder) {
  const PaperCase which = paper_case("slide", "light", "ideal", "none");
  PaperMeter meter{paper_scene(which, kSeed)};
  Data data;
  for (const Row<3>& r : record(which, kSeed)) {
    meter.add(r);
    const Vector3d x = 1e3 * r.master_x.translation(), e = 1e3 * meter.axis_energy_j();
    data.line(r.t_s, x.x(), x.y(), e.x(), e.y(), 1e3 * r.master_energy_j);
  }
  save(
      folder, "fig7", data, 1200, 560,
      "set multiplot layout 1,2\nset size ratio -1\nset xrange [-40:40]\nset yrange [-60:60]\nset xlabel 'x [mm]'\n"
      "set ylabel 'y [mm]'\nset title 'Tool centre point, no control'\nunset key\nset trange [-60:60]\n" +
          fmt::format("plot {}'fig7.dat' using 2:3 with lines lw 0.7 lc rgb '{}'\n", wall(), kBlue) +
          "set size noratio\nset autoscale\nset xlabel 't [s]'\nset ylabel 'energy "
          "into the wall [mJ]'\nset title 'Observed energy'\nset key inside bottom left vertical\n" +
          fmt::format("plot 'fig7.dat' using 1:4 with lines lc rgb '{}' title 'x axis', '' using 1:5 with lines lc rgb "
                      "'{}' title 'y axis', '' using 1:6 with lines lw 2 lc rgb 'black' title 'total', 0 with lines dt "
                      "2 lc rgb '{}' notitle\nunset multiplot\n",
                      kBlue, kRed, kGrey));
}

void figure_10(const std::string& folder) {
  Data data;
  for (const Row<3>& r : recorded("curved", "projected")) {
    const Vector3d x = 1e3 * r.master_x.translation();
    data.line(x.x(), x.y(), x.z());
  }
  data.block();
  for (int i = -8; i <= 8; ++i) {
    for (int j = -8; j <= 8; ++j) {
      const double a = std::numbers::pi / 6 * (1.0 + i * 1.25 / 8.0);
      data.line(-60.0 * kNormal.x() + 60.0 * std::cos(a), -60.0 * kNormal.y() + 60.0 * std::sin(a), 5.0 * j);
    }
    data.gap();
  }
  save(folder, "fig10", data, 820, 680,
       "set xlabel 'x [mm]'\nset ylabel 'y [mm]'\nset zlabel 'z [mm]' rotate\nset view 64,138,1.2\nset ticslevel "
       "0\nset view "
       "equal xyz\nset title 'Surface following at a curved wall, multi-dof PO/PC'\nset key top right\n"
       "set xtics 20\nset ytics 20\nset ztics 20\n" +
           fmt::format(
               "splot 'fig10.dat' index 1 with lines lw 0.5 lc rgb '#c9b98f' title 'wall, R = 60 mm', '' index 0 "
               "with lines lw 1.5 lc rgb '{}' title 'tool centre point'\n",
               kBlue));
}

/// Tips of the force on the hand in the tangent plane of the true wall: across (e1) and along the cylinder's axis (e2).
void figure_11(const std::string& folder, const std::string& name, const char* sensor) {
  Data data;
  double rms[2];
  int i = 0;
  for (const char* method : {"classic", "projected"}) {
    RmsAndLargest tips;
    const World world{paper_scene(paper_case("curved", "light", sensor, method), kSeed).environment};
    for (const Row<3>& r : recorded("curved", method, sensor)) {
      if (r.t_s < PaperNumbers::kFrom_s || r.master_f_wanted.squared_norm() == 0.0) continue;
      const Vector3d n = signed_distance<3>(world.surfaces[0].shape, r.master_x.translation()).normal,
                     f = -r.master_f.vec();
      const Vector3d e2 = Vector3d::UnitZ(), e1 = e2.cross(n);
      data.line(f.dot(e1), f.dot(e2));
      tips.add((f - f.dot(n) * n).norm());
    }
    rms[i++] = tips.rms();
    data.block();
  }
  std::string body =
      "set multiplot layout 1,2\nset size ratio -1\nunset key\nset xrange [-0.8:0.8]\nset yrange [-0.8:0.8]\nset "
      "xlabel "
      "'across [N]'\nset ylabel 'along the axis [N]'\n";
  const char* titles[] = {"PO/PC without multi-dof adaptation", "PO/PC with multi-dof adaptation"};
  for (int k = 0; k < 2; ++k)
    body += fmt::format(
        "set title '{}: {} N rms'\nplot '{}.dat' index {} using 1:2 with points pt 7 ps 0.35 lc rgb '{}'\n", titles[k],
        rms[k] < 1e-3 ? fmt::format("{:.0e}", rms[k]) : fmt::format("{:.3f}", rms[k]), name, k, k == 0 ? kRed : kBlue);
  save(folder, name, data, 1200, 640, body + "unset multiplot\n");
}

/// The paper's future work: corrections without and with the reference energy.
void figure_reference(const std::string& folder) {
  Data data;
  for (const char* method : {"projected", "projected reference"}) {
    const World world{paper_scene(paper_case("slide", "light", "ideal", method), kSeed).environment};
    for (const Row<3>& r : recorded("slide", method))
      data.line(r.t_s, 1e3 * r.master_energy_j, 1e3 * world.surfaces[0].potential<3>(r.master_x.translation()),
                (r.master_f.vec() - r.master_f_wanted.vec()).norm());
    data.block();
  }
  std::string body = "set multiplot layout 2,2\nset xrange [0:0.5]\n";
  const char* titles[] = {"projected", "projected with reference energy and prediction"};
  for (int i = 0; i < 2; ++i)
    body += fmt::format(
        "set title '{0}'\nset ylabel 'energy [mJ]'\nunset xlabel\nset yrange [-0.2:2.2]\nset key inside top right "
        "vertical\n"
        "plot 'fig_reference.dat' index {1} using 1:3 with lines lw 2 lc rgb '{2}' title 'held by the ideal spring', "
        "'' "
        "index {1} using 1:2 with lines lc rgb '{3}' title 'through the port'\n",
        titles[i], i, "#e0b060", kBlue);
  for (int i = 0; i < 2; ++i)
    body += fmt::format(
        "unset title\nset ylabel 'correction [N]'\nset xlabel 't [s]'\nset yrange [0:1]\nunset key\n"
        "plot 'fig_reference.dat' index {} using 1:4 with lines lc rgb '{}'\n",
        i, kRed);
  save(folder, "fig_reference", data, 1200, 700, body + "unset multiplot\n");
}

/// Rendered friction: one account, or normal and tangential accounts.
void figure_hiding(const std::string& folder) {
  Data data;
  for (const char* method : {"projected reference total", "projected reference"}) {
    const PaperCase which = paper_case("friction", "light", "ideal", method);
    const Scene scene = paper_scene(which, kSeed);
    const World world{scene.environment};
    PaperMeter meter{scene};
    for (const Row<3>& r : record(which, kSeed)) {
      meter.add(r);
      data.line(r.t_s, -1e3 * signed_distance<3>(world.surfaces[0].shape, r.master_x.translation()).distance,
                1e3 * r.master_energy_j, 1e3 * meter.normal_energy_j(),
                1e3 * (r.master_energy_j - meter.normal_energy_j()));
    }
    data.block();
  }
  std::string body = "set multiplot layout 2,2\nset xrange [0:1]\n";
  const char* titles[] = {"one total account", "normal and tangential accounts"};
  for (int i = 0; i < 2; ++i)
    body += fmt::format(
        "set title '{}'\nset ylabel 'depth in the wall [mm]'\nunset xlabel\nset yrange [-4:2.5]\nunset key\n"
        "plot 0 with lines lc rgb '#6b5b3a' lw 2, 'fig_hiding.dat' index {} using 1:2 with lines lc rgb '{}'\n",
        titles[i], i, kBlue);
  for (int i = 0; i < 2; ++i)
    body += fmt::format(
        "unset title\nset ylabel 'energy [mJ]'\nset xlabel 't [s]'\nset yrange [-30:60]\nset key inside top left\n"
        "plot 'fig_hiding.dat' index {0} using 1:5 with lines lc rgb '{1}' title 'tangential', '' index {0} using 1:3 "
        "with "
        "lines lw 2 lc rgb 'black' title 'total', '' index {0} using 1:4 with lines lc rgb '{2}' title 'normal'\n",
        i, kGreen, kRed);
  save(folder, "fig_hiding", data, 1200, 700, body + "unset multiplot\n");
}

}  // namespace

std::vector<PaperFigure> paper_figures() {
  return {
      {"fig4_6", "Figs. 4 and 6, the forces of one tick", figure_4_6},
      {"fig7", "Fig. 7, contact without control", figure_7},
      {"fig8", "Fig. 8, force vectors of a point contact",
       [](const std::string& f) { force_vectors(f, "fig8", "point", 1.6, 0.4, 40); }},
      {"fig9", "Fig. 9, force vectors of surface following",
       [](const std::string& f) { force_vectors(f, "fig9", "slide", 70.0, 10.0, 30); }},
      {"fig10", "Fig. 10, path on a curved wall", figure_10},
      {"fig11", "Fig. 11, force tips in the tangent plane",
       [](const std::string& f) { figure_11(f, "fig11", "ideal"); }},
      {"fig11_encoder", "Fig. 11 with an encoder",
       [](const std::string& f) { figure_11(f, "fig11_encoder", "encoder"); }},
      {"fig_reference", "the reference energy", figure_reference},
      {"fig_hiding", "friction hides energy", figure_hiding},
  };
}

}  // namespace twoport::lab
