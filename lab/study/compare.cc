#include "lab/study/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "lab/study/cells.h"
#include "lab/study/map.h"
#include "lab/study/parallel.h"
#include "lab/study/sweep.h"

namespace twoport::lab {

Comparison compare(const CompareOptions& o) {
  Comparison all{.scene = {}, .dof = 0, .methods = o.methods, .summaries = {}};
  warn_if_lost(o.set, {"control.passivity.method"});
  const Scene as_it_is = load_scene(o.scene, o.set);
  const bool rendered = as_it_is.control.architecture == Architecture::render;
  const std::vector<std::string> allowed = rendered ? rendering_methods() : method_names();
  check_methods(o.methods, allowed);
  if (all.methods.empty()) all.methods = allowed;
  std::vector<Scene> scenes;
  for (const std::string& method : all.methods) {
    std::vector<std::string> set = o.set;
    set.push_back("control.passivity.method=" + method);
    // The same E(0) for every method.
    if (!rendered)
      set.push_back(fmt::format("control.passivity.initial_energy_j={}", as_it_is.control.initial_energy.si()));
    scenes.push_back(load_scene(o.scene, set));
  }
  all.scene = scenes.front().name;
  all.dof = scenes.front().dof;
  all.summaries.resize(scenes.size());
  for_each_parallel(scenes.size(), o.jobs, [&](std::size_t i) {
    if (o.out.empty()) {
      all.summaries[i] = run(scenes[i]);
      return;
    }
    const std::string folder = o.out + "/" + all.methods[i];
    make_folder(folder);
    WholeFile trace{folder + "/trace.csv"};
    all.summaries[i] = run(scenes[i], {.trace = &trace, .verdict = VerdictFrom::tail});
    trace.commit();
    leave_summary(all.summaries[i], folder);
  });
  return all;
}

std::string to_csv(const Comparison& all) {
  std::string csv = "method";
  std::vector<std::string> names = figures();
  for (const std::string& name : names) csv += "," + name;
  csv += ",verdict_kind,verdict\n";
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    csv += all.methods[m];
    const auto of = numbers(all.summaries[m]);
    for (const std::string& name : names) {
      const double value = figure(of, name);
      csv += std::isfinite(value) ? fmt::format(",{}", value) : ",";
    }
    csv += fmt::format(",{},\"{}\"\n", all.summaries[m].verdict_kind(), all.summaries[m].verdict());
  }
  return csv;
}

std::string to_text(const Comparison& all) {
  struct Column {
    const char *title, *figure;
    double scale;
  };
  constexpr Column kColumns[] = {{"pressed N", "environment_force_mean_n", 1.0},
                                 {"felt err N", "felt_force_error_rms_n", 1.0},
                                 {"held", "held_force_ratio", 1.0},
                                 {"muted", "muted_share", 1.0},
                                 {"drag N", "free_force_rms_n", 1.0},
                                 {"chatter N", "chatter_rms_n", 1.0},
                                 {"turned deg", "felt_force_direction_error_rms_deg", 1.0},
                                 {"drift mm", "drift_m", 1e3},
                                 {"hand mJ", "hand_min_energy_j", 1e3},
                                 {"both mJ", "two_port_min_energy_j", 1e3}};
  std::string out = fmt::format("{}\n{:<26} {:<10}", all.scene, "method", "verdict");
  for (const Column& c : kColumns) out += fmt::format(" {:>10}", c.title);
  out += '\n';
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    out += fmt::format("{:<26} {:<10}", all.methods[m], all.summaries[m].verdict_kind());
    const auto of = numbers(all.summaries[m]);
    for (const Column& c : kColumns) {
      const double value = figure(of, c.figure);
      out += std::isfinite(value) ? fmt::format(" {:>10.3g}", c.scale * value) : fmt::format(" {:>10}", "-");
    }
    out += '\n';
  }
  return out;
}

}  // namespace twoport::lab
