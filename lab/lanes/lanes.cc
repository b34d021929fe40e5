#include "lab/lanes/lanes.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <new>
#include <optional>
#include <utility>

#include "common/base/check.h"
#include "common/base/low_pass.h"
#include "common/contact/environment.h"
#include "common/method/internal_model/slave.h"
#include "common/record/angle.h"
#include "common/record/metrics.h"
#include "common/record/run_judge.h"
#include "lab/engine/stoppable.h"
#include "lab/engine/summary_parts.h"
#include "lab/engine/tail_judge.h"
#include "lab/lanes/batch.h"
#include "lab/lanes/nodes.h"
#include "lab/run.h"
#include "lab/study/parallel.h"
#include "sim/operator/path.h"
#include "sim/plant/exact_wall.h"
#include "sim/sim_device.h"

namespace twoport {

/// Sets the sums of a run, and says what they are.
struct SumsOfLanes {
  template <int N, class Sums>
  static void set(Metrics<N>& m, const Sums& t, std::int64_t ticks, double period_ns, std::optional<double> held_ratio,
                  const std::array<double, 2 * N>& early, bool has_early, bool diverged) {
    const auto whole = [](double n) { return static_cast<std::uint64_t>(n); };
    m.rows_ = static_cast<std::uint64_t>(ticks);
    m.last_s_ = static_cast<double>(ticks - 1) * period_ns / kNanosecondsPerSecond;
    m.min_energy_j_ = t.min_energy, m.min_observed_j_ = t.min_observed;
    m.min_two_port_j_ = t.min_two_port, m.min_robot_j_ = t.min_robot;
    m.robot_force2_max_ = t.robot_force2, m.robot_speed2_max_ = t.robot_speed2;
    m.owed_j_ = t.owed, m.dissipated_j_ = t.dissipated, m.corrected_ticks_ = whole(t.corrected_ticks);
    m.drift2_ = t.drift2, m.position_error2_ = t.position_error2;
    m.apart_rows_ = whole(t.apart_rows), m.last_apart_row_ = whole(t.last_apart_row);
    m.force_error2_ = t.force_error2, m.correction2_max_ = t.correction2, m.force2_max_ = t.force2;
    m.chatter2_ = t.chatter2, m.wanted_rows_ = whole(t.wanted_rows), m.turned_rows_ = whole(t.turned_rows);
    m.turn2_max_ = t.turn2_max, m.turn2_ = t.turn2;

    ContactFigures<N>& c = m.contact_;
    c.uncoupled_ = whole(t.uncoupled), c.touching_ = whole(t.touching), c.free_ = whole(t.free);
    c.quiet_ = whole(t.quiet), c.muted_ = whole(t.muted), c.compared_ = whole(t.compared);
    c.environment_force_ = t.environment_force, c.error2_ = t.error2, c.turn2_ = t.contact_turn2;
    c.free_force2_ = t.free_force2, c.penetration2_ = t.penetration2;
    c.held_force_.ratio_ = held_ratio;

    RunJudge<N>& j = m.judge_;
    j.rows_ = m.rows_;
    j.reach2_ = t.reach2;
    std::copy_n(t.speed, 2 * N, j.speed_.begin());
    j.early_speed_ = early;
    j.early_ = !has_early;
    j.diverged_ = diverged;
    j.diverged_at_s_ = m.last_s_;
    j.coupled_ = t.was_coupled != 0.0;
  }
  /// What RunJudge has seen since the path's end, for a verdict from the run itself.
  template <int N>
  static void set_after(Metrics<N>& m, TrendRecord&& record, bool acted, double energy_j) {
    RunJudge<N>& j = m.judge_;
    j.after_ = std::move(record);
    j.acted_after_ = acted;
    j.energy_j_ = energy_j;
  }
};

namespace lab {
namespace {

using namespace lanes;

constexpr std::int64_t kRecordRows = 512, kMostLag = 1 << 16;
constexpr double kMostTicks = 4e6;  // of a run: its path is kept

/// An array for vectors of a unit.
class Numbers64 {
 public:
  void resize(std::size_t n) {
    if (n <= size_) return;
    data_.reset(static_cast<double*>(::operator new (n * sizeof(double), std::align_val_t{64})));
    std::fill_n(data_.get(), n, 0.0);
    size_ = n;
  }
  [[nodiscard]] double* get() const { return data_.get(); }

 private:
  struct Free {
    void operator()(double* p) const { ::operator delete (p, std::align_val_t{64}); }
  };
  std::unique_ptr<double, Free> data_;
  std::size_t size_ = 0;
};

/// Delay of a direction in ticks, as DueQueue makes it where ticks are a whole number of nanoseconds apart.
std::int64_t lag_of(const ImpairmentOptions& way, std::int64_t period_ns) {
  const std::int64_t delay = std::max<std::int64_t>(0, to_duration(way.delay_s).count());
  return (std::max<std::int64_t>(delay - 1, 1) + period_ns - 1) / period_ns;
}
std::int64_t period_of(const Scene& scene) {
  return static_cast<std::int64_t>(kNanosecondsPerSecond / scene.master_rate_hz);
}

/// The packet that comes before the first one of the slave's is as old as the network's delay, and a tick.
std::int64_t first_force_lag_of(const Scene& scene) {
  return 1 + std::lround(scene.to_master.delay_s * scene.slave_rate_hz);
}
/// Age of the oldest packet or force that a tick may read [ticks].
std::int64_t oldest_of(const Scene& scene) {
  const std::int64_t period = period_of(scene);
  return 1 + std::max({lag_of(scene.to_slave, period), lag_of(scene.to_master, period), first_force_lag_of(scene)});
}
/// Length of HeldForce's window [ticks].
std::size_t window_of(const Scene& scene) {
  return static_cast<std::size_t>(std::max(1L, std::lround(HeldForce<1>::kWindow * scene.master_rate_hz)));
}

/// Are the method's halves, the modes and the network stepped in lanes too, or by the laboratory's nodes lane by lane?
bool has_nodes_in_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  const bool model = c.method_name == "INTERNAL_MODEL" && !c.internal_model.strict_two_port;
  if (!model && c.method_name != "NONE" && c.method_name != "CLASSIC" && c.method_name != "FORCE_PROJECTED")
    return false;
  if (c.architecture != Architecture::position_force && c.architecture != Architecture::position_measured_force)
    return false;
  for (const ImpairmentOptions* o : {&scene.to_slave, &scene.to_master})
    if (o->jitter_s != 0.0 || o->duplicate != 0.0 || o->reorder != 0.0 || !o->recorded_delay_s.empty() ||
        !o->delay_step.empty() || lag_of(*o, period_of(scene)) > kMostLag)
      return false;
  for (const TransmissionOptions* o : {&scene.transmission_to_slave, &scene.transmission_to_master})
    if (o->playout_s > 0.0 || o->deadband) return false;
  return scene.schedule.empty() && c.device_limits == PortLimits{} && c.robot_limits == PortLimits{} &&
         c.own_limits == PortLimits{} && c.observer == ObserverRule::exact && !c.reference_energy &&
         to_duration(c.hold_after.si()).count() > 0 && to_duration(c.release_after.si()).count() > 0;
}
LaneMethod method_of(const Scene& scene) {
  if (!has_nodes_in_lanes(scene)) return LaneMethod::nodes;
  const ControlOptions& c = scene.control;
  if (c.method_name == "INTERNAL_MODEL") return LaneMethod::internal_model;
  if (c.controller.method == Method::none) return LaneMethod::none;
  const bool predictive =
      c.controller.method == Method::force_projected && c.controller.predict && c.handle_mass_kg > 0.0;
  return predictive ? LaneMethod::predictive : LaneMethod::one_port;
}

/// What the operator's intended positions follow from.
std::string path_key(const Scene& scene) {
  std::string key;
  const auto add = [&](double v) { key.append(reinterpret_cast<const char*>(&v), sizeof v); };
  const auto add_all = [&](const Numbers& n) {
    add(static_cast<double>(n.size()));
    for (const double v : n) add(v);
  };
  add(scene.master_rate_hz), add(scene.duration_s);
  if (scene.device) add_all(scene.device->position_m);
  add(scene.device ? 1.0 : 0.0);
  const OperatorSpec& o = *scene.operator_model;
  for (const SegmentSpec& segment : o.path) {
    add(static_cast<double>(segment.index()));
    add(std::visit([](const auto& s) { return s.duration_s; }, segment));
    if (const auto* move = std::get_if<MoveToSpec>(&segment)) add_all(move->position_m);
    if (const auto* sine = std::get_if<SineSpec>(&segment))
      add(sine->axis), add(sine->amplitude_m), add(sine->frequency_hz);
    if (const auto* screw = std::get_if<ScrewSpec>(&segment)) {
      add_all(screw->point_m), add_all(screw->axis);
      add(screw->angle_rad), add(screw->travel_m), add(screw->frequency_hz);
    }
  }
  if (o.tremor) {
    add(o.tremor->rms_m), add(o.tremor->low_hz), add(o.tremor->high_hz);
    add(std::bit_cast<double>(scene.seed));
  }
  return key;
}

/// Intended positions at each tick of a scene, and what else the path says.
struct Intended {
  std::vector<double> x;
  std::vector<double> segment_ends_s;
  double end_s = 0.0;
};
template <int N>
std::shared_ptr<const Intended> intended_of(const sim::SimDevice<N>& device, const Scene& scene, std::int64_t ticks) {
  sim::Path<N> path = device.path();
  auto all = std::make_shared<Intended>();
  const double dt = Seconds{1.0 / scene.master_rate_hz}.si();
  all->x.reserve(static_cast<std::size_t>((ticks + 1) * N));
  for (std::int64_t k = 0; k <= ticks; ++k) {
    const auto at = path.at(k == 0 ? 0.0 : static_cast<double>(k) * dt);
    for (int i = 0; i < N; ++i) all->x.push_back(at.x.translation()[i]);
  }
  all->segment_ends_s = path.segment_ends_s();
  all->end_s = path.end_s();
  return all;
}

/// A simulation at rest between two ticks, with the packets on their way.
template <int N>
struct Snapshot {
  State<double, N> state;
  std::vector<double> to_slave, to_master;  ///< [age - 1][word]: put in `age` ticks ago
  std::shared_ptr<const Nodes<N>> nodes;    ///< LaneMethod::nodes; packets are theirs
};

/// The next tick at which one of the times [s] has come, and whether a time has.
std::int64_t tick_of_time(double t_s, double period_ns) {
  if (!(t_s > 0.0)) return 0;
  if (!(t_s < 1e9)) return std::numeric_limits<std::int64_t>::max() / 2;
  const auto at = [&](std::int64_t k) { return static_cast<double>(k) * period_ns / kNanosecondsPerSecond; };
  auto k = static_cast<std::int64_t>(t_s * kNanosecondsPerSecond / period_ns);
  while (k > 0 && at(k - 1) >= t_s) --k;
  while (at(k) < t_s) ++k;
  return k;
}
/// The first tick that begins at `t` or later.
std::int64_t tick_from(Duration t, std::int64_t period_ns) {
  return std::max<std::int64_t>(0, (t.count() + period_ns - 1) / period_ns);
}

/// A run of a scene, and the tails that judge it.
template <int N>
class Cell {
 public:
  using P = Parameters<double, N>;
  using S = State<double, N>;
  using T = Sums<double, N>;
  using Plant = sim::ExactPlant<N>;

