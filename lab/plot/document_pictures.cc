#include "lab/plot/document_pictures.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "common/scene/find.h"
#include "common/scene/load.h"
#include "lab/plot/picture.h"
#include "lab/plot/trace.h"
#include "lab/run.h"
#include "lab/study/many_runs.h"

namespace twoport::lab {
namespace {

using Eigen::Vector3d;
constexpr double kMm = 1e3;

}  // namespace

std::string draw_deadband(const std::string& folder, int jobs) {
  // Ratio and floor of the position grow together, 2 mm at a ratio of 1; silence 50 ms.
  const std::string file = scene_file("edge/deadband");
  const std::vector<std::pair<const char*, const char*>> methods{{"INTERNAL_MODEL", "#2a788e"},
                                                                 {"ENERGY_TANK", "#ca5a32"},
                                                                 {"WAVE_VARIABLES", "#7a5195"},
                                                                 {"FIXED_DAMPING", "#58a45c"},
                                                                 {"FORCE_PROJECTED", "#d9a441"}};
  const std::vector<double> ratios{0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8};
  const auto scene_of = [&](std::size_t i) {
    const double ratio = ratios[i % ratios.size()];
    const std::string band =
        ratio > 0.0 ? fmt::format("deadband {{ ratio: {} position_m: {} silence_ms: 50 }}", ratio, 0.002 * ratio) : "";
    const std::string link = fmt::format("={{ delay_ms: 25 {} }}", band);
    return load_scene(file, std::vector{std::string{"control.passivity.method="} + methods[i / ratios.size()].first,
                                        "to_slave" + link, "to_master" + link});
  };
  std::vector<Summary> summaries(methods.size() * ratios.size());
  Tally tally{summaries.size(), {}};
  run_cells(
      {summaries.size(), 1, scene_of}, {.jobs = jobs}, tally,
      [&](std::size_t i, std::uint64_t, const std::vector<Summary>& of_seeds) { summaries[i] = of_seeds.front(); });
  Panel panel{
      .title = "",
      .x = {.label = {"packets a second, both directions", ""}, .low = 40.0, .high = 3000.0, .logarithmic = true},
      .y = {.label = {"felt-force error in contact, rms", "N"}}};
  for (std::size_t m = 0; m < methods.size(); ++m) {
    Series curve{Look::joined_dots, methods[m].second, methods[m].first, 2.0};
    for (std::size_t r = 0; r < ratios.size(); ++r) {
      const Summary& s = summaries[m * ratios.size() + r];
      curve.add({(s.packets().to_slave().sent() + s.packets().to_master().sent()) / s.duration_s(),
                 s.felt_force_error_rms_n()});
    }
    panel.series.push_back(std::move(curve));
  }
  return draw(Picture{.name = "deadband",
                      .title = "Deadbands of 0 (2000 packets a second) to 80 %, 25 ms each way",
                      .panels = {std::move(panel)},
                      .panel = {800, 420}},
              folder);
}

std::string draw_torus(const std::string& folder) {
  const std::string file = folder + "/torus_trace.csv";
  WholeFile rows{file};
  static_cast<void>(run(load_scene(scene_file("render_torus_mesh")), {.trace = &rows}));
  rows.commit();
  const TraceFile trace{file, 400};
  Series mesh{Look::mesh, "#b0bec5", "mesh", 0.5}, way{Look::line, "#1565c0", "probe", 2.0},
      force{Look::strokes, "#d84315", "force on the hand, 6 mm for 1 N", 1.2};
  for (int i = 0; i <= 64; ++i) {
    for (int j = 0; j <= 32; ++j) {
      const double u = 2.0 * std::numbers::pi * i / 64, v = 2.0 * std::numbers::pi * j / 32,
                   r = 50.0 + 20.0 * std::cos(v);
      mesh.add({r * std::cos(u), r * std::sin(u), 20.0 * std::sin(v)});
    }
    mesh.interrupt();
  }
  for (std::size_t i = 0; i < trace.rows(); ++i) {
    const auto at = [&](const char* column, double scale) {
      return Vector3d{scale * trace[fmt::format("{}_0", column)][i], scale * trace[fmt::format("{}_1", column)][i],
                      scale * trace[fmt::format("{}_2", column)][i]};
    };
    const Vector3d x = at("master_x", kMm), f = at("master_f", -6.0);
    way.add({x.x(), x.y(), x.z()});
    force.add({x.x(), x.y(), x.z(), f.x(), f.y(), f.z()});
  }
  return draw(Picture{.name = "torus",
                      .title = "A probe slides over the mesh of a torus",
                      .panels = {{.title = "",
                                  .x = {.label = {"x", "mm"}},
                                  .y = {.label = {"y", "mm"}},
                                  .series = {mesh, way, force},
                                  .z = Scale{.label = {"z", "mm"}},
                                  .view_deg = {45.0, 25.0}}},
                      .panel = {820, 560}},
              folder);
}

}  // namespace twoport::lab
