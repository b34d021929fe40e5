#include "lab/study/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <set>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/thread.h"
#include "common/scene/load.h"
#include "lab/engine/hosted.h"
#include "lab/engine/simulation.h"
#include "lab/mechanical_energy.h"
#include "lab/run.h"
#include "lab/study/boundary.h"
#include "lab/study/many_runs.h"

namespace twoport::lab {
namespace {

template <int N>
void put(std::vector<double>& to, const Eigen::Matrix<double, N, 1>& v) {
  for (int i = 0; i < 3; ++i) to.push_back(i < N ? v[i] : 0.0);
}

template <int N>
std::unique_ptr<Simulation<N>> simulation(const Scene& scene, const HostedRobot* robot) {
  return robot != nullptr ? make_simulation<N>(scene, *robot) : make_simulation<N>(scene);
}

Course course(const Scene& scene, const HostedRobot* robot = nullptr) {
  return for_cartesian_dof(scene.dof, "chart", [&]<int N>() {
    Course c;
    constexpr int kAxes = twoport::kAxes<N>;
    const bool alone = scene.control.architecture == Architecture::uncontrolled;
    const Environment<N> environment{scene.environment, scene.tool};
    simulation<N>(scene, robot)->run([&](const Row<N>& row) {
      c.t_s.push_back(row.t_s);
      put<kAxes>(c.master_x, row.master_x.translation());
      put<kAxes>(c.slave_x, row.slave_x.translation());
      put<kAxes>(c.force, row.env_f.vec().template head<kAxes>());
      put<kAxes>(c.felt, (alone ? row.env_f : row.master_f).vec().template head<kAxes>());
      c.energy_j.push_back(alone ? mechanical_energy(scene.robot, environment, row.slave_x, row.slave_v).si()
                                 : row.master_energy_j);
      return row.master_x.finite() && row.slave_x.finite();
    });
    return c;
  });
}

using Clock = std::chrono::steady_clock;

/// One run, without building the scene [s], and its ticks.
std::pair<double, double> timed(const Scene& scene, const HostedRobot* robot) {
  return for_cartesian_dof(scene.dof, "chart", [&]<int N>() {
    const auto timed = simulation<N>(scene, robot);
    const auto start = Clock::now();
    const std::uint64_t ticks = timed->run_silently();
    return std::pair{std::chrono::duration<double>(Clock::now() - start).count(), static_cast<double>(ticks)};
  });
}

/// Of vectors of three.
double rms(const std::vector<double>& v) {
  double sum2 = 0.0;
  for (const double x : v) sum2 += x * x;
  return std::sqrt(3.0 * sum2 / static_cast<double>(std::max<std::size_t>(v.size(), 1)));
}

struct Candidate {
  ChartPoint point;
  std::vector<std::string> set;
  std::optional<Scene> scene;
  const Peer* peer = nullptr;
  const HostedRobot* robot = nullptr;
};

/// By default tail.
VerdictFrom varied_verdict(const std::string& name) {
  return name.empty() ? VerdictFrom::tail : verdict_from(name, "--vary verdict");
}

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
/// A body alone has no twin, which tail and lean differ by.
std::vector<Candidate> combinations(const ChartOptions& o, bool alone) {
  Grid grid;
  std::vector<std::string> varied;
  for (const std::string& text : o.vary) {
    const Axis& axis = grid.axes.emplace_back(parse_axis(text));
    warn_if_lost(o.set, axis.paths);
    refuse_overlap(axis, varied);
    varied.insert(varied.end(), axis.paths.begin(), axis.paths.end());
  }
  if (grid.axes.empty()) {
    grid.axes = {parse_axis("simulation.integrator=EXACT,EXACT_PER_TICK,SYMPLECTIC_EULER,TRAPEZOIDAL,VELOCITY_VERLET,"
                            "RK4,DORMAND_PRINCE"),
                 parse_axis("simulation.substeps=1,2,5,10,30,100")};
    if (o.answer) grid.axes.push_back(parse_axis(alone ? "verdict=tail,plain" : "verdict=tail,lean,plain"));
  }
  std::vector<Candidate> all;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const std::vector<std::string> values = grid.values(cell);
    Candidate c;
    c.point.group = values.front();
    c.set = grid.overrides(cell);
    if (o.answer)
      std::erase_if(c.set, [&](const std::string& text) {
        if (!text.starts_with("verdict=")) return false;
        c.point.from = text.substr(8);
        return true;
      });
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
  double position2 = 0.0, force2 = 0.0, felt2 = 0.0, force_max = 0.0, energy_max = 0.0, count = 0.0;
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
      felt2 += off(a.felt, b.felt);
    }
    force2 += f2;
    force_max = std::max(force_max, std::sqrt(f2));
    energy_max = std::max(energy_max, std::abs(a.energy_j[i] - b.energy_j[j]));
    ++count, ++i, ++j;
  }
  if (count == 0.0) return {};
  return {std::sqrt(position2 / count), std::sqrt(force2 / count), force_max, energy_max, std::sqrt(felt2 / count)};
}