  Cell(std::size_t number_of_scene, const Scene& scene, VerdictFrom verdict, const sim::SimDevice<N>& device,
       std::shared_ptr<const Intended> path)
      : number{number_of_scene},
        scene_{scene},
        from_of_verdict_{verdict},
        twin_{verdict != VerdictFrom::lean},
        period_ns_{period_of(scene)},
        path_{std::move(path)},
        plant_{*scene.robot,
               World{scene.environment},
               1.0 / scene.slave_rate_hz,
               {position<N>(scene.robot->position_m), Velocity<N>{vector<N>(scene.robot->velocity_m_per_s)}}} {
    std::memset(&p, 0, sizeof p);
    std::memset(&t, 0, sizeof t);
    std::memset(&now.state, 0, sizeof now.state);
    if (method_of(scene) == LaneMethod::nodes) nodes_ = std::make_unique<Nodes<N>>(scene);
    set_parameters();
    start(device);
    plan();
  }

  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] const double* path() const { return path_->x.data(); }
  [[nodiscard]] Plant& plant() { return plant_; }
  [[nodiscard]] Nodes<N>* nodes() { return nodes_.get(); }
  void keep_nodes() { now.nodes = std::make_shared<const Nodes<N>>(*nodes_); }
  [[nodiscard]] std::int64_t lag(int way) const { return lag_[way]; }
  [[nodiscard]] std::int64_t oldest() const { return oldest_of(scene_); }
  [[nodiscard]] std::int64_t ticks() const { return ticks_; }
  [[nodiscard]] std::int64_t next_stop() const { return stops_[next_stop_]; }
  [[nodiscard]] std::size_t window() const { return window_; }
  [[nodiscard]] bool is_plain() const { return from_of_verdict_ == VerdictFrom::plain; }
  /// Are ticks from `k` on recorded? RunJudge::see.
  [[nodiscard]] bool is_recorded(std::int64_t k) const { return k >= quiet_from_; }
  /// Recorded ticks: their rows, of which every `width`-th number is this lane's.
  void add_recorded(const double* rows, std::size_t width, std::size_t count) {
    std::array<const double*, 2 * N> v;
    for (std::size_t j = 0; j < 2 * N; ++j) v[j] = rows + j * width;
    const std::array energies{rows + 2 * N * width, rows + 2 * N * width};
    const std::size_t row = words_of_record(N) * width;
    after_->add_ticks(v, energies, count, row, [&](std::size_t k) -> TrendRecord::Events {
      const auto events = static_cast<unsigned>(rows[k * row + (2 * N + 2) * width]);
      acted_after_ = acted_after_ || (events & kActed) != 0;
      return {.touching = (events & kTouching) != 0, .limited = (events & kLimited) != 0};
    });
  }
  void keep_ratio(double ratio) { held_ratio_ = ratio; }

  /// Tick `k`, a stop, begins; the lane's state is in `now` and `t`. Sets the parameters that change.
  /// `snapshot` fills now.to_slave and now.to_master. False: the run has ended.
  template <class Fill>
  bool at_stop(std::int64_t k, Fill snapshot) {
    if (k == early_at_ && k < ticks_) {
      std::copy_n(t.speed, 2 * N, early_.begin());
      has_early_ = true;
    }
    while (part_ < parts_.size() && k >= parts_[part_].until) {
      const bool last = parts_[part_].until_s >= end_s_;
      const double pressed = std::exchange(t.pressed, 0.0);
      if (t.touched != 0.0 && pressed > pressed_) {
        pressed_ = pressed;
        held_.reset();
        if (!last) {
          snapshot();
          held_.emplace(now);
          held_at_s_ = parts_[part_].until_s;
        }
      }
      t.touched = t.late_ticks = 0.0;
      ++part_;
    }
    set_flags(k);
    while (next_stop_ < stops_.size() && stops_[next_stop_] <= k) ++next_stop_;
    return k < ticks_;
  }
  /// The run has ended before tick k, or a state has diverged in the last one; `now` and `t` are its last.
  void end(std::int64_t k, bool diverged, std::optional<double> last_ratio) {
    ended_at_ = k;
    if (last_ratio) held_ratio_ = last_ratio;
    failed_ = !finite();
    if (failed_) return;
    metrics_.emplace(metrics_of<N>(scene_, true, path_->end_s, scene_.control.initial_energy.si(), false));
    SumsOfLanes::set<N>(*metrics_, t, k, static_cast<double>(period_ns_), held_ratio_, early_, has_early_, diverged);
    if (is_plain()) {
      SumsOfLanes::set_after<N>(*metrics_, std::move(*after_), acted_after_, now.state.master_energy);
      return;
    }
    judged_ = !diverged && metrics_->judge().not_judged().empty();
    if (judged_) scale_ = metrics_->judge().scale();
  }
  [[nodiscard]] bool needs_tails() const { return judged_ && !failed_; }

