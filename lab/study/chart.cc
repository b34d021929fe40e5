#include "lab/study/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/mechanical_energy.h"
#include "lab/study/boundary.h"
#include "lab/study/forecast.h"

namespace twoport::lab {
namespace {

template <int N>
void put(std::vector<double>& to, const Eigen::Matrix<double, N, 1>& v) {
  for (int i = 0; i < 3; ++i) to.push_back(i < N ? v[i] : 0.0);
}

Course course(const Scene& scene) {
  return for_dof(scene.dof, [&]<int N>() {
    Course c;
    constexpr int kAxes = twoport::kAxes<N>;
    const bool alone = scene.control.architecture == Architecture::uncontrolled;
    const Environment<N> environment{scene.environment, scene.tool};
    make_simulation<N>(scene)->run([&](const Row<N>& row) {
      c.t_s.push_back(row.t_s);
      put<kAxes>(c.master_x, row.master_x.translation());
      put<kAxes>(c.slave_x, row.slave_x.translation());
      put<kAxes>(c.force, row.env_f.vec().template head<kAxes>());
      c.energy_j.push_back(alone ? mechanical_energy(scene.robot, environment, row.slave_x, row.slave_v).si()
                                 : row.master_energy_j);
      return row.master_x.finite() && row.slave_x.finite();
    });
    return c;
  });
}

using Clock = std::chrono::steady_clock;

/// One run, without building the scene [s], and its ticks.
std::pair<double, double> timed(const Scene& scene) {
  return for_dof(scene.dof, [&]<int N>() {
    const auto simulation = make_simulation<N>(scene);
    const auto start = Clock::now();
    const std::uint64_t ticks = simulation->run_silently();
    return std::pair{std::chrono::duration<double>(Clock::now() - start).count(), static_cast<double>(ticks)};
  });
}

double median(std::vector<double> v) {
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

struct Candidate {
  Point point;
  std::vector<std::string> set;
  std::optional<Scene> scene;
  const Peer* peer = nullptr;
};

/// The last component of each path, once where they are the same: delay_ms of to_slave.delay_ms,to_master.delay_ms.
std::string field_names(const Axis& axis) {
  std::string names;
  for (const std::string& path : axis.paths) {
    const std::string name = path.substr(path.rfind('.') + 1);  // npos + 1 is 0
    if (names.find(name) == std::string::npos) names += (names.empty() ? "" : ", ") + name;
  }
  return names;
}

/// All combinations, the last axis fastest. Integrators that size their steps have no substeps: one of their combinations is enough.
std::vector<Candidate> combinations(const ChartOptions& o) {
  Grid grid;
  std::vector<std::string> varied;
  for (const std::string& text : o.vary) {
    const Axis& axis = grid.axes.emplace_back(parse_axis(text));
    warn_if_lost(o.set, axis.paths);
    refuse_overlap(axis, varied);
    varied.insert(varied.end(), axis.paths.begin(), axis.paths.end());
  }
  if (grid.axes.empty())
    grid.axes = {parse_axis("simulation.integrator=EXACT,EXACT_PER_TICK,SYMPLECTIC_EULER,TRAPEZOIDAL,VELOCITY_VERLET,"
                            "RK4,DORMAND_PRINCE"),
                 parse_axis("simulation.substeps=1,2,5,10,30,100")};
  std::vector<Candidate> all;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const std::vector<std::string> values = grid.values(cell);
    Candidate c;
    c.point.group = values.front();
    c.set = grid.overrides(cell);
    const auto has = [&](const char* text) { return std::find(c.set.begin(), c.set.end(), text) != c.set.end(); };
    const bool sizes_its_steps = has("simulation.integrator=EXACT") || has("simulation.integrator=DORMAND_PRINCE");
    bool is_needed = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::string field = field_names(grid.axes[i]);
      if (sizes_its_steps && field == "substeps") {
        is_needed = values[i] == "1";
        if (i > 0) continue;
      }
      if (!c.point.name.empty()) c.point.name += ", ";
      c.point.name += values[i];
      if (field != "integrator") c.point.name += " " + (values[i] == "1" && field == "substeps" ? "substep" : field);
    }
    if (is_needed) all.push_back(std::move(c));
  }
  return all;
}

std::vector<std::string> plus(std::vector<std::string> all, const std::vector<std::string>& more) {
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace

Difference difference(const Course& a, const Course& b) {
  double position2 = 0.0, force2 = 0.0, force_max = 0.0, energy_max = 0.0, count = 0.0;
  for (std::size_t i = 0, j = 0; i < a.t_s.size() && j < b.t_s.size();) {
    const double apart = a.t_s[i] - b.t_s[j];
    if (std::abs(apart) > 1e-9) {
      ++(apart < 0.0 ? i : j);
      continue;
    }
    double f2 = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto off = [&](const std::vector<double>& u, const std::vector<double>& v) {
        const double d = u[3 * i + k] - v[3 * j + k];
        return d * d;
      };
      position2 += off(a.master_x, b.master_x) + off(a.slave_x, b.slave_x);
      f2 += off(a.force, b.force);
    }
    force2 += f2;
    force_max = std::max(force_max, std::sqrt(f2));
    energy_max = std::max(energy_max, std::abs(a.energy_j[i] - b.energy_j[j]));
    ++count, ++i, ++j;
  }
  if (count == 0.0) return {};
  return {std::sqrt(position2 / count), std::sqrt(force2 / count), force_max, energy_max};
}

Chart chart(const ChartOptions& o, const std::vector<Peer>& peers,
            const std::function<void(const std::string&, double)>& heard) {
  std::vector<Candidate> all = combinations(o);
  for (const Peer& peer : peers) {
    Candidate& c = all.emplace_back();
    c.point.name = peer.name;
    c.point.group = peer.name;
    c.point.peer = true;
    c.peer = &peer;
  }
  // A point runs for its error, then for its time; what boundaries take is not known before.
  const std::size_t runs_of_point = 1 + 3 * static_cast<std::size_t>(o.repetitions);
  Forecast forecast{all.size() * runs_of_point};
  for (const Candidate& c : all) forecast.expect(c.point.name, runs_of_point, 1);
  const auto start = std::chrono::steady_clock::now();
  const auto now_s = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
  const auto say = [&](const std::string& text) {
    const std::optional<double> left_s = o.boundary.empty() ? forecast.left_s() : std::nullopt;
    if (heard) heard(left_s ? fmt::format("{}, {:.0f} s left", text, *left_s) : text, now_s());
  };
  const Scene written = load_scene(o.scene, o.set);
  const auto fine = [&](int substeps) {
    Scene scene = written;
    scene.simulation = {Integrator::rk4, substeps};
    say(fmt::format("reference, {} substeps", substeps));
    return course(scene);
  };
  const double peer_rate_hz = written.slave_rate_hz;  // engines move a robot
  const Course reference = fine(o.reference_substeps);
  Chart result;
  result.floor = difference(fine(std::max(1, o.reference_substeps / 2)), reference);
  result.rate_hz = peer_rate_hz;

  for (Candidate& c : all) {
    say(c.point.name);
    forecast.begin(c.point.name, now_s());
    try {
      if (c.peer == nullptr) c.scene = load_scene(o.scene, plus(o.set, c.set));
      c.point.error = difference(c.peer != nullptr ? c.peer->course() : course(*c.scene), reference);
      forecast.ran(now_s());
    } catch (const ConfigError& e) {
      c.point.impossible = e.what();
      forecast.drop(c.point.name, runs_of_point);
    }
  }
  const auto runs = [](const Candidate& c) { return c.scene.has_value(); };
  if (std::none_of(all.begin(), all.end(), runs)) throw ConfigError(all.front().point.impossible);

  // Repetitions in turn, so that disturbances of the machine affect all alike.
  std::vector<std::vector<double>> spent(all.size());
  std::vector<double> ticks(all.size(), written.duration_s * peer_rate_hz);
  for (int r = 0; r < o.repetitions; ++r) {
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].point.impossible.empty()) continue;
      say(fmt::format("timing, round {} of {}", r + 1, o.repetitions));
      forecast.begin(all[i].point.name, now_s());
      double shortest = std::numeric_limits<double>::infinity();
      for (int again = 0; again < 3; ++again) {
        double seconds = 0.0;
        if (all[i].peer != nullptr) {
          seconds = all[i].peer->seconds();
        } else {
          std::tie(seconds, ticks[i]) = timed(*all[i].scene);
        }
        shortest = std::min(shortest, seconds);
        forecast.ran(now_s());
      }
      spent[i].push_back(shortest);
    }
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    Candidate& c = all[i];
    if (!spent[i].empty()) {
      const double seconds = median(spent[i]);
      c.point.ns_per_tick = 1e9 * seconds / ticks[i];
      c.point.cost = seconds / written.duration_s;
    }
    if (!o.boundary.empty() && c.scene) {
      say("boundary of " + c.point.name);
      try {
        c.point.boundary =
            find_boundary({.scene = o.scene, .set = plus(o.set, c.set), .vary = parse_interval(o.boundary)}).stable;
      } catch (const ConfigError&) {
        c.point.boundary = std::numeric_limits<double>::infinity();  // no change between the ends
      }
    }
    result.points.push_back(c.point);
  }
  if (!o.boundary.empty())
    result.boundary = find_boundary({.scene = o.scene, .set = o.set, .vary = parse_interval(o.boundary)}).stable;
  find_front(result.points);
  return result;
}

