#include "lab/study/compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/coupling/layers.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "lab/study/cells.h"
#include "lab/study/map.h"
#include "lab/study/sweep.h"

namespace twoport::lab {
namespace {

void end_line(std::string& text) {
  text.erase(text.find_last_not_of(' ') + 1);
  text += '\n';
}

/// Those that were asked for, or all. Throws ConfigError for a name that is not in the list.
template <class Layer, std::size_t Count>
std::vector<std::string> names_of(const Layer (&layers)[Count], const std::vector<std::string>& asked,
                                  const char* option) {
  std::vector<std::string> all = twoport::names_of(layers);
  check_names(option, asked, all);
  return asked.empty() ? all : asked;
}

/// At most E(0) comes out of the ports of a claim; of both ports E(0) of each side, where each side has one. A claim that counts what the
/// device's own damping takes, which a summary does not have, is not judged; nor is the hand's port where a claim holds but for the
/// handle's prediction.
bool is_broken(const Summary& s, const std::string& passivity) {
  const Claim claim = *find_name(kPassivityLayers, passivity)->claim;
  const double grant = s.initial_energy_j(), slack = Matrix::kTolerance_j;
  return (claim.hand && !claim.device_damping && !claim.predicts && s.hand_min_energy_j() < -grant - slack) ||
         (claim.both && s.two_port_min_energy_j() < -claim.grants() * grant - slack);
}

/// Removes the layers with which no pair runs, where they were not asked for.
void drop_refused(const MatrixOptions& o, Matrix& m) {
  const auto runs = [&](std::size_t t, std::size_t p) { return m.at(t, p).refused.empty(); };
  Matrix kept{.scene = m.scene, .transparencies = {}, .passivities = {}, .cells = {}};
  std::vector<std::size_t> rows, columns;
  for (std::size_t t = 0; t < m.transparencies.size(); ++t) {
    bool any = !o.transparencies.empty();
    for (std::size_t p = 0; p < m.passivities.size(); ++p) any = any || runs(t, p);
    if (any) rows.push_back(t), kept.transparencies.push_back(m.transparencies[t]);
  }
  for (std::size_t p = 0; p < m.passivities.size(); ++p) {
    bool any = !o.passivities.empty();
    for (std::size_t t = 0; t < m.transparencies.size(); ++t) any = any || runs(t, p);
    if (any) columns.push_back(p), kept.passivities.push_back(m.passivities[p]);
  }
  for (const std::size_t t : rows)
    for (const std::size_t p : columns) kept.cells.push_back(m.at(t, p));
  m = std::move(kept);
}

}  // namespace

Comparison compare(const CompareOptions& o, const Heard& heard) {
  Comparison all{.scene = {}, .dof = 0, .methods = o.methods, .summaries = {}, .standings = {}};
  warn_if_lost(o.set, {"control.passivity.method"});
  const Scene as_it_is = load_scene(o.scene, o.set);
  const bool rendered = as_it_is.control.architecture == Architecture::render;
  const std::vector<std::string> allowed = rendered ? rendering_methods() : method_names();
  check_methods(o.methods, allowed);
  if (all.methods.empty()) all.methods = allowed;
  const double initial_energy_j = shared_initial_energy(as_it_is, as_it_is.control.known.round_trip).si();
  const auto scene_with = [&](const std::string& method) {
    std::vector<std::string> set = o.set;
    for (std::string& each : method_overrides(method)) set.push_back(std::move(each));
    if (!rendered) set.push_back(fmt::format("control.passivity.initial_energy_j={}", initial_energy_j));
    return load_scene(o.scene, set);
  };
  std::vector<Scene> scenes;
  for (const std::string& method : all.methods) scenes.push_back(scene_with(method));
  all.scene = scenes.front().name;
  all.dof = scenes.front().dof;
  all.control = as_it_is.control;
  all.summaries.resize(scenes.size());
  Tally tally{scenes.size(), heard};
  run_each(scenes.size(), o.jobs, tally, [&](std::size_t i) {
    const std::string folder = o.out + "/" + all.methods[i];
    std::optional<WholeFile> trace;
    if (!o.out.empty()) {
      make_folder(folder);
      trace.emplace(folder + "/trace.csv");
    }
    all.summaries[i] = run(scenes[i], {.trace = trace ? &*trace : nullptr, .robot = o.robot});
    if (!trace) return;
    trace->commit();
    leave_summary(all.summaries[i], folder);
  });
  if (rendered) return all;
  for (const auto& [way, rate_hz] :
       {std::pair{&as_it_is.to_slave, as_it_is.master_rate_hz}, {&as_it_is.to_master, as_it_is.slave_rate_hz}})
    all.unplayed_s =
        std::max(all.unplayed_s, static_cast<double>(way->recorded_delay_s.size()) / rate_hz - as_it_is.duration_s);
  const double reference_n = reference_force_n(scene_with(std::string{kPlainMethod}), nullptr, o.robot);
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    all.standings.push_back(standing_of(all.methods[m], {all.summaries[m]}, reference_n, initial_energy_j));
  return all;
}

Table to_table(const Comparison& all) {
  Table table;
  table.columns = {"method"};
  for (const std::string& name : figures()) table.columns.push_back(name);
  table.columns.insert(table.columns.end(), {"error_n", "verdict_kind", "verdict"});
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const Summary& s = all.summaries[m];
    Values& row = table.rows.emplace_back(Values{all.methods[m]});
    for (const std::string& name : figures()) row.push_back(Value::finite(Figure::named(name).of(s)));
    row.push_back(all.standings.empty() ? Value{} : Value::finite(all.standings[m].error_n.mean));
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
  const bool ranked = !all.standings.empty();
  std::string out = fmt::format("{}\n{:<26} {:<10}{}", all.scene, "method", "verdict", ranked ? "    error N" : "") +
                    compared_columns(nullptr);
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    out += fmt::format("{:<26} {:<10}", all.methods[m], all.summaries[m].verdict_kind());
    if (ranked) {
      const double error_n = all.standings[m].error_n.mean;
      out += std::isfinite(error_n) ? fmt::format(" {:>10.3g}", error_n) : fmt::format(" {:>10}", "-");
    }
    out += compared_columns(&all.summaries[m]);
  }
  out += ranked ? in_a_line(recommend(all.standings)) : "best: none is named where there is no link\n";
  if (all.unplayed_s > 0.1)
    out +=
        fmt::format("{:.1f} s of the link's trace come after the scene's end; recommend --link plays its worst parts\n",
                    all.unplayed_s);
  return out;
}