  /// Begins the tail of the end, then that of the state in contact; without a twin where wants_twin() is false.
  std::unique_ptr<TailJudge<N>> begin_tail() {
    from_ = verdict_ ? &*held_ : &now;
    auto judge = std::make_unique<TailJudge<N>>(scene_, scale_, granted(), twin_);
    const auto k = static_cast<std::int64_t>(from_->state.k);
    for (int i = 0; i < N; ++i) p.held_at[i] = path_->x[static_cast<std::size_t>((k - 1) * N + i)];
    return judge;
  }
  [[nodiscard]] const Snapshot<N>& tail_from() const { return *from_; }
  [[nodiscard]] bool wants_twin() const { return twin_; }
  /// A controller has acted in the tail: it begins anew with a twin.
  void want_twin() { twin_ = true; }
  /// The twin of a state.
  [[nodiscard]] S kicked(S s, const std::pair<Velocity<N>, Velocity<N>>& by) {
    for (int i = 0; i < N; ++i) s.master_v[i] = s.master_v[i] + by.first[i];
    if (scene_.simulation.integrator == Integrator::rk4) {
      for (int i = 0; i < N; ++i) s.slave_v[i] = s.slave_v[i] + by.second[i];
      return s;
    }
    to_plant(s.slave_x, s.slave_v, s.across, s.in_contact);
    plant_.kick(by.second);
    from_plant(s.slave_x, s.slave_v, s.across, s.in_contact);
    return s;
  }
  /// Takes the verdict of a tail. True: another one is needed.
  bool end_tail(const Verdict& verdict) {
    if (!verdict_) {
      verdict_ = verdict;
      twin_ = from_of_verdict_ != VerdictFrom::lean;
      return verdict.kind != VerdictKind::unstable && held_.has_value();
    }
    keep_worse(*verdict_, verdict, held_at_s_);
    return false;
  }
  void fail() { failed_ = true; }
  [[nodiscard]] bool failed() const { return failed_; }

  [[nodiscard]] Summary summary(double step_ns) const {
    if (failed_) return run(scene_, {.verdict = from_of_verdict_});
    Summary s;
    metrics_->fill(s);
    describe_run(scene_, "lab", s);
    s.set_step_ns(step_ns);
    if (judged_) set_verdict(*verdict_, s);
    say_if_coupling_feeds(s, scene_.control.initial_energy);
    LinkUse use{};
    if (nodes_) {
      use = nodes_->use();
    } else {
      use.slave = packets(0);
      use.master = packets(1);
    }
    fill_link(s, use, scene_);
    return s;
  }

  /// Blackouts of the packets that are taken in tick k, where they end for packets put in from `quiet` on.
  void set_blackouts(std::int64_t k, std::int64_t quiet) {
    for (int way = 0; way < 2; ++way) {
      const std::int64_t sent = k - lag_[way];
      p.blackout[way] = 0.0;
      if (sent < quiet)
        for (const auto& [from, to] : blackouts_[way])
          if (sent >= from && sent < to) p.blackout[way] = 1.0;
    }
  }
  /// The next tick after k at which set_blackouts() may have another result.
  [[nodiscard]] std::int64_t blackouts_change(std::int64_t k, std::int64_t quiet) const {
    std::int64_t next = std::numeric_limits<std::int64_t>::max();
    for (int way = 0; way < 2; ++way) {
      if (blackouts_[way].empty()) continue;
      const auto at = [&](std::int64_t sent) {
        if (sent + lag_[way] > k) next = std::min(next, sent + lag_[way]);
      };
      at(quiet);
      for (const auto& [from, to] : blackouts_[way]) at(from), at(to);
    }
    return next;
  }

  static void step_plant(void* plant, double* io) {
    Plant& of = *static_cast<Plant*>(plant);
    Force<N> f;
    set(of, io, io + N, io + 2 * N, io[2 * N + 2]);
    f = Force<N>{Eigen::Map<const typename Force<N>::Vector>{io + 2 * N + 3}};
    of.advance(f);
    get(of, io, io + N, io + 2 * N, io[2 * N + 2]);
  }

  const std::size_t number;  ///< of its scene, among those that are run
  P p;
  T t;
  Snapshot<N> now;

 private:
  struct RunPart {
    std::int64_t from, late, until;
    double until_s;
  };

  static void set(Plant& plant, const double* x, const double* v, const double* across, double in_contact) {
    using Vector = typename Force<N>::Vector;
    plant.set_state({{Position<N>{Eigen::Map<const Vector>{x}}, Velocity<N>{Eigen::Map<const Vector>{v}}},
                     {across[0], across[1]},
                     in_contact != 0.0});
  }
  static void get(const Plant& plant, double* x, double* v, double* across, double& in_contact) {
    const auto& s = plant.state();
    for (int i = 0; i < N; ++i) x[i] = s.body.x.translation()[i], v[i] = s.body.v[i];
    across[0] = s.across[0], across[1] = s.across[1];
    in_contact = s.in_contact ? 1.0 : 0.0;
  }
  void to_plant(const double* x, const double* v, const double* across, double in) { set(plant_, x, v, across, in); }
  void from_plant(double* x, double* v, double* across, double& in) const { get(plant_, x, v, across, in); }

  void set_parameters() {
    const ControlOptions& c = scene_.control;
    const double dt = 1.0 / scene_.master_rate_hz;
    p.dt = dt;
    p.period_ns = static_cast<double>(period_ns_);
    const DeviceSpec device = scene_.device.value_or(DeviceSpec{});
    const HandSpec hand = *scene_.operator_model->hand;
    const sim::Oscillator handle{device.mass_kg + hand.mass_kg, device.damping_n_s_per_m + hand.damping_n_s_per_m,
                                 hand.stiffness_n_per_m};
    const sim::Response r{handle, dt};
    p.handle_xv = r.xv, p.handle_xu = r.xu, p.handle_xw = r.xw;
    p.handle_vv = r.vv, p.handle_vu = r.vu, p.handle_vw = r.vw;
    p.hand_stiffness = hand.stiffness_n_per_m, p.hand_damping = hand.damping_n_s_per_m;
    p.step_s = dt / scene_.simulation.substeps;
    p.handle_inverse_mass = 1.0 / handle.mass_kg, p.handle_damping = handle.damping_n_s_per_m;
    p.robot_mass = scene_.robot->mass_kg, p.robot_damping = scene_.robot->damping_n_s_per_m;
    // As ExactPlant's regions: the robot with the springs, free and in contact.
    const World world{scene_.environment};
    sim::Oscillator free{scene_.robot->mass_kg, scene_.robot->damping_n_s_per_m, 0.0};
    typename Force<N>::Vector pull = Force<N>::Vector::Zero();
    int k = 0;
    for (const Spring& s : world.springs) {
      free.damping_n_s_per_m += s.damping_n_s_per_m;
      free.stiffness_n_per_m += s.stiffness_n_per_m;
      pull += s.stiffness_n_per_m * s.anchor_m.head<N>();
      p.spring_stiffness[k] = s.stiffness_n_per_m, p.spring_damping[k] = s.damping_n_s_per_m;
      for (int i = 0; i < N; ++i) p.spring_anchor[k][i] = s.anchor_m[i];
      ++k;
    }
    for (int i = 0; i < N; ++i) p.pull[i] = pull[i];
    set_region(0, free, free, 0.0);
    if (!world.surfaces.empty()) {
      const Surface& w = world.surfaces[0];
      const Wall& plane = std::get<Wall>(w.shape);
      for (int i = 0; i < N; ++i) p.normal[i] = plane.normal[i];
      p.offset = plane.offset_m;
      p.wall_stiffness = w.material.stiffness_n_per_m, p.wall_damping = w.material.damping_n_s_per_m;
      p.wall_viscous = w.material.viscous_friction_n_s_per_m, p.wall_friction = w.material.friction;
      sim::Oscillator across = free, along = free;
      across.stiffness_n_per_m += p.wall_stiffness;
      across.damping_n_s_per_m += p.wall_damping;
      along.damping_n_s_per_m += p.wall_viscous;
      set_region(1, across, along, p.wall_stiffness * p.offset);
    }
    if (scene_.robot->force_sensor) {
      const auto bias = vector<N>(scene_.robot->force_sensor->bias_n);
      for (int i = 0; i < N; ++i) p.sensor_bias[i] = bias[i];
      if (nodes_) nodes_->set_bias(bias);
    }
    p.stiffness = c.coupling.stiffness_n_per_m, p.damping = c.coupling.damping_n_s_per_m;
    p.mobility = 1.0 / (p.damping + p.stiffness * dt);
    p.catch_up = c.coupling.catch_up_m_per_s;
    p.motion_scale = c.motion_scale, p.force_scale = c.force_scale;
    p.energy_to_master = p.force_scale / p.motion_scale, p.energy_to_slave = p.motion_scale / p.force_scale;
    p.hold_ns = static_cast<double>(to_duration(c.hold_after.si()).count());
    p.release_ns = static_cast<double>(to_duration(c.release_after.si()).count());
    p.ramp_by = c.engage > Seconds{} ? dt / c.engage.si() : 1.0;
    p.most_force = limits_at_device(c).force_n;
    p.initial_energy = c.initial_energy.si();
    p.most_gain = c.controller.max_gain;
    p.response = c.handle_mass_kg > 0.0 ? 0.5 * dt * (1.0 / c.handle_mass_kg) : 0.0;
    const ImpairmentOptions* const ways[] = {&scene_.to_slave, &scene_.to_master};
    for (int way = 0; way < 2; ++way) {
      const ImpairmentOptions& o = *ways[way];
      lag_[way] = lag_of(o, period_ns_);
      p.lag[way] = static_cast<double>(lag_[way]);
      p.loss[way] = o.loss;
      p.burst_r[way] = 1.0;
      if (o.burst)
        p.burst_p[way] = o.burst->p, p.burst_r[way] = o.burst->r, p.burst_good[way] = o.burst->loss_good,
        p.burst_bad[way] = o.burst->loss_bad;
      for (const BlackoutWindow& w : o.blackout) {
        const Duration from = to_duration(w.start_s), to = from + to_duration(w.duration_s);
        blackouts_[way].emplace_back(tick_from(from, period_ns_), tick_from(to, period_ns_));
      }
    }
    first_force_lag_ = first_force_lag_of(scene_);
    if (method_of(scene_) == LaneMethod::internal_model) set_internal_model();
    const HighPassCoefficients filter{30.0, scene_.master_rate_hz};
    p.filter_b0 = filter.b0, p.filter_a1 = filter.a1, p.filter_a2 = filter.a2;
    window_ = window_of(scene_);
    p.window = static_cast<double>(window_);
  }