double Answer::off() const {
  return same_verdict ? std::max(felt, beside.value_or(0.0)) : std::numeric_limits<double>::infinity();
}
bool ChartPoint::counts() const {
  return impossible.empty() && std::isfinite(off);
}

Chart chart(const ChartOptions& o, const std::vector<Peer>& peers,
            const std::function<void(const std::string&, double)>& heard) {
  const Scene written = load_scene(o.scene, o.set);
  std::vector<Candidate> all = combinations(o, written.control.architecture == Architecture::uncontrolled);
  std::set<std::string> verdicts;
  for (const Candidate& c : all) verdicts.insert(c.point.from);
  for (const Peer& peer : peers)
    for (const std::string& verdict : verdicts) {
      Candidate& c = all.emplace_back();
      c.point.name = peer.name + (verdict.empty() ? "" : ", " + verdict + " verdict");
      c.point.group = peer.name;
      c.point.peer = true;
      c.point.from = verdict;
      c.peer = &peer;
      c.robot = peer.robot.get();
    }
  for (const std::string& verdict : verdicts) varied_verdict(verdict);  // complains before anything runs
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
  const auto fine = [&](int substeps) {
    Scene scene = written;
    scene.simulation = {Integrator::rk4, substeps};
    return scene;
  };
  const auto course_of_fine = [&](int substeps) {
    say(fmt::format("reference, {} substeps", substeps));
    return course(fine(substeps));
  };
  const double peer_rate_hz = written.slave_rate_hz;  // engines move a robot
  const Course reference = course_of_fine(o.reference_substeps);
  Chart result;
  result.floor = difference(course_of_fine(std::max(1, o.reference_substeps / 2)), reference);
  result.floor_off = result.floor.position_rms_m;
  result.rate_hz = peer_rate_hz;
  const auto boundary = [&](const std::vector<std::string>& set, VerdictFrom from, const HostedRobot* robot) {
    return find_boundary({.scene = o.scene,
                          .set = plus(o.set, set),
                          .vary = parse_interval(o.boundary, "--boundary"),
                          .verdict = from,
                          .robot = robot})
        .stable;
  };
  const auto boundary_of = [&](const Candidate& c) {
    try {
      return boundary(c.set, varied_verdict(c.point.from), c.robot);
    } catch (const ConfigError&) {
      return std::numeric_limits<double>::infinity();  // no change between the ends
    }
  };
  if (!o.boundary.empty()) {
    say("boundary of the reference");
    std::vector<std::string> set;
    if (o.answer) set = {fmt::format("simulation={{ integrator: RK4 substeps: {} }}", o.reference_substeps)};
    result.boundary = boundary(set, VerdictFrom::tail, nullptr);
  }
  const auto judged = [](const Scene& scene, VerdictFrom from, const HostedRobot* robot) {
    return with_verdict_of_both(run(scene, {.verdict = from, .robot = robot})).verdict_kind();
  };
  result.felt_n = rms(reference.felt);
  const auto share = [&](double rms_n) { return rms_n > 0.0 ? rms_n / result.felt_n : 0.0; };
  if (o.answer) {
    say("verdict of the reference");
    result.verdict = judged(fine(o.reference_substeps), VerdictFrom::tail, nullptr);
    if (result.verdict == "UNDECIDED")
      throw ConfigError{"--answer: the verdict of the reference is UNDECIDED; it must be STABLE, RESTLESS or UNSTABLE"};
    result.floor_off = std::max(share(result.floor.felt_rms_n), o.boundary.empty() ? 0.0 : BoundaryOptions{}.tolerance);
  }

  for (Candidate& c : all) {
    say(c.point.name);
    forecast.begin(c.point.name, now_s());
    try {
      if (c.peer == nullptr || c.robot != nullptr) c.scene = load_scene(o.scene, plus(o.set, c.set));
      c.point.error = difference(c.scene ? course(*c.scene, c.robot) : c.peer->course(), reference);
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
      Candidate& c = all[i];
      const VerdictFrom verdict = varied_verdict(c.point.from);
      for (int again = 0; again < 3; ++again) {
        double seconds = 0.0;
        if (o.answer) {
          Answer& answer = c.point.answer.emplace();
          const auto from = ThreadClock::now();
          answer.verdict = c.scene ? judged(*c.scene, verdict, c.robot) : c.peer->verdict(verdict);
          if (!o.boundary.empty()) c.point.boundary = boundary_of(c);
          seconds = std::chrono::duration<double>(ThreadClock::now() - from).count();
        } else if (c.scene) {
          std::tie(seconds, ticks[i]) = timed(*c.scene, c.robot);
        } else {
          seconds = c.peer->seconds();
        }
        shortest = std::min(shortest, seconds);
        forecast.ran(now_s());
        if (o.answer && !o.boundary.empty()) break;  // a search is long
      }
      spent[i].push_back(shortest);
    }
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    Candidate& c = all[i];
    if (!spent[i].empty()) {
      const double seconds = median(spent[i]);
      c.point.ns_per_tick = o.answer ? 0.0 : 1e9 * seconds / ticks[i];
      c.point.cost = o.answer ? seconds : seconds / written.duration_s;
    }
    if (!o.boundary.empty() && c.scene && !o.answer) {
      say("boundary of " + c.point.name);
      c.point.boundary = boundary_of(c);
    }
    c.point.off = c.point.error.position_rms_m;
    if (std::optional<Answer>& answer = c.point.answer) {
      answer->same_verdict = answer->verdict == result.verdict;
      answer->felt = share(c.point.error.felt_rms_n);
      constexpr double kNone = std::numeric_limits<double>::infinity();
      if (result.boundary) answer->beside = std::abs(c.point.boundary.value_or(kNone) / *result.boundary - 1.0);
      c.point.off = answer->off();
    }
    result.points.push_back(c.point);
  }
  find_front(result.points, result.floor_off);
  return result;
}

