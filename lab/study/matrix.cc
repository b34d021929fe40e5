#include "lab/study/matrix.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <set>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/coupling/layers.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/study/compare.h"
#include "lab/study/map.h"

namespace twoport::lab {
namespace {

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
  run_cells({scenes.size(), 1, [&](std::size_t i) { return scenes[i]; }}, {.lanes = o.lanes, .jobs = o.jobs}, tally,
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
