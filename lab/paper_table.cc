#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/record/metrics.h"
#include "lab/paper.h"

namespace twoport::lab {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr PaperReported kNothing{kNone, kNone, kNone, kNone, kNone, kNone, kNone};

struct Known {
  std::string_view experiment, sensor, method;
  PaperReported numbers;
};
constexpr Known kKnown[] = {
    {"point", "ideal", "none", {-0.125, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"point", "ideal", "classic", {-8.6e-5, 10.8, 176, 0.082, 0.53, kNone, kNone}},
    {"point", "ideal", "projected no clamp", {-7.8e-5, kNone, 180, 0, 0, kNone, 10.0 / 7400}},
    {"point", "ideal", "projected", {-9.1e-5, 0, 0, 0, 0, kNone, 0}},
    {"slide", "ideal", "none", {-0.125, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "ideal", "classic literal", {-2.5e-4, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "ideal", "projected literal", {-3.8e-4, kNone, kNone, kNone, kNone, kNone, 0.18}},
    {"slide", "ideal", "classic", {-1.2e-4, 30.1, 178, 0.129, 0.76, kNone, kNone}},
    {"slide", "ideal", "projected no clamp", {-7.8e-5, kNone, 180, 0, 0, kNone, kNone}},
    {"slide", "ideal", "projected", {-9.1e-5, 0, 0, 0, 0, 0.8, 0}},
    {"slide", "ideal", "projected predict", {-3.3e-6, 0, 0, 0, 0, 1.5, 0}},
    {"slide", "ideal", "projected reference no prediction", {-8.7e-6, 0, 0, 0, 0, kNone, 0}},
    {"slide", "ideal", "projected reference", {-6.9e-8, 0, 0, 0, 0, 0.105, 0}},
    {"slide", "ideal", "projected reference uncapped", {-6.9e-8, 0, 0, 0, 0, 0.105, 0}},
    {"curved", "ideal", "none", {-0.120, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "ideal", "classic", {-1.0e-4, 29.3, 177, 0.127, 0.73, kNone, kNone}},
    {"curved", "ideal", "projected", {-6.1e-5, 0, 0, 0, 0, kNone, 0}},
    {"point", "encoder", "none", {-0.071, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"point", "encoder", "classic", {-2.6e-5, 3.0, 20, 0.088, 0.50, kNone, kNone}},
    {"point", "encoder", "projected", {-2.4e-5, 3.5e-7, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "none", {-0.082, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "projected literal", {-7.7e-3, kNone, kNone, kNone, kNone, kNone, 0.49}},
    {"slide", "encoder", "classic", {-6.5e-5, 10.0, 168, 0.085, 0.81, kNone, kNone}},
    {"slide", "encoder", "projected", {-5.8e-5, 3.7e-7, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "projected reference uncapped", {-1.2e-2, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "encoder", "none", {-0.073, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "encoder", "classic", {-1.0e-5, 10.2, 130, 0.096, 0.72, kNone, kNone}},
    {"curved", "encoder", "projected", {-1.1e-5, 4e-7, kNone, kNone, kNone, kNone, kNone}},
};

double share(std::uint64_t part, std::uint64_t of) {
  return of > 0 ? static_cast<double>(part) / static_cast<double>(of) : 0.0;
}

/// "-1.2e-04", "0", or "·" for an unknown value.
std::string small(double x) {
  if (std::isnan(x)) return "·";
  return x == 0.0 ? "0" : fmt::format("{:.1e}", x);
}
std::string plain(double x) {
  if (std::isnan(x)) return "·";
  if (x == 0.0) return "0";
  return std::abs(x) < 1e-3 ? fmt::format("{:.0e}", x) : fmt::format("{:.3g}", x);
}
std::string percent(double x) {
  return std::isnan(x) ? "·" : fmt::format("{:.1f} %", 100.0 * x);
}
std::string pair(double a, double b) {
  return fmt::format("{} / {}", plain(a), plain(b));
}

/// Cells beneath a head, each column as wide as it needs.
class TextTable {
 public:
  explicit TextTable(std::vector<std::string> head) { lines_.push_back(std::move(head)); }
  void add(std::vector<std::string> cells) { lines_.push_back(std::move(cells)); }
  [[nodiscard]] std::string text() const {
    std::vector<std::size_t> width(lines_[0].size());
    for (const auto& line : lines_)
      for (std::size_t i = 0; i < line.size(); ++i) width[i] = std::max(width[i], letters(line[i]));
    std::string out;
    for (const auto& line : lines_) {
      std::string row = " ";
      for (std::size_t i = 0; i < line.size(); ++i)
        row += fmt::format(" {}{:{}}", line[i], "", width[i] - letters(line[i]) + 1);
      row.erase(row.find_last_not_of(' ') + 1);
      out += row + "\n";
    }
    return out;
  }

 private:
  static std::size_t letters(const std::string& s) {
    return static_cast<std::size_t>(std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xc0) != 0x80; }));
  }
  std::vector<std::vector<std::string>> lines_;
};

/// What a controller used; an encoder's velocity is another than the true one.
double gain(const PaperResult& of) {
  const bool known = of.which.sensor == "ideal" && of.which.method != "none";
  return known ? of.numbers.max_gain_n_s_per_m : kNone;
}

/// Numbers of a case as figures.csv names them.
std::vector<std::pair<const char*, double>> columns(const PaperResult& of) {
  const PaperNumbers& n = of.numbers;
  const PaperReported known = paper_reported(of.which);
  return {{"min_energy_j", n.min_energy_j},
          {"reported_min_energy_j", known.min_energy_j},
          {"min_surplus_j", n.min_surplus_j},
          {"min_normal_energy_j", n.min_normal_energy_j},
          {"energy_x_j", n.axis_energy_j[0]},
          {"energy_y_j", n.axis_energy_j[1]},
          {"energy_z_j", n.axis_energy_j[2]},
          {"energy_j", n.energy_j},
          {"energy_x_at_1s_j", n.axis_energy_at_1s_j[0]},
          {"energy_y_at_1s_j", n.axis_energy_at_1s_j[1]},
          {"energy_z_at_1s_j", n.axis_energy_at_1s_j[2]},
          {"direction_rms_deg", n.direction_deg.rms()},
          {"reported_direction_rms_deg", known.direction_rms_deg},
          {"direction_max_deg", n.direction_deg.max},
          {"reported_direction_max_deg", known.direction_max_deg},
          {"normal_direction_rms_deg", n.normal_direction_deg.rms()},
          {"normal_direction_max_deg", n.normal_direction_deg.max},
          {"tip_rms_n", n.tip_n.rms()},
          {"reported_tip_rms_n", known.tip_rms_n},
          {"tip_max_n", n.tip_n.max},
          {"reported_tip_max_n", known.tip_max_n},
          {"correction_mean_n", n.mean_correction_n},
          {"correction_max_n", n.max_correction_n},
          {"reported_correction_max_n", known.correction_max_n},
          {"max_gain_n_s_per_m", gain(of)},
          {"pulling_share", share(n.pulling_ticks, n.contact_ticks)},
          {"reported_pulling_share", known.pulling_share},
          {"saturated_share", share(n.saturated_ticks, n.contact_ticks)},
          {"contact_share", share(n.contact_ticks, n.ticks)},
          {"free_air_ticks", static_cast<double>(n.free_air_ticks)},
          {"max_depth_m", n.max_depth_m},
          {"speed_rms_m_per_s", n.speed_m_per_s.rms()}};
}

/// The paper's claims with the computed numbers, in sentences.
std::string words(const PaperTable& t) {
  const auto light = [&](const char* experiment, const char* method, const char* sensor = "ideal") -> decltype(auto) {
    return t.at(experiment, "light", sensor, method);
  };
  const PaperNumbers &none = light("slide", "none"), &point = light("point", "classic"),
                     &slide = light("slide", "classic"), &curved = light("curved", "classic"),
                     &literal = light("slide", "projected literal"), &added = light("slide", "projected reference"),
                     &eq2 = light("slide", "projected eq. 2"), &hidden = light("friction", "projected reference total"),
                     &apart = light("friction", "projected reference");
  double straightest = 0.0;
  for (const char* experiment : {"point", "slide", "curved"})
    for (const char* sensor : {"ideal", "encoder"})
      straightest = std::max(straightest, light(experiment, "projected", sensor).direction_deg.max);
  return fmt::format(
      "Summary\n"
      "  Without control the wall generates {:.3f} J in 4 s and chatters {:.1f} mm deep (Fig. 7).\n"
      "  Damping along the velocity turns the force by {:.0f} deg rms when pressing, {:.0f} when sliding, {:.0f} on a "
      "curved wall\n"
      "  (Figs. 8, 9, 11); the hand's threshold for force direction is 18 to 32 deg.\n"
      "  Damping along the force turns it by at most {:.0e} deg, with an ideal sensor and with an encoder.\n"
      "  The paper's equations without a bound pull the hand into the wall in {:.0f} % of contact; with its literal "
      "eq. (2)\n"
      "  nothing is observed and the wall generates {:.3f} J.\n"
      "  With reference energy, prediction and a force that never pulls, corrections are at most {:.3f} N, and the "
      "port energy\n"
      "  is at most {:.1e} J below that of an ideal spring.\n"
      "  Rendered friction hides {:.2f} J from one total account: the wall chatters {:.2f} mm deep. With an account "
      "for the normal\n"
      "  force the depth is {:.2f} mm.\n",
      -none.min_energy_j, 1e3 * none.max_depth_m, point.direction_deg.rms(), slide.direction_deg.rms(),
      curved.direction_deg.rms(), straightest, 100.0 * share(literal.pulling_ticks, literal.contact_ticks),
      -eq2.min_energy_j, added.max_correction_n, -added.min_surplus_j, -hidden.min_normal_energy_j,
      1e3 * hidden.max_depth_m, 1e3 * apart.max_depth_m);
}

using Eigen::Vector3d;
using Rows = std::vector<Row<3>>;
constexpr std::uint64_t kSeed = 1;  ///< of what is drawn
constexpr const char *kBlue = "#2a788e", *kRed = "#ca5a32", *kGreen = "#3b8a3b", *kGrey = "#808080", *kWall = "#e8dcc4";
const Vector3d kNormal{0.5 * std::numbers::sqrt3, 0.5, 0.0};

Rows recorded(const char* experiment, const char* method, const char* sensor = "ideal") {
  return record(paper_case(experiment, "light", sensor, method), kSeed);
}
/// Is the tool in contact, after what the start leaves?
bool counts(const Row<3>& r) {
  return r.t_s >= PaperNumbers::kFrom_s && r.master_f_wanted.squared_norm() > 0.0;
}

Scale between(Label label, double low, double high) {
  return {.label = std::move(label), .low = low, .high = high};
}

/// The flat wall seen along z, x < -y tan 30°, between axes that reach from -reach to reach: the first of what is plotted.
std::vector<Series> wall(double reach) {
  const double x = reach * std::tan(std::numbers::pi / 6);
  Series inside{Look::area, kWall, "wall"}, surface{Look::line, "#6b5b3a", "", 2.0};
  for (const auto& [a, b] : {std::pair{-x, reach}, {x, -reach}, {-reach, -reach}, {-reach, reach}}) inside.add({a, b});
  surface.add({-x, reach}), surface.add({x, -reach});
  return {inside, surface};
}

/// (a) without and (b) with multi-dof adaptation, side by side: forces on the hand, -f, drawn from where the tool centre point is, every
/// `step` ticks in contact.
Picture force_vectors(const char* name, const char* title, const char* experiment, double reach_mm, double mm_per_n,
                      std::size_t step) {
  Picture picture{.name = name, .title = title, .panel = {500, 500}};
  for (const bool adapted : {false, true}) {
    Panel panel{.title = adapted ? "(b) with multi-dof adaptation" : "(a) without multi-dof adaptation",
                .x = between({"x", "mm"}, -reach_mm, reach_mm),
                .y = between({"y", "mm"}, -reach_mm, reach_mm),
                .series = wall(reach_mm),
                .equal = true};
    Series forces{Look::arrows, adapted ? kBlue : kRed, "", 0.8}, bar{Look::strokes, "black", "", 2.0},
        words{Look::words, "black", "", 10.0};
    const Rows rows = recorded(experiment, adapted ? "projected" : "classic");
    for (std::size_t k = 0; k < rows.size(); k += step) {
      if (!counts(rows[k])) continue;
      const Vector3d x = 1e3 * rows[k].master_x.translation(), f = -mm_per_n * rows[k].master_f.vec();
      forces.add({x.x(), x.y(), f.x(), f.y()});
    }
    const double at = -0.8 * reach_mm;
    bar.add({at, at, mm_per_n, 0.0});
    words.add_text(at + 0.5 * mm_per_n, at + 0.07 * reach_mm, "1 N");
    panel.series.insert(panel.series.end(), {forces, bar, words});
    picture.panels.push_back(std::move(panel));
  }
  return picture;
}

Picture figure_4_6() {
  // The tick of the surface following where the classic controller turns the force furthest, of those with a force
  // above 1 N that the other one would not turn about.
  double furthest = 0.0;
  Row<3> r;
  for (const Row<3>& each : recorded("slide", "classic")) {
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
  const double reach = 1.1 * std::max({f_vr.norm(), (f_vr + classic).norm(), 1.0});
  Picture picture{.name = "fig4_6",
                  .title = fmt::format(
                      "One tick, t = {:.4f} s: v = {:.3f} m/s (drawn as 1 N), energy due {:.3g} mJ, the same in both",
                      r.t_s, v.norm(), -1e3 * classic.dot(v) / 2000.0),
                  .panel = {500, 500}};
  for (const bool multi : {false, true}) {
    const Vector3d f_pc = multi ? projected : classic, f_res = f_vr + f_pc;
    const auto arrow = [](const char* colour, double size, const char* name, const Vector3d& from, const Vector3d& f) {
      Series s{Look::arrows, colour, name, size};
      s.add({from.x(), from.y(), f.x(), f.y()});
      return s;
    };
    const Vector3d origin = Vector3d::Zero();
    Panel panel{.title = fmt::format("{}: f_res turned by {:.1f} deg",
                                     multi ? "Fig. 6: multi-dof PO/PC" : "Fig. 4: standard PO/PC",
                                     180.0 / std::numbers::pi * angle(f_res, f_vr)),
                .x = between({"force on the hand, x", "N"}, -reach, reach),
                .y = between({"y", "N"}, -reach, reach),
                .series = wall(reach),
                .equal = true};
    panel.series.insert(panel.series.end(),
                        {arrow(kGrey, 2.0, "v", origin, v / v.norm()), arrow(kGreen, 5.0, "f_res", origin, f_res),
                         arrow(kBlue, 2.0, "f_VR", origin, f_vr), arrow(kRed, 2.0, "f_PC", f_vr, f_pc)});
    picture.panels.push_back(std::move(panel));
  }
  return picture;
}

Picture figure_7() {
  const PaperCase which = paper_case("slide", "light", "ideal", "none");
  PaperMeter meter{paper_scene(which, kSeed)};
  Series path{Look::line, kBlue, "tool centre point", 0.7}, x_axis{Look::line, kBlue, "energy, x axis", 1.0},
      y_axis{Look::line, kRed, "y axis", 1.0}, total{Look::line, "black", "total", 2.0}, zero{Look::dashes, kGrey};
  double end_s = 0.0;
  for (const Row<3>& r : record(which, kSeed)) {
    meter.add(r);
    const Vector3d x = 1e3 * r.master_x.translation(), e = 1e3 * meter.axis_energy_j();
    path.add({x.x(), x.y()});
    x_axis.add({r.t_s, e.x()}), y_axis.add({r.t_s, e.y()}), total.add({r.t_s, 1e3 * r.master_energy_j});
    end_s = r.t_s;
  }
  zero.add({0.0, 0.0}), zero.add({end_s, 0.0});
  Panel plane{.title = "Tool centre point, no control",
              .x = between({"x", "mm"}, -60.0, 60.0),
              .y = between({"y", "mm"}, -60.0, 60.0),
              .series = wall(60.0),
              .equal = true};
  plane.series.push_back(path);
  return {.name = "fig7",
          .title = "Contact without control",
          .panels = {plane,
                     {.title = "Observed energy",
                      .x = between({"t", "s"}, 0.0, end_s),
                      .y = between({"energy into the wall", "mJ"}, -140.0, 60.0),
                      .series = {x_axis, y_axis, total, zero}}},
          .panel = {480, 480}};
}

Picture figure_10() {
  Series path{Look::line, kBlue, "tool centre point"}, mesh{Look::line, "#c9b98f", "wall, R = 60 mm", 0.5};
  for (const Row<3>& r : recorded("curved", "projected")) {
    const Vector3d x = 1e3 * r.master_x.translation();
    path.add({x.x(), x.y(), x.z()});
  }
  for (int i = -8; i <= 8; ++i) {
    for (int j = -8; j <= 8; ++j) {
      const double a = std::numbers::pi / 6 * (1.0 + i * 1.25 / 8.0);
      mesh.add({-60.0 * kNormal.x() + 60.0 * std::cos(a), -60.0 * kNormal.y() + 60.0 * std::sin(a), 5.0 * j});
    }
    mesh.interrupt();
  }
  return {.name = "fig10",
          .title = "Surface following at a curved wall, multi-dof PO/PC",
          .panels = {{.title = "",
                      .x = {.label = {"x", "mm"},
                            .low = -30.0,
                            .high = 10.0,
                            .ticks = {{-30, "-30"}, {-20, "-20"}, {-10, "-10"}, {0, "0"}, {10, "10"}}},
                      .y = between({"y", "mm"}, -40.0, 30.0),
                      .series = {mesh, path},
                      .z = between({"z", "mm"}, -40.0, 40.0),
                      .view_deg = {64.0, 138.0}}},
          .panel = {720, 520}};
}

/// Tips of the force on the hand in the tangent plane of the true wall: across (e1) and along the cylinder's axis (e2).
Picture figure_11(const char* name, const char* title, const char* sensor) {
  Picture picture{.name = name, .title = title, .panel = {480, 480}};
  for (const bool multi : {false, true}) {
    const char* const method = multi ? "projected" : "classic";
    RmsAndLargest tips;
    Series dots{Look::dots, multi ? kBlue : kRed, "", 0.35};
    const World world{paper_scene(paper_case("curved", "light", sensor, method), kSeed).environment};
    for (const Row<3>& r : recorded("curved", method, sensor)) {
      if (!counts(r)) continue;
      const Vector3d n = signed_distance<3>(world.surfaces[0].shape, r.master_x.translation()).normal,
                     f = -r.master_f.vec();
      const Vector3d e2 = Vector3d::UnitZ(), e1 = e2.cross(n);
      dots.add({f.dot(e1), f.dot(e2)});
      tips.add((f - f.dot(n) * n).norm());
    }
    const double rms = tips.rms();
    picture.panels.push_back(
        {.title = fmt::format("PO/PC {} multi-dof adaptation: {} N rms", multi ? "with" : "without",
                              rms < 1e-3 ? fmt::format("{:.0e}", rms) : fmt::format("{:.3f}", rms)),
         .x = between({"across", "N"}, -0.8, 0.8),
         .y = between({"along the axis", "N"}, -0.8, 0.8),
         .series = {dots},
         .equal = true});
  }
  return picture;
}

/// The paper's future work: corrections without and with the reference energy.
Picture figure_reference() {
  Picture picture{.name = "fig_reference", .title = "Reference energy", .across = 2, .panel = {500, 250}};
  std::vector<Panel> corrections;
  for (const char* method : {"projected", "projected reference"}) {
    const World world{paper_scene(paper_case("slide", "light", "ideal", method), kSeed).environment};
    Series spring{Look::line, "#e0b060", "held by the ideal spring", 2.0},
        port{Look::line, kBlue, "through the port", 1.0}, correction{Look::line, kRed, "correction", 1.0};
    for (const Row<3>& r : recorded("slide", method)) {
      if (r.t_s > 0.5) break;
      spring.add({r.t_s, 1e3 * world.surfaces[0].potential<3>(r.master_x.translation())});
      port.add({r.t_s, 1e3 * r.master_energy_j});
      correction.add({r.t_s, (r.master_f.vec() - r.master_f_wanted.vec()).norm()});
    }
    const bool with = picture.panels.size() == 1;
    picture.panels.push_back({.title = with ? "projected with reference energy and prediction" : "projected",
                              .x = between({"t", "s"}, 0.0, 0.5),
                              .y = between({"energy", "mJ"}, -0.2, 2.2),
                              .series = {spring, port}});
    corrections.push_back({.title = "",
                           .x = between({"t", "s"}, 0.0, 0.5),
                           .y = between({"correction", "N"}, 0.0, 1.0),
                           .series = {correction}});
  }
  picture.panels.insert(picture.panels.end(), corrections.begin(), corrections.end());
  return picture;
}

/// Rendered friction: one account, or normal and tangential accounts.
Picture figure_hiding() {
  Picture picture{.name = "fig_hiding", .title = "Friction hides energy", .across = 2, .panel = {500, 250}};
  std::vector<Panel> energies;
  for (const char* method : {"projected reference total", "projected reference"}) {
    const PaperCase which = paper_case("friction", "light", "ideal", method);
    const Scene scene = paper_scene(which, kSeed);
    const World world{scene.environment};
    PaperMeter meter{scene};
    Series surface{Look::line, "#6b5b3a", "surface", 2.0}, depth{Look::line, kBlue, "tool centre point", 1.0},
        tangential{Look::line, kGreen, "tangential", 1.0}, total{Look::line, "black", "total", 2.0},
        normal{Look::line, kRed, "normal", 1.0};
    surface.add({0.0, 0.0}), surface.add({1.0, 0.0});
    for (const Row<3>& r : record(which, kSeed)) {
      if (r.t_s > 1.0) break;
      meter.add(r);
      depth.add({r.t_s, -1e3 * signed_distance<3>(world.surfaces[0].shape, r.master_x.translation()).distance});
      total.add({r.t_s, 1e3 * r.master_energy_j});
      normal.add({r.t_s, 1e3 * meter.normal_energy_j()});
      tangential.add({r.t_s, 1e3 * (r.master_energy_j - meter.normal_energy_j())});
    }
    const bool apart = picture.panels.size() == 1;
    picture.panels.push_back({.title = apart ? "normal and tangential accounts" : "one total account",
                              .x = between({"t", "s"}, 0.0, 1.0),
                              .y = between({"depth in the wall", "mm"}, -4.0, 2.5),
                              .series = {surface, depth}});
    energies.push_back({.title = "",
                        .x = between({"t", "s"}, 0.0, 1.0),
                        .y = between({"energy", "mJ"}, -30.0, 60.0),
                        .series = {tangential, total, normal}});
  }
  picture.panels.insert(picture.panels.end(), energies.begin(), energies.end());
  return picture;
}

}  // namespace

PaperReported paper_reported(const PaperCase& which) {
  for (const Known& k : kKnown)
    if (which.hand == "light" && k.experiment == which.experiment && k.sensor == which.sensor &&
        k.method == which.method)
      return k.numbers;
  return kNothing;
}

const PaperNumbers& PaperTable::at(const std::string& experiment, const std::string& hand, const std::string& sensor,
                                   const std::string& method) const {
  for (const PaperResult& r : results)
    if (r.which.experiment == experiment && r.which.hand == hand && r.which.sensor == sensor &&
        r.which.method == method)
      return r.numbers;
  throw ConfigError{fmt::format("no such case: {}, {}, {}, {}", experiment, hand, sensor, method)};
}

std::string paper_csv(const PaperTable& table) {
  std::string out = "experiment,hand,sensor,method,seeds";
  for (const auto& [name, value] : columns({})) out.append(1, ',').append(name);
  out += ",set\n";
  for (const PaperResult& each : table.results) {
    const auto& [c, n] = each;
    out += fmt::format("{},{},{},{},{}", c.experiment, c.hand, c.sensor, c.method, n.seeds);
    for (const auto& [name, value] : columns(each)) out += std::isnan(value) ? "," : fmt::format(",{:.9g}", value);
    out += fmt::format(",\"{}\"\n", fmt::join(c.set, " "));
  }
  return out;
}

std::string paper_text(const PaperTable& table) {
  std::string out;
  const auto experiment = [&](const char* title, const std::string& name, const std::string& sensor) {
    out += fmt::format("\n{}\n", title);
    TextTable grid{{"method", "worst port energy [J]", "reported", "direction error rms / max [deg]", "reported",
                    "tangential tip rms / max [N]", "reported", "largest correction [N]", "reported", "pulls",
                    "reported", "contact"}};
    for (const auto& [c, n] : table.results) {
      if (c.experiment != name || c.sensor != sensor || c.hand != "light") continue;
      const PaperReported known = paper_reported(c);
      grid.add({c.method, small(n.min_energy_j), small(known.min_energy_j),
                pair(n.direction_deg.rms(), n.direction_deg.max),
                pair(known.direction_rms_deg, known.direction_max_deg), pair(n.tip_n.rms(), n.tip_n.max),
                pair(known.tip_rms_n, known.tip_max_n), plain(n.max_correction_n), plain(known.correction_max_n),
                percent(share(n.pulling_ticks, n.contact_ticks)), percent(known.pulling_share),
                fmt::format("{:.0f} %", 100.0 * share(n.contact_ticks, n.ticks))});
    }
    out += grid.text();
  };
  experiment("Point contact (Fig. 8), ideal sensor", "point", "ideal");
  experiment("Surface following (Fig. 9), ideal sensor", "slide", "ideal");
  experiment("Curved wall (Figs. 10, 11), ideal sensor", "curved", "ideal");
  experiment("Point contact, encoder of 30 um, Coulomb friction 0.04 N, velocity through 150 Hz", "point", "encoder");
  experiment("Surface following, encoder", "slide", "encoder");
  experiment("Curved wall, encoder", "curved", "encoder");

  out += "\nEnergy by axis after 1 s without control (Fig. 7): the sum is physical, its parts depend on the axes [J]\n";
  TextTable axes{{"experiment", "hand", "x", "y", "z", "sum", "reported x, y, sum"}};
  const auto by_axis = [&](const char* name, const char* hand, const char* reported) {
    const auto& e = table.at(name, hand, "ideal", "none").axis_energy_at_1s_j;
    axes.add({name, hand, fmt::format("{:+.4f}", e[0]), fmt::format("{:+.4f}", e[1]), fmt::format("{:+.4f}", e[2]),
              fmt::format("{:+.4f}", e[0] + e[1] + e[2]), reported});
  };
  by_axis("point", "light", "·, ·, -0.0082");
  by_axis("slide", "light", "+0.0141, -0.0223, -0.0082");
  by_axis("slide", "medium", "·");
  by_axis("slide", "firm", "+0.038, -0.037, +0.0016");
  out += axes.text();

  out += "\nOther hands, surface following, ideal sensor\n";
  TextTable hands{{"hand", "method", "worst port energy [J]", "direction error rms / max [deg]",
                   "largest correction [N]", "deepest [mm]"}};
  for (const auto& [c, n] : table.results)
    if (c.experiment == "slide" && c.hand != "light")
      hands.add({c.hand, c.method, small(n.min_energy_j), pair(n.direction_deg.rms(), n.direction_deg.max),
                 plain(n.max_correction_n), fmt::format("{:.2f}", 1e3 * n.max_depth_m)});
  out += hands.text();

  out +=
      "\nApproach of the hand, surface following: gentle in 0.3 s, at once (as above), or with impact, from 10 mm "
      "outside in 0.1 s\n";
  TextTable arrivals{{"approach", "sensor", "method", "worst port energy [J]", "below the ideal spring [J]",
                      "direction error rms / max [deg]", "largest correction [N]", "largest gain [N s/m]", "pulls"}};
  for (const auto& [c, n] : table.results) {
    static constexpr std::string_view kShown[] = {"none", "classic", "projected no clamp", "projected",
                                                  "projected reference"};
    const bool shown = std::find(std::begin(kShown), std::end(kShown), c.method) != std::end(kShown);
    if (!c.experiment.starts_with("slide") || c.hand != "light" || !shown) continue;
    arrivals.add({c.experiment == "slide" ? "at once" : c.experiment.substr(6), c.sensor, c.method,
                  small(n.min_energy_j), small(n.min_surplus_j), pair(n.direction_deg.rms(), n.direction_deg.max),
                  plain(n.max_correction_n), plain(gain({c, n})), percent(share(n.pulling_ticks, n.contact_ticks))});
  }
  out += arrivals.text();

  out +=
      "\nFriction 0.3 rendered in the wall: one total account hides the energy of the wall, an account for the normal "
      "force does not.\nReported: 2.04 mm and 0.311 m/s with the total, 0.67 mm, 0.135 m/s and -7e-8 J with two "
      "accounts\n";
  TextTable friction{{"sensor", "method", "worst port energy [J]", "worst normal energy [J]", "deepest [mm]",
                      "speed rms [m/s]", "direction error rms / max [deg]"}};
  for (const auto& [c, n] : table.results)
    if (c.experiment == "friction")
      friction.add({c.sensor, c.method, small(n.min_energy_j), small(n.min_normal_energy_j),
                    fmt::format("{:.2f}", 1e3 * n.max_depth_m), fmt::format("{:.3f}", n.speed_m_per_s.rms()),
                    pair(n.direction_deg.rms(), n.direction_deg.max)});
  out += friction.text();

  out += "\nAdmittance causality (Fig. 2): a virtual mass with velocity as output, held by a firm grip\n";
  TextTable admittance{{"method", "worst port energy [J]", "fastest [m/s]", "velocity turned rms / max [deg]",
                        "largest correction [m/s]"}};
  for (const AdmittanceRun& r : table.admittance)
    admittance.add({r.method, small(r.min_energy_j),
                    plain(r.most_speed_m_per_s) +
                        (r.stopped_at_s > 0.0 ? fmt::format(", stopped at {:.2f} s", r.stopped_at_s) : ""),
                    pair(r.direction_deg.rms(), r.direction_deg.max), plain(r.correction_m_per_s.max)});
  out += admittance.text();

  out += "\nIndependence of the frame: surface following without tremor\n";
  TextTable frames{{"method", "new frame each tick: energy [relative]", "force [of the largest]",
                    "world turned: energy [J]", "path [m]"}};
  for (const FrameCheck& f : table.frames)
    frames.add({f.method, small(f.energy_per_tick_frames), small(f.force_per_tick_frames), small(f.energy_turned_world),
                small(f.path_turned_world_m)});
  out += frames.text();
  return out + "\n" + words(table);
}

std::vector<PaperFigure> paper_figures() {
  return {
      {"fig4_6", "Figs. 4 and 6, the forces of one tick", figure_4_6},
      {"fig7", "Fig. 7, contact without control", figure_7},
      {"fig8", "Fig. 8, force vectors of a point contact",
       [] { return force_vectors("fig8", "Force on the hand, point contact", "point", 1.8, 0.4, 40); }},
      {"fig9", "Fig. 9, force vectors of surface following",
       [] { return force_vectors("fig9", "Force on the hand, surface following", "slide", 70.0, 10.0, 30); }},
      {"fig10", "Fig. 10, path on a curved wall", figure_10},
      {"fig11", "Fig. 11, force tips in the tangent plane",
       [] { return figure_11("fig11", "Tips of the force in the tangent plane", "ideal"); }},
      {"fig11_encoder", "Fig. 11 with an encoder",
       [] { return figure_11("fig11_encoder", "Tips of the force in the tangent plane, with an encoder", "encoder"); }},
      {"fig_reference", "the reference energy", figure_reference},
      {"fig_hiding", "friction hides energy", figure_hiding},
  };
}

}  // namespace twoport::lab