Gallery gallery(const GalleryOptions& o, const std::function<void(const Progress&)>& heard) {
  namespace fs = std::filesystem;
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& each : fs::directory_iterator{o.folder, error})
    if (each.path().extension() == ".textproto") files.push_back(each.path());
  if (error)
    throw ConfigError{fmt::format("{}: {}; name a folder of scenes, such as scenes/edge of the source tree", o.folder,
                                  error.message())};
  if (files.empty()) throw ConfigError{fmt::format("{}: no scene (.textproto) in this folder", o.folder)};
  std::sort(files.begin(), files.end());

  check_methods(o.methods, method_names());
  Gallery all{.methods = o.methods.empty() ? method_names() : o.methods, .entries = {}};
  std::vector<Scene> scenes;
  for (const fs::path& file : files) {
    all.entries.push_back({file.stem().string(), std::vector<Summary>(all.methods.size()), {}});
    for (const std::string& method : all.methods) scenes.push_back(load_scene(file.string(), method_overrides(method)));
  }
  Tally tally{scenes.size(), heard};
  run_cells({scenes.size(), 1, [&](std::size_t i) { return scenes[i]; }}, {.jobs = o.jobs}, tally,
            [&](std::size_t i, std::uint64_t, const std::vector<Summary>& of_seeds) {
              all.entries[i / all.methods.size()].summaries[i % all.methods.size()] = of_seeds.front();
            });
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    Gallery::Entry& entry = all.entries[i / all.methods.size()];
    for (std::string& sentence :
         violations({.stable = {}, .at_least = {}, .at_most = {}, .of_method = scenes[i].expect.of_method},
                    entry.summaries[i % all.methods.size()]))
      entry.missed.push_back(std::move(sentence));
  }
  return all;
}

std::string in_a_word(const Summary& s) {
  if (s.verdict_kind() == "UNSTABLE") return "UNSTABLE";
  if (s.verdict_kind() == "STABLE") return s.has_muted_share() && s.muted_share() > 0.5 ? "mute" : "stable";
  return s.verdict_kind() == "RESTLESS" ? "restless" : "undecided";
}

std::string to_text(const Gallery& all) {
  std::size_t wide = 5;
  for (const Gallery::Entry& each : all.entries) wide = std::max(wide, each.scene.size());
  std::string out = fmt::format("{:<{}}", "scene", wide);
  for (const std::string& method : all.methods)
    out += fmt::format("  {:<{}}", method, std::max<std::size_t>(9, method.size()));
  end_line(out);
  for (const Gallery::Entry& each : all.entries) {
    out += fmt::format("{:<{}}", each.scene, wide);
    for (std::size_t m = 0; m < all.methods.size(); ++m)
      out += fmt::format("  {:<{}}", in_a_word(each.summaries[m]), std::max<std::size_t>(9, all.methods[m].size()));
    end_line(out);
  }
  return out;
}

