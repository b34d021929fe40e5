#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/low_pass.h"
#include "common/base/time.h"
#include "common/contact/environment.h"
#include "common/method/transparency/internal_model/slave.h"
#include "common/passivity/velocity_predictor.h"
#include "common/record/metrics.h"
#include "common/record/run_judge.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/linked_nodes.h"
#include "lab/engine/summary_parts.h"
#include "lab/engine/tail_judge.h"
#include "lab/lanes/batch.h"
#include "lab/lanes/taken.h"
#include "lab/mechanical_energy.h"
#include "lab/run.h"
#include "sim/operator/path.h"
#include "sim/plant/exact_wall.h"
#include "sim/sim_device.h"

namespace twoport::lab::lanes {

/// LinkedNodes without the plants, for LaneMethod::nodes. Copies are independent.
template <int N>
class Nodes {
 public:
  explicit Nodes(const Scene& scene)
      : rate_hz_{scene.master_rate_hz},
        nodes_{scene},
        held_by_environment_{!World{scene.environment}.springs.empty()} {}

  void be_quiet() noexcept { nodes_.be_quiet(); }
  [[nodiscard]] LinkUse use() const { return nodes_.use(); }

  /// A tick: every `width`-th of `numbers` is of this simulation, as numbers_of_slave() and numbers_of_master() name them.
  void slave_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    const Force<N> environment{vector_at(numbers + 2 * N * width, width)};
    touching_ = held_by_environment_ || environment.squared_norm() > 0.0;
    GivenReading<RobotSample<N>> robot{{Position<N>{vector_at(numbers, width)},
                                        Velocity<N>{vector_at(numbers + N * width, width)},
                                        Force<N>{bias_ - environment.vec()}, false}};
    const auto out = nodes_.slave_tick(robot, {tick_time(slave_ticks_++, rate_hz_)}, environment);
    for (std::size_t i = 0; i < N; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      at(3 * N + i) = out.command.f[static_cast<int>(i)];
      at(4 * N + i) = nodes_.slave.position_error()[static_cast<int>(i)];
      at(5 * N + i) = nodes_.origin()[k];
    }
    at(6 * N) = nodes_.slave.delivered().si();
    at(6 * N + 1) = static_cast<double>(out.mode);
    at(6 * N + 2) = out.dissipated.si();
  }
  void master_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    GivenReading<DeviceSample<N>> device{{Position<N>{vector_at(numbers, width)},
                                          Velocity<N>{vector_at(numbers + N * width, width)},
                                          Force<N>{vector_at(numbers + 2 * N * width, width)}}};
    const auto out = nodes_.master_tick(device, {tick_time(ticks_++, rate_hz_)});
    for (std::size_t i = 0; touching_ && i < figures_.size(); ++i) figures_[i] += out.figures[i];
    for (std::size_t i = 0; i < N; ++i) {
      const int k = static_cast<int>(i);
      at(2 * N + i) = out.command[k];
      at(3 * N + i) = out.wanted[k];
      at(4 * N + i) = nodes_.delayed_force()[k];
    }
    at(5 * N) = nodes_.master.observed().si();
    at(5 * N + 1) = static_cast<double>(out.mode);
    at(5 * N + 2) = out.dissipated.si();
    at(5 * N + 3) = out.undissipated.si();
  }
  /// Sums over ticks in contact.
  [[nodiscard]] const LayerFigures& figures() const { return figures_; }
  /// Of the force sensor.
  void set_bias(const typename Force<N>::Vector& bias) { bias_ = bias; }

 private:
  static typename Force<N>::Vector vector_at(const double* numbers, std::size_t width) {
    typename Force<N>::Vector v;
    for (int i = 0; i < N; ++i) v[i] = numbers[static_cast<std::size_t>(i) * width];
    return v;
  }

  double rate_hz_;
  LinkedNodes<N> nodes_;
  bool held_by_environment_, touching_ = false;
  LayerFigures figures_{};
  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  std::int64_t ticks_ = 0, slave_ticks_ = 0;
};