void find_front(std::vector<Point>& points) {
  for (Point& p : points) {
    p.dominated_by.clear();
    if (!p.impossible.empty()) continue;
    const Point* best = nullptr;
    for (const Point& q : points) {
      if (&q == &p || !q.impossible.empty() || q.cost > p.cost || q.error.position_rms_m > p.error.position_rms_m)
        continue;
      const bool better = q.cost < p.cost || q.error.position_rms_m < p.error.position_rms_m;
      if (better && (best == nullptr || q.error.position_rms_m < best->error.position_rms_m)) best = &q;
    }
    if (best != nullptr) p.dominated_by = best->name;
  }
}

const Point* cheapest(const std::vector<Point>& points, double error_m, double floor_m) {
  const Point* best = nullptr;
  for (const Point& p : points)
    if (p.impossible.empty() && std::max(p.error.position_rms_m, floor_m) <= error_m &&
        (best == nullptr || p.cost < best->cost))
      best = &p;
  return best;
}

std::vector<EqualError> beside_engines(const Chart& c) {
  std::vector<EqualError> all;
  for (const Point& p : c.points)
    if (p.peer && p.impossible.empty()) {
      const Point* best = nullptr;
      for (const Point& q : c.points)
        if (!q.peer && q.impossible.empty() && (best == nullptr || q.cost < best->cost) &&
            q.error.position_rms_m <= std::max(p.error.position_rms_m, c.floor.position_rms_m))
          best = &q;
      all.push_back({&p, best});
    }
  std::sort(all.begin(), all.end(),
            [](const EqualError& a, const EqualError& b) { return a.engine->cost < b.engine->cost; });
  return all;
}