  /// As the constructors of InternalModelMaster and InternalModelSlave.
  void set_internal_model() {
    const ControlOptions& c = scene_.control;
    const double dt = p.dt, robot_kg = c.known.robot_mass_kg;
    const auto weight = [&](double tau_s) { return low_pass_weight(Seconds{dt}, tau_s); };
    const double r = to_seconds(Duration{(lag_[0] + lag_[1]) * period_ns_}).si();
    p.round_trip_s = r;
    p.damping = with_damped_robot(c).coupling.damping_n_s_per_m;
    p.coupling = c.force_scale * c.motion_scale * c.coupling.stiffness_n_per_m;
    p.quarter_handle = 0.25 * c.handle_mass_kg;
    p.robot_kg = robot_kg, p.robot_quarter_per_dt = 0.25 * robot_kg / dt;
    p.brake = std::min(20.0, c.coupling.damping_n_s_per_m);
    p.to_master_stiffness = c.force_scale * c.motion_scale, p.inverse_motion = 1.0 / c.motion_scale;
    p.yields = std::min(1.0, std::pow(c.known.round_trip.si() / 0.2, 2));
    p.dt2 = dt * dt;
    p.spring = std::min(p.coupling, p.quarter_handle / p.dt2);
    p.most_damping = c.handle_mass_kg / (4.0 * dt);
    p.weight_3ms = weight(3e-3), p.weight_10ms = weight(10e-3), p.weight_20ms = weight(20e-3);
    p.weight_30ms = weight(30e-3), p.weight_50ms = weight(50e-3), p.weight_100ms = weight(0.1);
    p.weight_500ms = weight(0.5), p.weight_along = weight(0.2 + r);
    const double residual_s = std::clamp(6.0 * std::sqrt(robot_kg / c.coupling.stiffness_n_per_m), 0.3, 1.0);
    p.weight_residual = weight(residual_s + 0.5 * r), p.weight_outside = weight(0.3 + r);
    p.weight_offset_normal = weight(0.5 + 2.0 * r);
    p.ramp_in_100ms = dt / 0.1;
    InternalModel<double, N>& m = now.state.model;
    m.found.normal[0] = m.model.normal[0] = m.yield_normal[0] = m.offset_normal[0] = 1.0;
    m.scale_slow = m.shown = m.peak_speed = 1.0;
    m.level = 1e-5;
  }

  /// A tick that is cut into parts is left to the plant; the map of a whole one then does not matter.
  void set_region(int in, const sim::Oscillator& across, const sim::Oscillator& along, double load) {
    const sim::Response map{across, p.dt}, side{along, p.dt};
    p.map_x[in][0] = 1.0 - across.stiffness_n_per_m * map.xu, p.map_x[in][1] = -across.stiffness_n_per_m * map.vu;
    p.map_v[in][0] = map.xv, p.map_v[in][1] = map.vv;
    p.map_u[in][0] = map.xu, p.map_u[in][1] = map.vu;
    p.load[in] = load;
    p.in_parts[in] =
        std::ceil(std::max(1.0, 2.0 * p.dt * std::sqrt(across.stiffness_n_per_m / across.mass_kg))) > 1.0 ? 1.0 : 0.0;
    p.along_stiffness[in] = along.stiffness_n_per_m;
    p.along_xv[in] = side.xv, p.along_xu[in] = side.xu, p.along_vv[in] = side.vv, p.along_vu[in] = side.vu;
  }

  void start(const sim::SimDevice<N>& device) {
    S& s = now.state;
    for (int i = 0; i < N; ++i) {
      s.master_x[i] = device.x().translation()[i], s.master_v[i] = device.v()[i];
      s.intended[i] = path_->x[static_cast<std::size_t>(i)];
    }
    from_plant(s.slave_x, s.slave_v, s.across, s.in_contact);
    for (int i = 0; i < N; ++i) s.x_sd[i] = s.x_d[i] = s.x_before[i] = s.slave_x[i];
    s.force_lag = static_cast<double>(first_force_lag_);
    const std::uint64_t streams[] = {kToSlaveStream, kToMasterStream};
    for (int way = 0; way < 2; ++way) {
      // Its only number is the key; the bits of packet 0 are drawn `lag` ticks later, and each packet's key is 16 γ further.
      const auto key = std::bit_cast<std::uint64_t>(Random{scene_.seed ^ streams[way]});
      constexpr std::uint64_t kStep = 16 * std::uint64_t{0x9e3779b97f4a7c15};
      s.random[way] = std::bit_cast<double>(key - kStep * static_cast<std::uint64_t>(lag_[way]));
    }
    const double speed2 = device.v().squared_norm() + plant_.body().v.squared_norm();
    p.most_speed2 = std::max(RunJudge<N>::kDiverged * RunJudge<N>::kDiverged, 100.0 * speed2);
  }

  /// Stops: where a part of the run ends or becomes late, a rest or a blackout begins or ends, the early part ends.
  void plan() {
    const double period = static_cast<double>(period_ns_);
    const Duration end = to_duration(scene_.duration_s);
    ticks_ = tick_from(end, period_ns_);
    end_s_ = to_seconds(end).si();
    early_at_ = tick_of_time(0.05 * scene_.duration_s, period);
    stops_ = {early_at_, ticks_};
    if (is_plain()) {
      after_.emplace(2 * N, 2);
      quiet_from_ = tick_of_time(path_->end_s, period);
      stops_.push_back(quiet_from_);
    } else if (!World{scene_.environment}.surfaces.empty()) {
      double from_s = 0.0;
      std::int64_t from = 0;
      for (const double until_s : twoport::lab::parts(path_->segment_ends_s, end_s_)) {
        const std::int64_t until = std::min(tick_from(to_duration(until_s), period_ns_), ticks_);
        const std::int64_t late = tick_of_time(0.5 * (from_s + until_s), period);
        parts_.push_back({from, late, until, until_s});
        stops_.push_back(until), stops_.push_back(late);
        from_s = until_s, from = until;
      }
    }
    const auto all_rests = rests(scene_);
    for (const Rest& r : *all_rests) {
      rests_.emplace_back(tick_of_time(r.from_s, period), tick_of_time(r.to_s, period));
      stops_.push_back(rests_.back().first), stops_.push_back(rests_.back().second);
    }
    for (int way = 0; way < 2; ++way)
      for (const auto& [a, b] : blackouts_[way]) stops_.push_back(a + lag_[way]), stops_.push_back(b + lag_[way]);
    std::erase_if(stops_, [&](std::int64_t k) { return k > ticks_; });
    std::sort(stops_.begin(), stops_.end());
    stops_.erase(std::unique(stops_.begin(), stops_.end()), stops_.end());
  }
  void set_flags(std::int64_t k) {
    p.late = part_ < parts_.size() && k >= parts_[part_].late ? 1.0 : 0.0;
    p.at_rest = 0.0;
    for (const auto& [from, to] : rests_)
      if (k >= from && k < to) p.at_rest = 1.0;
    set_blackouts(k, std::numeric_limits<std::int64_t>::max());
  }