void find_front(std::vector<ChartPoint>& points, double floor) {
  const auto off = [&](const ChartPoint& p) { return std::max(p.off, floor); };
  for (ChartPoint& p : points) {
    p.dominated_by.clear();
    if (!p.counts()) continue;
    const ChartPoint* best = nullptr;
    for (const ChartPoint& q : points) {
      if (&q == &p || !q.counts() || q.cost > p.cost || off(q) > off(p)) continue;
      const bool better = q.cost < p.cost || off(q) < off(p);
      if (better && (best == nullptr || off(q) < off(*best))) best = &q;
    }
    if (best != nullptr) p.dominated_by = best->name;
  }
}

const ChartPoint* cheapest(const std::vector<ChartPoint>& points, double error, double floor,
                           const std::function<bool(const ChartPoint&)>& may) {
  const ChartPoint* best = nullptr;
  for (const ChartPoint& p : points)
    if (p.counts() && std::max(p.off, floor) <= error && (best == nullptr || p.cost < best->cost) && (!may || may(p)))
      best = &p;
  return best;
}

std::vector<EqualError> beside_engines(const Chart& c) {
  std::vector<EqualError> all;
  for (const ChartPoint& p : c.points)
    if (p.peer && p.impossible.empty()) {
      const auto may = [&](const ChartPoint& q) { return !q.peer && q.from == p.from; };
      all.push_back({&p, cheapest(c.points, std::max(p.off, c.floor_off), 0.0, may)});
    }
  std::sort(all.begin(), all.end(),
            [](const EqualError& a, const EqualError& b) { return a.engine->cost < b.engine->cost; });
  return all;
}

std::string told(const Chart& c, const ChartPoint& p) {
  if (!p.answer)
    return fmt::format("{}, {:.4g} ns a tick, {:.2g} m", p.name, p.ns_per_tick, std::max(p.off, c.floor_off));
  return fmt::format("{}, {:.4g} ms, {}, {}", p.name, 1e3 * p.cost, p.answer->verdict,
                     p.counts() ? fmt::format("off by {:.2g}", std::max(p.off, c.floor_off)) : "wrong");
}