std::string to_text(const Chart& c) {
  std::vector<const Point*> sorted;
  for (const Point& p : c.points)
    if (p.impossible.empty()) sorted.push_back(&p);
  std::sort(sorted.begin(), sorted.end(), [](const Point* a, const Point* b) { return a->cost < b->cost; });
  std::string out = fmt::format("{:<44} {:>10} {:>12} {:>11} {:>11} {:>11}{}\n", "", "ns a tick", "position rms",
                                "force rms", "force max", "energy max", c.boundary ? "    boundary" : "");
  for (const Point* p : sorted) {
    // What is below the uncertainty of the reference is known to be no larger.
    const auto known = [](double error, double floor) {
      return error < floor ? fmt::format("<{:.1g}", floor) : fmt::format("{:.2g}", error);
    };
    const Difference &e = p->error, &f = c.floor;
    out += fmt::format("{:<44} {:>10.4g} {:>10} m {:>9} N {:>9} N {:>9} J", p->name, p->ns_per_tick,
                       known(e.position_rms_m, f.position_rms_m), known(e.force_rms_n, f.force_rms_n),
                       known(e.force_max_n, f.force_max_n), known(e.energy_max_j, f.energy_max_j));
    if (p->boundary) out += fmt::format(" {:>11.5g}", *p->boundary);
    out += p->dominated_by.empty() ? "   front\n" : fmt::format("   dominated by {}\n", p->dominated_by);
  }
  out += fmt::format("reference: Runge-Kutta 4, uncertain by {:.1g} m, {:.1g} N, {:.1g} J", c.floor.position_rms_m,
                     c.floor.force_max_n, c.floor.energy_max_j);
  if (c.boundary) out += fmt::format("; the scene as written changes its verdict at {:.6g}", *c.boundary);
  out += '\n';
  for (const EqualError& e : beside_engines(c)) {
    out +=
        fmt::format("{}, {:.4g} ns, {:.2g} m: ", e.engine->name, e.engine->ns_per_tick, e.engine->error.position_rms_m);
    out += e.own == nullptr
               ? "none of ours is as accurate\n"
               : fmt::format("{} takes {:.4g} ns, {:.2g} m, {:.3g} times as fast\n", e.own->name, e.own->ns_per_tick,
                             std::max(e.own->error.position_rms_m, c.floor.position_rms_m), e.ahead());
  }
  std::set<std::string> reasons;
  for (const Point& p : c.points)
    if (!p.impossible.empty() && reasons.insert(p.impossible).second)
      out += fmt::format("not possible: {}: {}\n", p.name, p.impossible);
  return out;
}

Table to_table(const Chart& c) {
  Table table;
  table.columns = {"name",        "ns_per_tick",  "cost_s_per_s", "position_rms_m", "force_rms_n",
                   "force_max_n", "energy_max_j", "boundary",     "dominated_by"};
  for (const Point& p : c.points)
    if (p.impossible.empty())
      table.rows.push_back({{p.name, true},
                            p.ns_per_tick,
                            p.cost,
                            p.error.position_rms_m,
                            p.error.force_rms_n,
                            p.error.force_max_n,
                            p.error.energy_max_j,
                            p.boundary ? Value{*p.boundary} : Value{},
                            {p.dominated_by, true}});
  return table;
}

Table to_table(const Chart& c, const std::vector<EqualError>& engines) {
  Table table;
  table.columns = {"engine", "ns_per_tick", "position_rms_m", "own", "own_ns_per_tick", "own_position_rms_m", "ahead"};
  for (const EqualError& e : engines) {
    Values& row =
        table.rows.emplace_back(Values{{e.engine->name, true}, e.engine->ns_per_tick, e.engine->error.position_rms_m});
    if (e.own != nullptr)
      row.insert(row.end(), {{e.own->name, true},
                             e.own->ns_per_tick,
                             std::max(e.own->error.position_rms_m, c.floor.position_rms_m),
                             e.ahead()});
    row.resize(table.columns.size());
  }
  return table;
}

}  // namespace twoport::lab