  /// E(0) of both sides and what robot and environment hold, as LinkLoop's.
  [[nodiscard]] Energy granted() const {
    const Registration<N> registration{scene_.control};
    const RobotSpec& robot = *scene_.robot;
    const Velocity<N> v{vector<N>(robot.velocity_m_per_s)};
    const double kinetic = 0.5 * robot.mass_kg * v.vec().squaredNorm();
    const Energy held =
        Energy{kinetic} + Environment<N>{scene_.environment, scene_.tool}.potential(position<N>(robot.position_m));
    const Energy own = scene_.control.initial_energy;
    return own + registration.to_master(own + held);
  }

  /// Is everything finite that a figure is made of? A run in which something is not is run again alone.
  [[nodiscard]] bool finite() const {
    double sum =
        t.force_error2 + t.chatter2 + t.dissipated + t.position_error2 + t.contact_turn2 + t.error2 + t.pressed;
    const S& s = now.state;
    for (int i = 0; i < N; ++i)
      sum += s.master_x[i] + s.master_v[i] + s.slave_x[i] + s.slave_v[i] + s.held[i] + s.command[i];
    sum += s.master_energy + s.slave_absorbed + s.slave_returned;
    if (method_of(scene_) == LaneMethod::internal_model) {
      std::array<double, sizeof s.model / sizeof(double)> all;
      std::memcpy(all.data(), &s.model, sizeof s.model);
      for (const double each : all) sum += each;
    }
    return std::isfinite(sum);
  }

  [[nodiscard]] PacketCounts packets(int way) const {
    const S& s = now.state;
    PacketCounts n;
    n.sent = static_cast<std::uint64_t>(ended_at_);
    n.received = static_cast<std::uint64_t>(s.received[way]);
    if (n.received > 0) {
      const double newest = way == 0 ? s.master_heard_at : s.slave_heard_at;
      n.lost = static_cast<std::uint64_t>(newest - s.first_at[way] + 1.0) - n.received;
    }
    return n;
  }

  const Scene& scene_;
  VerdictFrom from_of_verdict_;
  bool twin_;
  std::int64_t period_ns_;
  std::shared_ptr<const Intended> path_;
  Plant plant_;
  std::unique_ptr<Nodes<N>> nodes_;
  std::int64_t lag_[2] = {1, 1}, first_force_lag_ = 1, ticks_ = 0, early_at_ = 0, ended_at_ = 0;
  double end_s_ = 0.0;
  std::size_t window_ = 1;
  std::vector<std::pair<std::int64_t, std::int64_t>> blackouts_[2], rests_;
  std::vector<RunPart> parts_;
  std::vector<std::int64_t> stops_;
  std::size_t part_ = 0, next_stop_ = 0;
  std::array<double, 2 * N> early_{};
  bool has_early_ = false, failed_ = false, judged_ = false;
  std::optional<double> held_ratio_;
  double pressed_ = 0.0, held_at_s_ = 0.0;
  std::optional<Snapshot<N>> held_;  ///< in contact
  const Snapshot<N>* from_ = nullptr;
  std::optional<Metrics<N>> metrics_;
  std::optional<TrendRecord> after_;  ///< plain verdict: the run since the path's end
  bool acted_after_ = false;
  std::int64_t quiet_from_ = std::numeric_limits<std::int64_t>::max();  ///< first tick of after_
  MotionScale scale_;
  std::optional<Verdict> verdict_;
};

/// The arrays of a batch, and what moves a cell into a lane and out of it.
template <int N>
class Lanes {
 public:
  using Of = Cell<N>;
  static constexpr std::size_t kParameters = sizeof(Parameters<double, N>) / sizeof(double),
                               kState = sizeof(State<double, N>) / sizeof(double),
                               kSums = sizeof(Sums<double, N>) / sizeof(double);

  /// For scenes of the shape of `scene`, with rings for packets of so many ticks, and for the window.
  Lanes(const Unit& unit, const Scene& scene, std::int64_t oldest, std::size_t window, bool tail, bool records)
      : unit_{unit} {
    const ControlOptions& c = scene.control;
    b.method = method_of(scene);
    if (b.method == LaneMethod::nodes) oldest = 1;  // they have their own packets
    b.projected = c.controller.method == Method::force_projected;
    b.unilateral = c.controller.unilateral;
    b.predict = c.controller.predict;
    b.keeps_deficit = c.controller.method != Method::classic;
    b.measured = returns_measured_force(c);
    b.drift_compensation = c.coupling.drift_compensation;
    b.hand = true;
    b.substeps = scene.simulation.integrator == Integrator::rk4 ? scene.simulation.substeps : 0;
    b.slave_nodes = [](Batch& of, double* numbers) {
      auto& lanes = *static_cast<Lanes*>(of.owner);
      for (int lane = 0; lane < lanes.width(); ++lane)
        if (lanes.nodes[lane] != nullptr)
          lanes.nodes[lane]->slave_tick(numbers + lane, static_cast<std::size_t>(lanes.width()));
    };
    b.master_nodes = [](Batch& of, double* numbers) {
      auto& lanes = *static_cast<Lanes*>(of.owner);
      for (int lane = 0; lane < lanes.width(); ++lane)
        if (lanes.nodes[lane] != nullptr)
          lanes.nodes[lane]->master_tick(numbers + lane, static_cast<std::size_t>(lanes.width()));
    };
    const World world{scene.environment};
    b.wall = !world.surfaces.empty();
    b.keeps_states = !tail && !records;
    b.springs = static_cast<int>(world.springs.size());
    b.plant_step = Of::step_plant;
    b.squared_angle = [](const double* u, const double* f, double u2, double f2) {
      using Vector = typename HeldForce<N>::Vector;
      return squared_angle(Vector{Eigen::Map<const Vector>{u}}, Vector{Eigen::Map<const Vector>{f}}, u2, f2);
    };
    b.window_ended = [](Batch& of, int lane) { static_cast<Lanes*>(of.owner)->end_window(lane); };
    b.owner = this;
    b.slots = static_cast<std::int64_t>(std::bit_ceil(static_cast<std::uint64_t>(oldest + 2)));
    b.window_slots = static_cast<std::int64_t>(std::bit_ceil(window + 1));
    b.clock = oldest + 1;
    const auto w = static_cast<std::size_t>(unit.lanes), slots = static_cast<std::size_t>(b.slots);
    b.parameters = take(0, kParameters * w), b.state = take(1, kState * w), b.sums = take(2, kSums * w);
    b.to_slave = take(3, slots * words_to_slave(N, b.method) * w), b.to_master = take(4, slots * words_to_master(N, b.method) * w);
    if (!tail) b.window = take(5, static_cast<std::size_t>(b.window_slots) * 2 * N * w);
    if (records) b.record = take(6, kRecordRows * words_of_record(N) * w);
  }
  Lanes(const Lanes&) = delete;
  Lanes& operator=(const Lanes&) = delete;

  [[nodiscard]] int width() const { return unit_.lanes; }