std::string to_text(const Chart& c) {
  std::vector<const ChartPoint*> sorted;
  for (const ChartPoint& p : c.points)
    if (p.impossible.empty()) sorted.push_back(&p);
  std::sort(sorted.begin(), sorted.end(), [](const ChartPoint* a, const ChartPoint* b) { return a->cost < b->cost; });
  const bool answers = !c.verdict.empty();
  std::string out = answers ? fmt::format("{:<44} {:>10}    {:<9} {:>11}", "", "processor", "verdict", "force felt")
                            : fmt::format("{:<44} {:>10} {:>12} {:>11} {:>11} {:>11}", "", "ns a tick", "position rms",
                                          "force rms", "force max", "energy max");
  out += c.boundary ? "    boundary\n" : "\n";
  for (const ChartPoint* p : sorted) {
    // What is below the uncertainty of the reference is known to be no larger.
    const auto known = [](double error, double floor) {
      return error < floor ? fmt::format("<{:.1g}", floor) : fmt::format("{:.2g}", error);
    };
    const Difference &e = p->error, &f = c.floor;
    if (p->answer)
      out += fmt::format("{:<44} {:>10.4g} ms {:<9} {:>11}", p->name, 1e3 * p->cost, p->answer->verdict,
                         known(p->answer->felt, c.floor.felt_rms_n / c.felt_n));
    else
      out += fmt::format("{:<44} {:>10.4g} {:>10} m {:>9} N {:>9} N {:>9} J", p->name, p->ns_per_tick,
                         known(e.position_rms_m, f.position_rms_m), known(e.force_rms_n, f.force_rms_n),
                         known(e.force_max_n, f.force_max_n), known(e.energy_max_j, f.energy_max_j));
    if (p->boundary) out += fmt::format(" {:>11.5g}", *p->boundary);
    if (p->answer && p->answer->beside) out += fmt::format(" ({:.2g})", *p->answer->beside);
    out += !p->counts()              ? "   wrong\n"
           : p->dominated_by.empty() ? "   front\n"
                                     : fmt::format("   dominated by {}\n", p->dominated_by);
  }
  out += fmt::format("reference: Runge-Kutta 4, uncertain by {:.1g} m, {:.1g} N, {:.1g} J", c.floor.position_rms_m,
                     c.floor.force_max_n, c.floor.energy_max_j);
  if (answers) out += fmt::format("; {}; an answer by {:.1g}", c.verdict, c.floor_off);
  if (c.boundary) out += fmt::format("; the verdict changes at {:.6g}", *c.boundary);
  out += '\n';
  for (const EqualError& e : beside_engines(c))
    out += e.own == nullptr
               ? fmt::format("{}: none of ours is as accurate\n", told(c, *e.engine))
               : fmt::format("{}: {}, {:.3g} times as fast\n", told(c, *e.engine), told(c, *e.own), e.ahead());
  std::set<std::string> reasons;
  for (const ChartPoint& p : c.points)
    if (!p.impossible.empty() && reasons.insert(p.impossible).second)
      out += fmt::format("not possible: {}: {}\n", p.name, p.impossible);
  return out;
}

Table to_table(const Chart& c) {
  const bool answers = !c.verdict.empty();
  Table table;
  table.columns = {"name",        "ns_per_tick",  "cost_s_per_s", "position_rms_m", "force_rms_n",
                   "force_max_n", "energy_max_j", "boundary",     "dominated_by"};
  if (answers)
    table.columns.insert(table.columns.end(),
                         {"answer_s", "verdict", "same_verdict", "felt_share", "boundary_share", "off"});
  for (const ChartPoint& p : c.points) {
    if (!p.impossible.empty()) continue;
    Values& row = table.rows.emplace_back(Values{{p.name, true},
                                                 answers ? Value{} : Value{p.ns_per_tick},
                                                 answers ? Value{} : Value{p.cost},
                                                 p.error.position_rms_m,
                                                 p.error.force_rms_n,
                                                 p.error.force_max_n,
                                                 p.error.energy_max_j,
                                                 p.boundary ? Value{*p.boundary} : Value{},
                                                 {p.dominated_by, true}});
    if (p.answer)
      row.insert(row.end(), {p.cost, p.answer->verdict, p.answer->same_verdict, Value::finite(p.answer->felt),
                             p.answer->beside ? Value::finite(*p.answer->beside) : Value{}, Value::finite(p.off)});
  }
  return table;
}

Table to_table(const Chart& c, const std::vector<EqualError>& engines) {
  const bool answers = !c.verdict.empty();
  Table table;
  table.columns = answers
                      ? std::vector<std::string>{"engine", "answer_s", "off", "own", "own_answer_s", "own_off", "ahead"}
                      : std::vector<std::string>{"engine",          "ns_per_tick",        "position_rms_m", "own",
                                                 "own_ns_per_tick", "own_position_rms_m", "ahead"};
  const auto cost = [&](const ChartPoint& p) { return answers ? p.cost : p.ns_per_tick; };
  for (const EqualError& e : engines) {
    Values& row =
        table.rows.emplace_back(Values{{e.engine->name, true}, cost(*e.engine), Value::finite(e.engine->off)});
    if (e.own != nullptr)
      row.insert(row.end(), {{e.own->name, true}, cost(*e.own), std::max(e.own->off, c.floor_off), e.ahead()});
    row.resize(table.columns.size());
  }
  return table;
}

}  // namespace twoport::lab