Table to_table(const Gallery& all) {
  Table table;
  table.columns = {"scene", "method", "verdict_kind", "word"};
  for (const Figure& figure : map_figures()) table.columns.push_back(figure.name());
  for (const Gallery::Entry& each : all.entries)
    for (std::size_t m = 0; m < all.methods.size(); ++m) {
      const Summary& s = each.summaries[m];
      Values& row = table.rows.emplace_back(Values{each.scene, all.methods[m], s.verdict_kind(), in_a_word(s)});
      for (const Figure& figure : map_figures()) row.push_back(Value::finite(figure.of(s)));
    }
  return table;
}

Matrix matrix(const MatrixOptions& o, const Heard& heard) {
  Matrix m{.scene = {},
           .transparencies = names_of(kTransparencyLayers, o.transparencies, "--transparency"),
           .passivities = names_of(kPassivityLayers, o.passivities, "--passivity"),
           .cells = {}};
  const SceneText text{read_text(o.scene), o.scene, o.set};
  const Scene as_it_is = text.with();
  if (as_it_is.control.architecture == Architecture::render ||
      as_it_is.control.architecture == Architecture::uncontrolled)
    throw ConfigError{fmt::format("{}: has no link; a matrix needs one", o.scene)};
  m.scene = as_it_is.name;
  const std::string initial_energy =
      fmt::format("control.passivity.initial_energy_j={}", as_it_is.control.initial_energy.si());
  std::vector<Scene> scenes;
  std::vector<std::size_t> numbers;
  for (const std::string& transparency : m.transparencies)
    for (const std::string& passivity : m.passivities) {
      Matrix::Cell& cell = m.cells.emplace_back();
      try {
        std::vector<std::string> set = method_overrides(transparency + "+" + passivity);
        set.push_back(initial_energy);
        scenes.push_back(text.with(set));
        numbers.push_back(m.cells.size() - 1);
      } catch (const ConfigError& e) {
        cell.refused = e.what();
      }
    }
  Tally tally{scenes.size(), heard};
  run_cells({scenes.size(), 1, [&](std::size_t i) { return scenes[i]; }},
            {.lanes = o.lanes, .jobs = o.jobs, .robot = o.robot}, tally,
            [&](std::size_t i, std::uint64_t, const std::vector<Summary>& of_seeds) {
              Matrix::Cell& cell = m.cells[numbers[i]];
              cell.summary = of_seeds.front();
              cell.broken = is_broken(cell.summary, m.passivities[numbers[i] % m.passivities.size()]);
            });
  drop_refused(o, m);
  return m;
}

Table to_table(const Matrix& m) {
  Table table;
  table.columns = {"transparency", "passivity", "verdict_kind"};
  for (const ShownFigure& each : compared_figures()) table.columns.push_back(each.figure.name());
  for (std::size_t t = 0; t < m.transparencies.size(); ++t)
    for (std::size_t p = 0; p < m.passivities.size(); ++p) {
      const Matrix::Cell& cell = m.at(t, p);
      Values& row = table.rows.emplace_back(Values{m.transparencies[t], m.passivities[p],
                                                   cell.refused.empty() ? cell.summary.verdict_kind() : "REFUSED"});
      for (const ShownFigure& each : compared_figures())
        row.push_back(cell.refused.empty() ? Value::finite(each.figure.of(cell.summary)) : Value{});
    }
  return table;
}

std::string to_text(const Matrix& m) {
  std::string out = fmt::format("{}\n{:<18} {:<23} {:<10}", m.scene, "transparency", "passivity", "verdict") +
                    compared_columns(nullptr);
  std::set<std::string> refusals;
  for (std::size_t t = 0; t < m.transparencies.size(); ++t)
    for (std::size_t p = 0; p < m.passivities.size(); ++p) {
      const Matrix::Cell& cell = m.at(t, p);
      out += fmt::format("{:<18} {:<23} ", m.transparencies[t], m.passivities[p]);
      if (cell.refused.empty()) {
        std::string columns = compared_columns(&cell.summary);
        if (cell.broken) columns.insert(columns.size() - 1, "  claim broken");
        out += fmt::format("{:<10}", cell.summary.verdict_kind()) + columns;
      } else {
        out += "refused\n";
        refusals.insert(fmt::format("{} + {}: {}\n", m.transparencies[t], m.passivities[p], cell.refused));
      }
    }
  for (const std::string& each : refusals) out += each;
  return out;
}

}  // namespace twoport::lab