  void set_parameters(int lane, const Of& cell) { put(b.parameters, lane, &cell.p, kParameters); }
  void set_state(int lane, const State<double, N>& state) { put(b.state, lane, &state, kState); }
  void set_sums(int lane, const Of& cell) { put(b.sums, lane, &cell.t, kSums); }
  void get_state(int lane, State<double, N>& state) const { get(b.state, lane, &state, kState); }
  void get_sums(int lane, Of& cell) const { get(b.sums, lane, &cell.t, kSums); }
  void set_packets(int lane, const Snapshot<N>& from) {
    set_ring(b.to_slave, words_to_slave(N, b.method), lane, from.to_slave);
    set_ring(b.to_master, words_to_master(N, b.method), lane, from.to_master);
  }
  void get_packets(int lane, Snapshot<N>& into, std::int64_t ages) const {
    get_ring(b.to_slave, words_to_slave(N, b.method), lane, into.to_slave, ages);
    get_ring(b.to_master, words_to_master(N, b.method), lane, into.to_master, ages);
  }
  /// A lane of which nobody wants anything: the same as another one. Its own packets serve it once they are finite.
  void copy_lane(int to, int from, bool with_packets) {
    copy(b.parameters, kParameters, to, from);
    copy(b.state, kState, to, from);
    copy(b.sums, kSums, to, from);
    if (with_packets) {
      copy(b.to_slave, static_cast<std::size_t>(b.slots) * words_to_slave(N, b.method), to, from);
      copy(b.to_master, static_cast<std::size_t>(b.slots) * words_to_master(N, b.method), to, from);
    }
    b.path[to] = b.path[from];
    b.plant[to] = b.plant[from];
    nodes[to] = nullptr;
  }
  void lanes_changed() {
    Parameters<double, N> one;
    State<double, N> first;
    bool lossy[2]{}, bursts[2]{}, same[2]{true, true};
    b.together = true;
    double lag[2]{}, k = 0.0;
    for (int lane = 0; lane < width(); ++lane) {
      get(b.parameters, lane, &one, kParameters);
      get(b.state, lane, &first, kState);
      for (int way = 0; way < 2; ++way) {
        const bool burst = one.burst_p[way] > 0.0 || one.burst_good[way] > 0.0;
        bursts[way] |= burst;
        lossy[way] |= burst || one.loss[way] > 0.0 || one.blackout[way] != 0.0;
        if (lane > 0) same[way] &= one.lag[way] == lag[way];
        lag[way] = one.lag[way];
      }
      if (lane > 0) b.together = b.together && b.path[lane] == b.path[0] && first.k == k;
      k = first.k;
    }
    for (int way = 0; way < 2; ++way)
      b.lossy[way] = lossy[way], b.bursts[way] = bursts[way], b.one_lag[way] = same[way];
  }
  /// The ratio of the newest window of a lane, if it counts: HeldForce.
  [[nodiscard]] std::optional<double> ratio(int lane, std::size_t window, std::size_t next) const {
    using Vector = typename HeldForce<N>::Vector;
    Vector felt = Vector::Zero(), reference = Vector::Zero();
    for (std::size_t i = 0; i < window; ++i) {
      // In the order of the circle: the newest is before `next`.
      const std::size_t age = (next + window - 1 - i) % window;
      const std::int64_t slot = (b.clock - 1 - static_cast<std::int64_t>(age)) & (b.window_slots - 1);
      const double* row = b.window + slot * 2 * N * width() + lane;
      for (int j = 0; j < N; ++j) felt[j] += row[j * width()], reference[j] += row[(N + j) * width()];
    }
    const double held = reference.norm();
    if (!(held > HeldForce<N>::kLeast * static_cast<double>(window))) return std::nullopt;
    return felt.norm() / held;
  }
  void end_window(int lane) {
    Of* cell = cell_of[lane];
    if (cell == nullptr) return;
    get_sums(lane, *cell);
    if (const auto mean = ratio(lane, cell->window(), static_cast<std::size_t>(cell->t.held_next)))
      cell->keep_ratio(*mean);
  }

  Batch b{};
  Of* cell_of[kMostLanes]{};
  Nodes<N>* nodes[kMostLanes]{};  ///< LaneMethod::nodes; null in a lane of which nobody wants anything

 private:
  double* take(std::size_t which, std::size_t n) {
    memory_[which].resize(n);
    return memory_[which].get();
  }
  void put(double* into, int lane, const void* from, std::size_t fields) {
    const auto* numbers = static_cast<const double*>(from);
    for (std::size_t i = 0; i < fields; ++i)
      into[i * static_cast<std::size_t>(width()) + static_cast<std::size_t>(lane)] = numbers[i];
  }
  void get(const double* from, int lane, void* into, std::size_t fields) const {
    auto* numbers = static_cast<double*>(into);
    for (std::size_t i = 0; i < fields; ++i)
      numbers[i] = from[i * static_cast<std::size_t>(width()) + static_cast<std::size_t>(lane)];
  }
  void copy(double* of, std::size_t fields, int to, int from) {
    for (std::size_t i = 0; i < fields; ++i) {
      double* row = of + i * static_cast<std::size_t>(width());
      row[to] = row[from];
    }
  }
  [[nodiscard]] double* slot(double* ring, std::int64_t age, int words) const {
    return ring + ((b.clock - age) & (b.slots - 1)) * words * width();
  }
  void set_ring(double* ring, int words, int lane, const std::vector<double>& from) {
    const auto ages = static_cast<std::int64_t>(from.size()) / words;
    for (std::int64_t age = 1; age <= ages; ++age)
      put(slot(ring, age, words), lane, from.data() + (age - 1) * words, static_cast<std::size_t>(words));
  }
  void get_ring(double* ring, int words, int lane, std::vector<double>& into, std::int64_t ages) const {
    into.resize(static_cast<std::size_t>(ages * words));
    for (std::int64_t age = 1; age <= ages; ++age)
      get(slot(ring, age, words), lane, into.data() + (age - 1) * words, static_cast<std::size_t>(words));
  }

  const Unit& unit_;
  Numbers64 memory_[7];
};

/// Scenes of one shape, by delay: lanes with the same delays read their packets from the same slot. Threads take the next one.
class Queue {
 public:
  explicit Queue(std::span<const Scene* const> scenes) : scenes_{scenes} {
    std::vector<std::pair<std::int64_t, std::int64_t>> lags;
    for (const Scene* scene : scenes) {
      lags.emplace_back(lag_of(scene->to_slave, period_of(*scene)), lag_of(scene->to_master, period_of(*scene)));
      oldest_ = std::max(oldest_, oldest_of(*scene));
      window_ = std::max(window_, window_of(*scene));
      order_.push_back(order_.size());
    }
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) { return lags[a] < lags[b]; });
  }
  /// The number of a scene that nobody has taken.
  std::optional<std::size_t> take() {
    const std::size_t i = next_.fetch_add(1);
    return i < order_.size() ? std::optional{order_[i]} : std::nullopt;
  }
  [[nodiscard]] const Scene& scene(std::size_t number) const { return *scenes_[number]; }
  [[nodiscard]] std::int64_t oldest() const { return oldest_; }
  [[nodiscard]] std::size_t window() const { return window_; }

 private:
  std::span<const Scene* const> scenes_;
  std::vector<std::size_t> order_;
  std::int64_t oldest_ = 0;
  std::size_t window_ = 0;
  std::atomic<std::size_t> next_{0};
};

/// Runs cells, a lane each.
template <int N>
class Runs {
 public:
  using Of = std::unique_ptr<Cell<N>>;

  Runs(const Unit& unit, const Queue& queue, VerdictFrom verdict)
      : unit_{unit}, lanes_{unit,           queue.scene(0), queue.oldest(),
                            queue.window(), false,          verdict == VerdictFrom::plain} {}

