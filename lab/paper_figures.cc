#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/record/metrics.h"
#include "lab/paper.h"

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
