#include "lab/study/compare.h"

#include <fmt/format.h>

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
#include "lab/study/sweep.h"

namespace twoport::lab {

Comparison compare(const CompareOptions& o, const Heard& heard) {
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
    for (std::string& each : method_overrides(method)) set.push_back(std::move(each));
    // The same E(0) for every method.
    if (!rendered)
      set.push_back(fmt::format("control.passivity.initial_energy_j={}", as_it_is.control.initial_energy.si()));
    scenes.push_back(load_scene(o.scene, set));
  }
  all.scene = scenes.front().name;
  all.dof = scenes.front().dof;
  all.summaries.resize(scenes.size());
  Tally tally{scenes.size(), heard};
  run_each(scenes.size(), o.jobs, tally, [&](std::size_t i) {
    const std::string folder = o.out + "/" + all.methods[i];
    std::optional<WholeFile> trace;
    if (!o.out.empty()) {
      make_folder(folder);
      trace.emplace(folder + "/trace.csv");
    }
    all.summaries[i] = run(scenes[i], {.trace = trace ? &*trace : nullptr});
    if (!trace) return;
    trace->commit();
    leave_summary(all.summaries[i], folder);
  });
  return all;
}

Table to_table(const Comparison& all) {
  Table table;
  table.columns = {"method"};
  for (const std::string& name : figures()) table.columns.push_back(name);
  table.columns.insert(table.columns.end(), {"verdict_kind", "verdict"});
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const Summary& s = all.summaries[m];
    Values& row = table.rows.emplace_back(Values{all.methods[m]});
    for (const std::string& name : figures()) row.push_back(Value::finite(Figure::named(name).of(s)));
    row.emplace_back(s.verdict_kind());
    row.emplace_back(s.verdict(), true);
  }
  return table;
}

const std::vector<ShownFigure>& compared_figures() {
  static const std::vector<ShownFigure> all{{"pressed N", Figure::named("environment_force_mean_n")},
                                            {"felt err N", Figure::named("felt_force_error_rms_n")},
                                            {"held", Figure::named("held_force_ratio")},
                                            {"muted", Figure::named("muted_share")},
                                            {"drag N", Figure::named("free_force_rms_n")},
                                            {"chatter N", Figure::named("chatter_rms_n")},
                                            {"turned deg", Figure::named("felt_force_direction_error_rms_deg")},
                                            {"drift mm", Figure::named("drift_m"), 1e3},
                                            {"hand mJ", Figure::named("hand_min_energy_j"), 1e3},
                                            {"both mJ", Figure::named("two_port_min_energy_j"), 1e3}};
  return all;
}

std::string compared_columns(const Summary* of) {
  std::string out;
  for (const ShownFigure& each : compared_figures()) {
    const double value = of == nullptr ? 0.0 : each.scale * each.figure.of(*of);
    out += of == nullptr          ? fmt::format(" {:>10}", each.title)
           : std::isfinite(value) ? fmt::format(" {:>10.3g}", value)
                                  : fmt::format(" {:>10}", "-");
  }
  return out + '\n';
}

std::string to_text(const Comparison& all) {
  std::string out = fmt::format("{}\n{:<26} {:<10}", all.scene, "method", "verdict") + compared_columns(nullptr);
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    out += fmt::format("{:<26} {:<10}", all.methods[m], all.summaries[m].verdict_kind()) +
           compared_columns(&all.summaries[m]);
  return out;
}

}  // namespace twoport::lab