  [[nodiscard]] bool empty() const { return cells_ == 0; }
  [[nodiscard]] bool has_room() const { return cells_ < lanes_.width(); }
  void add(Of cell) {
    int lane = 0;
    while (cell_[lane] != nullptr) ++lane;
    ++cells_;
    lanes_.cell_of[lane] = cell.get();
    k_[lane] = 0;
    if (!cell->at_stop(0, [] {})) cell->fail();
    lanes_.set_parameters(lane, *cell);
    lanes_.set_state(lane, cell->now.state);
    lanes_.set_sums(lane, *cell);
    lanes_.b.path[lane] = cell->path();
    lanes_.b.plant[lane] = &cell->plant();
    lanes_.nodes[lane] = cell->nodes();
    idle_[lane] = false;
    cell_[lane] = std::move(cell);
  }
  /// Ticks until something happens in a lane. Calls ended(cell) for each cell that has ended.
  template <class Ended>
  void step(Ended ended) {
    const auto start = std::chrono::steady_clock::now();
    Batch& b = lanes_.b;
    int active = -1;
    std::int64_t n = std::numeric_limits<std::int64_t>::max();
    bool recorded[kMostLanes]{};
    b.records = false;
    for (int lane = 0; lane < lanes_.width(); ++lane) {
      if (cell_[lane] == nullptr) continue;
      active = lane, n = std::min(n, cell_[lane]->next_stop() - k_[lane]);
      recorded[lane] = cell_[lane]->is_recorded(k_[lane]);
      b.records |= recorded[lane];
    }
    if (b.records) n = std::min(n, kRecordRows);
    b.record_row = 0;
    for (int lane = 0; lane < lanes_.width(); ++lane)
      if (cell_[lane] == nullptr) lanes_.copy_lane(lane, active, !std::exchange(idle_[lane], true));
    lanes_.lanes_changed();
    const std::int64_t done = unit_.run[N == 1 ? 0 : 1](b, n);
    spent_ += std::chrono::steady_clock::now() - start;
    ticks_ += done * cells_;
    for (int lane = 0; lane < lanes_.width(); ++lane) {
      Cell<N>* const cell = cell_[lane].get();
      if (cell == nullptr) continue;
      k_[lane] += done;
      if (recorded[lane])
        cell->add_recorded(b.record + lane, static_cast<std::size_t>(lanes_.width()), static_cast<std::size_t>(done));
      const bool diverged = (b.diverged >> lane & 1U) != 0;
      if (!diverged && k_[lane] < cell->next_stop()) continue;
      lanes_.get_state(lane, cell->now.state);
      lanes_.get_sums(lane, *cell);
      const auto packets = [&] {
        if (cell->nodes() != nullptr) return cell->keep_nodes();
        lanes_.get_packets(lane, cell->now, std::min(cell->oldest(), k_[lane]));
      };
      const bool goes_on = !diverged && cell->at_stop(k_[lane], packets);
      if (goes_on) {
        lanes_.set_parameters(lane, *cell);
        lanes_.set_sums(lane, *cell);
        continue;
      }
      if (!cell->is_plain()) packets();
      std::optional<double> ratio;
      if (cell->t.held_ticks >= static_cast<double>(cell->window()))
        ratio = lanes_.ratio(lane, cell->window(), static_cast<std::size_t>(cell->t.held_next));
      cell->end(k_[lane], diverged, ratio);
      lanes_.cell_of[lane] = nullptr;
      --cells_;
      ended(std::move(cell_[lane]));
    }
  }
  /// Wall time of a tick, of one cell.
  [[nodiscard]] double step_ns() const {
    return spent_.count() / static_cast<double>(std::max<std::int64_t>(ticks_, 1));
  }

 private:
  const Unit& unit_;
  Lanes<N> lanes_;
  Of cell_[kMostLanes];
  bool idle_[kMostLanes]{};
  std::int64_t k_[kMostLanes]{}, ticks_ = 0;
  int cells_ = 0;
  std::chrono::duration<double, std::nano> spent_{0};
};

/// Judges cells that have ended: a tail in a lane, and its twin in another one.
template <int N>
class Tails {
 public:
  using Of = std::unique_ptr<Cell<N>>;

  Tails(const Unit& unit, const Queue& queue)
      : unit_{unit}, lanes_{unit, queue.scene(0), queue.oldest(), queue.window(), true, true} {
    for (int lane = lanes_.width(); lane-- > 0;) free_.push_back(lane);
  }

  void add(Of cell) { waiting_.push_back(std::move(cell)); }
  [[nodiscard]] bool empty() const { return tails_.empty() && waiting_.empty(); }
  /// Is there so much to do that no lane is idle?
  [[nodiscard]] bool is_full() {
    fill();
    return free_.empty() || !waiting_.empty();
  }
  /// Ticks until something happens in a lane. Calls judged(cell) for each cell that has a verdict, or has failed.
  template <class Judged>
  void step(Judged judged) {
    fill();
    std::int64_t n = kRecordRows;
    for (const Tail& tail : tails_) {
      const std::int64_t now = tail.from + tail.ticks;
      n = std::min({n, static_cast<std::int64_t>(tail.judge->stage_ends()) - tail.ticks,
                    tail.cell->blackouts_change(now, tail.from) - now});
    }
    for (const int lane : free_) lanes_.copy_lane(lane, tails_.front().lane, !std::exchange(idle_[lane], true));
    lanes_.lanes_changed();
    lanes_.b.record_row = 0;
    unit_.tail[N == 1 ? 0 : 1](lanes_.b, n);
    std::size_t kept = 0;
    for (Tail& tail : tails_) {
      if (goes_on(tail, n)) {
        if (&tails_[kept] != &tail) tails_[kept] = std::move(tail);
        ++kept;
        continue;
      }
      free_.push_back(tail.lane);
      if (tail.twin >= 0) free_.push_back(tail.twin);
      if (!tail.cell->failed() && tail.again) {
        waiting_.push_front(std::move(tail.cell));
      } else {
        judged(*tail.cell);
      }
    }
    tails_.erase(tails_.begin() + static_cast<std::ptrdiff_t>(kept), tails_.end());
  }

 private:
  struct Tail {
    Of cell;
    std::unique_ptr<TailJudge<N>> judge;
    int lane = -1, twin = -1;  ///< twin: -1 if there is none, or none is wanted any longer
    std::int64_t from = 0, ticks = 0;
    bool again = false;  ///< the cell has another tail
  };

  void fill() {
    while (!waiting_.empty() && free_.size() >= (waiting_.front()->wants_twin() ? 2U : 1U)) {
      Tail tail;
      tail.cell = std::move(waiting_.front());
      waiting_.pop_front();
      tail.judge = tail.cell->begin_tail();
      const Snapshot<N>& from = tail.cell->tail_from();
      tail.from = static_cast<std::int64_t>(from.state.k);
      tail.cell->set_blackouts(tail.from, tail.from);
      tail.lane = take_lane(*tail.cell, from, from.state);
      if (tail.judge->has_twin())
        tail.twin = take_lane(*tail.cell, from, tail.cell->kicked(from.state, tail.judge->kick()));
      tails_.push_back(std::move(tail));
    }
  }
  int take_lane(Cell<N>& cell, const Snapshot<N>& from, const State<double, N>& state) {
    const int lane = free_.back();
    free_.pop_back();
    idle_[lane] = false;
    lanes_.set_parameters(lane, cell);
    lanes_.set_state(lane, state);
    lanes_.set_packets(lane, from);
    lanes_.b.path[lane] = cell.path();
    lanes_.b.plant[lane] = &cell.plant();
    if (from.nodes != nullptr) {
      nodes_[lane] = std::make_unique<Nodes<N>>(*from.nodes);
      nodes_[lane]->be_quiet();
      lanes_.nodes[lane] = nodes_[lane].get();
    }
    return lane;
  }
  /// After n ticks more. False: the tail has ended.
  bool goes_on(Tail& tail, std::int64_t n) {
    TailJudge<N>& judge = *tail.judge;
    const auto w = static_cast<std::size_t>(lanes_.width());
    bool finite = true;
    for (std::int64_t row = 0; row < n && !judge.diverged(); ++row) {
      const double* const rows = lanes_.b.record + static_cast<std::size_t>(row) * words_of_record(N) * w;
      const double* const at = rows + tail.lane;
      typename TailJudge<N>::Tick tick;
      typename TailJudge<N>::Speeds of_twin{};
      double sum = 0.0;
      for (std::size_t j = 0; j < 2 * N; ++j) {
        tick.v[j] = at[j * w];
        if (tail.twin >= 0) of_twin[j] = rows[j * w + static_cast<std::size_t>(tail.twin)];
        sum += tick.v[j] + of_twin[j];
      }
      tick.energies = {at[2 * N * w], at[(2 * N + 1) * w]};
      const auto events = static_cast<unsigned>(at[(2 * N + 2) * w]);
      tick.events = {.touching = (events & kTouching) != 0, .limited = (events & kLimited) != 0};
      tick.acted = (events & kActed) != 0, tick.driven = (events & kDriven) != 0;
      finite = finite && sum - sum == 0.0;
      if (!judge.see(tick)) break;
      if (tail.twin >= 0) {
        judge.add(tick, of_twin);
      } else {
        judge.add(tick);
      }
    }
    tail.ticks += n;
    if (!finite) {
      tail.cell->fail();
      return false;
    }
    if (!judge.has_twin() && judge.controller_acted()) {
      tail.cell->want_twin();
      tail.again = true;
      return false;
    }
    if (judge.diverged() || tail.ticks >= static_cast<std::int64_t>(judge.stage_ends())) {
      if (judge.decide()) {
        tail.again = tail.cell->end_tail(judge.verdict());
        return false;
      }
      if (judge.twin_parted() && tail.twin >= 0) free_.push_back(std::exchange(tail.twin, -1));
    }
    tail.cell->set_blackouts(tail.from + tail.ticks, tail.from);
    lanes_.set_parameters(tail.lane, *tail.cell);
    if (tail.twin >= 0) lanes_.set_parameters(tail.twin, *tail.cell);
    return true;
  }