/// What the operator's intended positions follow from.
inline std::string path_key(const Scene& scene) {
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
  std::vector<sim::SegmentTimes> segments;
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
  all->segments = path.segment_times();
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
inline std::int64_t tick_of_time(double t_s, double period_ns) {
  if (!(t_s > 0.0)) return 0;
  if (!(t_s < 1e9)) return std::numeric_limits<std::int64_t>::max() / 2;
  const auto at = [&](std::int64_t k) { return static_cast<double>(k) * period_ns / kNanosecondsPerSecond; };
  auto k = static_cast<std::int64_t>(t_s * kNanosecondsPerSecond / period_ns);
  while (k > 0 && at(k - 1) >= t_s) --k;
  while (at(k) < t_s) ++k;
  return k;
}
/// The first tick that begins at `t` or later.
inline std::int64_t tick_from(Duration t, std::int64_t period_ns) {
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
        method_{method_of(scene)},
        period_ns_{period_of(scene)},
        path_{std::move(path)},
        plant_{*scene.robot,
               World{scene.environment},
               1.0 / scene.slave_rate_hz,
               {position<N>(scene.robot->position_m), Velocity<N>{vector<N>(scene.robot->velocity_m_per_s)}}} {
    std::memset(&p, 0, sizeof p);
    std::memset(&t, 0, sizeof t);
    std::memset(&now.state, 0, sizeof now.state);
    if (method_ == LaneMethod::nodes) nodes_ = std::make_unique<Nodes<N>>(scene);
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
  /// A recorded tick: its row, of which every `width`-th number is this lane's.
  void add_recorded(const double* row, std::size_t width) {
    std::array<double, 2 * N> v;
    for (std::size_t j = 0; j < 2 * N; ++j) v[j] = row[j * width];
    const std::array energies{row[2 * N * width], row[2 * N * width], row[(2 * N + 2) * width],
                              row[(2 * N + 3) * width]};
    const auto events = static_cast<unsigned>(row[(2 * N + 4) * width]);
    after_->add(v, energies, {.touching = (events & kTouching) != 0, .limited = (events & kLimited) != 0});
    acted_after_ = acted_after_ || (events & kActed) != 0;
  }
  void keep_ratio(double ratio) { held_ratio_ = ratio; }

  /// Tick `k`, a stop, begins; the lane's state is in `now` and `t`. Sets the parameters that change.
  /// `snapshot` fills now.to_slave and now.to_master. False: the run has ended.
  template <class Fill>
  bool at_stop(std::int64_t k, Fill snapshot) {
    if (k == early_at_ && k < ticks_) {
      std::copy_n(t.speed, 2 * N, early_.emplace().begin());
    }
    while (part_ < parts_.size()) {
      const RunPart& part = parts_[part_];
      if (k >= part.quarter && !in_quarter_) {
        in_quarter_ = true;
        states_.begin_quarter(part.of, take_touched(), t.pressed);
      }
      if (k < part.until) break;
      states_.end(part.of, take_touched(), t.pressed, part.of.until_s >= end_s_, [&] {
        snapshot();
        return now;
      });
      in_quarter_ = false;
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
    failed_ = !holds();
    if (failed_) return;
    Metrics<N>& m =
        metrics_.emplace(metrics_of<N>(scene_, true, path_->end_s, scene_.control.initial_energy.si(), false));
    const auto rows = static_cast<std::uint64_t>(k);
    const double last_s = static_cast<double>((k - 1) * period_ns_) / kNanosecondsPerSecond;
    m.set(t, rows, last_s);
    m.contact().set(t, held_ratio_, nodes_ ? nodes_->figures() : LayerFigures{});
    m.judge().set(t, rows, early_, diverged ? std::optional{last_s} : std::nullopt);
    if (is_plain()) {
      m.judge().set_after(std::move(*after_), acted_after_, now.state.master_energy);
      return;
    }
    judged_ = !diverged && m.judge().not_judged().empty();
    if (judged_) scale_ = m.judge().scale();
  }
  [[nodiscard]] bool needs_tails() const { return judged_ && !failed_; }

  /// Begins the tail of the end, then those of the states in contact; without a twin where wants_twin() is false.
  std::unique_ptr<TailJudge<N>> begin_tail() {
    const auto states = states_.all();
    from_ = judging_ > 0 ? &*states[judging_ - 1]->at : &now;
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
    to_plant(s.slave_x.e, s.slave_v.e, s.across, s.in_contact);
    plant_.kick(by.second);
    from_plant(s.slave_x.e, s.slave_v.e, s.across, s.in_contact);
    return s;
  }
  /// Takes the verdict of a tail. True: another one is needed.
  bool end_tail(const Verdict& verdict) {
    const auto states = states_.all();
    if (judging_ == 0) {
      verdict_ = verdict;
    } else {
      keep_worse(*verdict_, verdict, states[judging_ - 1]->at_s);
    }
    twin_ = from_of_verdict_ != VerdictFrom::lean;
    return verdict_->kind != VerdictKind::unstable && judging_++ < states.size();
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
    std::int64_t looks, quarter, until;
    Part of;
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
    const World world{scene_.environment};
    for (int k = 0; const Spring& s : world.springs) {
      p.spring_stiffness[k] = s.stiffness_n_per_m, p.spring_damping[k] = s.damping_n_s_per_m;
      for (int i = 0; i < N; ++i) p.spring_anchor[k][i] = s.anchor_m[i];
      ++k;
    }
    for (int i = 0; i < N; ++i) p.pull[i] = plant_.pull()[i];
    set_region(0);
    if (!world.surfaces.empty()) {
      const Surface& w = world.surfaces[0];
      const Wall& plane = std::get<Wall>(w.shape);
      for (int i = 0; i < N; ++i) p.normal[i] = plane.normal[i];
      p.offset = plane.offset_m;
      p.wall_stiffness = w.material.stiffness_n_per_m, p.wall_damping = w.material.damping_n_s_per_m;
      p.wall_viscous = w.material.viscous_friction_n_s_per_m, p.wall_friction = w.material.friction;
      set_region(1);
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
    p.most_silence_ns = static_cast<double>(to_duration(c.hold_after.si()).count() / 2);
    p.ramp_by = c.engage > Seconds{} ? dt / c.engage.si() : 1.0;
    p.most_force = limits_at_device(c).force_n;
    p.initial_energy = c.initial_energy.si();
    p.most_gain = c.controller.max_gain;
    p.response = c.handle_mass_kg > 0.0 ? 0.5 * dt * (1.0 / c.handle_mass_kg) : 0.0;
    p.worst_of_hand = p.response * kHandForceChange_n;
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
    }
    first_force_lag_ = first_force_lag_of(scene_);
    if (method_ == LaneMethod::internal_model) set_internal_model();
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
    m.scale_slow = m.shown = 1.0;
    m.level = 1e-5;
  }

  /// A tick that is cut into parts is left to the plant; the map of a whole one then does not matter.
  void set_region(int in) {
    const auto& region = plant_.region(in != 0);
    for (int i = 0; i < 2; ++i) {
      p.map_x[in][i] = region.map.x[i];
      p.map_v[in][i] = region.map.v[i];
      p.map_u[in][i] = region.map.u[i];
    }
    p.load[in] = region.load;
    p.in_parts[in] = region.span < p.dt ? 1.0 : 0.0;
    p.along_stiffness[in] = region.along.stiffness_n_per_m;
    p.along_xv[in] = region.full_along.xv, p.along_xu[in] = region.full_along.xu;
    p.along_vv[in] = region.full_along.vv, p.along_vu[in] = region.full_along.vu;
  }

  void start(const sim::SimDevice<N>& device) {
    S& s = now.state;
    for (int i = 0; i < N; ++i) {
      s.master_x[i] = device.x().translation()[i], s.master_v[i] = device.v()[i];
      s.intended[i] = path_->x[static_cast<std::size_t>(i)];
    }
    from_plant(s.slave_x.e, s.slave_v.e, s.across, s.in_contact);
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

  /// Stops: where a part of the run ends or becomes late, a rest begins or ends, the early part ends.
  void plan() {
    const double period = static_cast<double>(period_ns_);
    const Duration end = to_duration(scene_.duration_s);
    ticks_ = tick_from(end, period_ns_);
    end_s_ = to_seconds(end).si();
    early_at_ = tick_of_time(0.05 * scene_.duration_s, period);
    stops_ = {early_at_, ticks_};
    if (is_plain()) {
      after_.emplace(2 * N, 4);
      quiet_from_ = tick_of_time(path_->end_s, period);
      stops_.push_back(quiet_from_);
    } else if (!World{scene_.environment}.surfaces.empty()) {
      for (const Part& part : twoport::lab::parts(path_->segments, end_s_)) {
        const RunPart& in =
            parts_.emplace_back(RunPart{.looks = tick_of_time(part.looks_from_s(), period),
                                        .quarter = tick_of_time(part.quarter_s(), period),
                                        .until = std::min(tick_from(to_duration(part.until_s), period_ns_), ticks_),
                                        .of = part});
        stops_.insert(stops_.end(), {in.looks, in.quarter, in.until});
      }
    }
    const auto all_rests = rests(scene_);
    for (const Rest& r : *all_rests) {
      rests_.emplace_back(tick_of_time(r.from_s, period), tick_of_time(r.to_s, period));
      stops_.push_back(rests_.back().first), stops_.push_back(rests_.back().second);
    }
    std::erase_if(stops_, [&](std::int64_t k) { return k > ticks_; });
    std::sort(stops_.begin(), stops_.end());
    stops_.erase(std::unique(stops_.begin(), stops_.end()), stops_.end());
  }
  /// What was touched since the last call: the set of the one surface.
  std::uint64_t take_touched() {
    t.late_ticks = 0.0;
    return std::exchange(t.touched, 0.0) != 0.0 ? 1 : 0;
  }
  void set_flags(std::int64_t k) {
    p.late = part_ < parts_.size() && (k >= parts_[part_].looks || states_.waits()) ? 1.0 : 0.0;
    p.at_rest = 0.0;
    for (const auto& [from, to] : rests_)
      if (k >= from && k < to) p.at_rest = 1.0;
  }

  /// E(0) of both sides and what robot and environment hold, as LinkLoop's.
  [[nodiscard]] Energy granted() const {
    const Registration<N> registration{scene_.control};
    const RobotSpec& robot = *scene_.robot;
    const Energy own = scene_.control.initial_energy;
    return own +
           registration.to_master(own + mechanical_energy<N>(robot, Environment<N>{scene_.environment, scene_.tool},
                                                             position<N>(robot.position_m),
                                                             Velocity<N>{vector<N>(robot.velocity_m_per_s)}));
  }

  /// Is everything finite that a figure is made of, and was no side silent? Else it is run again alone.
  [[nodiscard]] bool holds() const {
    double sum =
        t.force_error2 + t.chatter2 + t.dissipated + t.position_error2 + t.contact_turn2 + t.error2 + t.pressed;
    const S& s = now.state;
    for (int i = 0; i < N; ++i)
      sum += s.master_x[i] + s.master_v[i] + s.slave_x[i] + s.slave_v[i] + s.held[i] + s.command[i];
    sum += s.master_energy + s.slave_absorbed + s.slave_returned;
    if (method_ == LaneMethod::internal_model) {
      std::array<double, sizeof s.model / sizeof(double)> all;
      std::memcpy(all.data(), &s.model, sizeof s.model);
      for (const double each : all) sum += each;
    }
    return std::isfinite(sum) && s.silent == 0.0;
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
  LaneMethod method_;
  std::int64_t period_ns_;
  std::shared_ptr<const Intended> path_;
  Plant plant_;
  std::unique_ptr<Nodes<N>> nodes_;
  std::int64_t lag_[2] = {1, 1}, first_force_lag_ = 1, ticks_ = 0, early_at_ = 0, ended_at_ = 0;
  double end_s_ = 0.0;
  std::size_t window_ = 1;
  std::vector<std::pair<std::int64_t, std::int64_t>> rests_;
  std::vector<RunPart> parts_;
  std::vector<std::int64_t> stops_;
  std::size_t part_ = 0, next_stop_ = 0;
  std::optional<typename RunJudge<N>::Speeds> early_;
  bool failed_ = false, judged_ = false;
  std::optional<double> held_ratio_;
  bool in_quarter_ = false;
  ContactStates<Snapshot<N>> states_;
  std::size_t judging_ = 0;  ///< 0: the end of the run; else one of states_
  const Snapshot<N>* from_ = nullptr;
  std::optional<Metrics<N>> metrics_;
  std::optional<TrendRecord> after_;  ///< plain verdict: the run since the path's end
  bool acted_after_ = false;
  std::int64_t quiet_from_ = std::numeric_limits<std::int64_t>::max();  ///< first tick of after_
  MotionScale scale_;
  std::optional<Verdict> verdict_;
};

}  // namespace twoport::lab::lanes