  const Unit& unit_;
  Lanes<N> lanes_;
  std::vector<Tail> tails_;
  std::deque<Of> waiting_;
  std::vector<int> free_;
  std::unique_ptr<Nodes<N>> nodes_[kMostLanes];  ///< of the lane's tail or twin
  bool idle_[kMostLanes]{};
};

/// A thread's work: cells of the queue until there are none.
template <int N>
void run_queue(Queue& queue, const Unit& unit, const LaneOptions& o, const FinishedInLanes& finished) {
  Runs<N> runs{unit, queue, o.verdict};
  Tails<N> tails{unit, queue};
  std::map<std::string, std::weak_ptr<const Intended>> paths;
  std::shared_ptr<const Intended> path;  // of the newest cell: the next one's is often the same
  const auto finish = [&](const Cell<N>& cell) { finished(cell.number, cell.summary(runs.step_ns())); };
  const auto check = [&] {
    if (o.stop != nullptr && *o.stop) throw Stopped{};
  };
  for (;;) {
    check();
    while (runs.has_room()) {
      const std::optional<std::size_t> number = queue.take();
      if (!number) break;
      const Scene& scene = queue.scene(*number);
      const sim::SimDevice<N> device{scene, Seconds{1.0 / scene.master_rate_hz}};
      std::weak_ptr<const Intended>& known = paths[path_key(scene)];
      path = known.lock();
      if (!path)
        known = path = intended_of<N>(device, scene, tick_from(to_duration(scene.duration_s), period_of(scene)));
      runs.add(std::make_unique<Cell<N>>(*number, scene, o.verdict, device, path));
    }
    if (runs.empty() && tails.empty()) return;
    if (!runs.empty())
      runs.step([&](std::unique_ptr<Cell<N>> cell) {
        if (cell->needs_tails()) {
          tails.add(std::move(cell));
        } else {
          finish(*cell);
        }
      });
    while (tails.is_full() || (runs.empty() && !tails.empty())) {
      check();
      tails.step(finish);
    }
  }
}

const Unit* unit_of(int lanes) {
#if defined(__x86_64__)
  if (lanes == 8 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
    return &kAvx512;
  if (lanes == 4 && __builtin_cpu_supports("avx2")) return &kAvx2;
#endif
  return lanes == 2 ? &kBase : nullptr;
}

}  // namespace

int widest_lanes() {
  for (const int lanes : {8, 4})
    if (unit_of(lanes) != nullptr) return lanes;
  return 2;
}
std::string name_of_lanes(int lanes) {
  return unit_of(lanes)->name;
}
int checked_lanes(int lanes) {
  if (lanes == 0) return widest_lanes();
  if (lanes == 1 || unit_of(lanes) != nullptr) return lanes;
  throw ConfigError{
      fmt::format("--lanes {}: it must be 0 (as many as there are), 1, 2, 4 or 8, and at most {} on this processor",
                  lanes, widest_lanes())};
}

std::string why_not_in_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  const World world{scene.environment};
  if (scene.gripper) return "the scene has a gripper";
  if (c.architecture == Architecture::render || c.architecture == Architecture::uncontrolled)
    return "the scene has no link";
  if (scene.dof != 1 && scene.dof != 3) return "dof is 6";
  if (scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0) return "the slave's clock differs";
  if (scene.master_rate_hz != scene.slave_rate_hz) return "the rates of the sides differ";
  if (kNanosecondsPerSecond / scene.master_rate_hz != static_cast<double>(period_of(scene)))
    return "a tick is not a whole number of nanoseconds";
  const bool in_steps = scene.simulation.integrator == Integrator::rk4;
  if (scene.simulation.integrator != Integrator::exact && !in_steps) return "simulation.integrator is not EXACT or RK4";
  if (!scene.robot) return "the robot is ideal";
  if (world.surfaces.size() > 1 ||
      (world.surfaces.size() == 1 && !std::holds_alternative<Wall>(world.surfaces[0].shape)))
    return "the environment is more than one wall and springs";
  if (scene.dof == 3 && !in_steps && !world.surfaces.empty() && world.surfaces[0].material.friction != 0.0)
    return "the wall has friction, which simulation.integrator EXACT steps by itself";
  if (world.springs.size() > static_cast<std::size_t>(kMostSprings)) return "there are more than two springs";
  for (const Spring& s : world.springs)
    if (s.motion.amplitude_m != 0.0) return "an anchor moves";
  if (scene.robot->force_sensor) {
    const ForceSensorSpec& sensor = *scene.robot->force_sensor;
    if (sensor.noise_n > 0.0 || std::lround(sensor.latency_s * scene.slave_rate_hz) != 0)
      return "the force sensor has noise or latency";
  }
  if (!scene.operator_model || !scene.operator_model->hand) return "nobody holds the device with a hand's impedance";
  for (const double f : scene.operator_model->hand->force_n)
    if (f != 0.0) return "the hand has a constant force";
  for (const SegmentSpec& s : scene.operator_model->path)
    if (std::holds_alternative<RecordedHandSpec>(s) || std::holds_alternative<MultiSineSpec>(s))
      return "the operator's path is a recording";
  const double device_kg = scene.device ? scene.device->mass_kg : 0.0;
  if (!(device_kg + scene.operator_model->hand->mass_kg > 0.0)) return "the handle has no mass";
  if (scene.device) {
    if (scene.device->coulomb_friction_n != 0.0) return "the device has Coulomb friction";
    if (scene.device->position_resolution_m != 0.0 ||
        scene.device->velocity_estimate != VelocityEstimate::true_velocity)
      return "the device has encoders";
  }
  if (c.registration.absolute || !c.registration.rotation.normalized().toRotationMatrix().isIdentity(0.0))
    return "the registration is absolute or turned";
  if (!(scene.duration_s * scene.master_rate_hz <= kMostTicks)) return "the run is very long";
  return {};
}

std::string shape_of_lanes(const Scene& scene) {
  const ControlOptions& c = scene.control;
  const World world{scene.environment};
  const LaneMethod method = method_of(scene);
  std::string shape =
      fmt::format("{} {} {} {} {}", scene.dof, static_cast<int>(method), world.surfaces.size(), world.springs.size(),
                  scene.simulation.integrator == Integrator::rk4 ? scene.simulation.substeps : 0);
  if (method == LaneMethod::internal_model) {
    shape += returns_measured_force(c) ? " measured" : "";
    shape += c.coupling.drift_compensation ? " 1" : " 0";
  } else if (method != LaneMethod::nodes)
    shape += fmt::format(" {}{}{}{}{}", static_cast<int>(c.controller.method), c.controller.unilateral ? 1 : 0,
                         c.controller.predict ? 1 : 0, returns_measured_force(c) ? 1 : 0,
                         c.coupling.drift_compensation ? 1 : 0);
  return shape;
}

void run_in_lanes(std::span<const Scene* const> scenes, const LaneOptions& o, const FinishedInLanes& finished) {
  if (scenes.empty()) return;
  const Unit& unit = *unit_of(o.lanes);
  Queue queue{scenes};
  // A thread for fewer cells than it has lanes would step empty ones.
  const auto lanes = static_cast<std::size_t>(o.lanes), threads = static_cast<std::size_t>(std::max(o.jobs, 1));
  for_each_parallel(std::min(threads, (scenes.size() + lanes - 1) / lanes), o.jobs, [&](std::size_t) {
    if (scenes.front()->dof == 1) {
      run_queue<1>(queue, unit, o, finished);
    } else {
      run_queue<3>(queue, unit, o, finished);
    }
  });
}

}  // namespace lab
}  // namespace twoport
