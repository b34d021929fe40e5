#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <optional>
#include <vector>

#include "common/contact/environment.h"
#include "common/record/angle.h"
#include "common/record/metrics.h"
#include "lab/lanes/batch.h"
#include "lab/lanes/cell.h"
#include "lab/lanes/taken.h"

namespace twoport::lab::lanes {

inline constexpr std::int64_t kRecordRows = 512;

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
    const auto w = static_cast<std::size_t>(unit.lanes);
    b.parameters = take(0, kParameters * w), b.state = take(1, kState * w), b.sums = take(2, kSums * w);
    b.to_slave = take(3, ring_words(words_to_slave(N, b.method)) * w);
    b.to_master = take(4, ring_words(words_to_master(N, b.method)) * w);
    if (!tail) b.window = take(5, static_cast<std::size_t>(b.window_slots) * 2 * N * w);
    if (records) b.record = take(6, kRecordRows * words_of_record(N) * w);
  }
  Lanes(const Lanes&) = delete;
  Lanes& operator=(const Lanes&) = delete;

  [[nodiscard]] int width() const { return unit_.lanes; }

  void set_parameters(int lane, const Of& cell) { put(b.parameters, lane, &cell.p, kParameters); }
  void set_state(int lane, const State<double, N>& state) { put(b.state, lane, &state, state_fields()); }
  void set_sums(int lane, const Of& cell) { put(b.sums, lane, &cell.t, kSums); }
  void get_state(int lane, State<double, N>& state) const { get(b.state, lane, &state, state_fields()); }
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
    copy(b.state, state_fields(), to, from);
    copy(b.sums, kSums, to, from);
    if (with_packets) {
      copy(b.to_slave, ring_words(words_to_slave(N, b.method)), to, from);
      copy(b.to_master, ring_words(words_to_master(N, b.method)), to, from);
    }
    b.path[to] = b.path[from];
    b.plant[to] = b.plant[from];
    nodes[to] = nullptr;
  }
  void lanes_changed() {
    Parameters<double, N> one;
    bool lossy[2]{}, bursts[2]{}, same[2]{true, true};
    b.together = true;
    double lag[2]{};
    for (int lane = 0; lane < width(); ++lane) {
      get(b.parameters, lane, &one, kParameters);
      for (int way = 0; way < 2; ++way) {
        const bool burst = one.burst_p[way] > 0.0 || one.burst_good[way] > 0.0;
        bursts[way] |= burst;
        lossy[way] |= burst || one.loss[way] > 0.0;
        if (lane > 0) same[way] &= one.lag[way] == lag[way];
        lag[way] = one.lag[way];
      }
      // The first field of a state is the number of its next tick.
      if (lane > 0) b.together = b.together && b.path[lane] == b.path[0] && b.state[lane] == b.state[0];
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
  /// What a lane copies of its state.
  [[nodiscard]] std::size_t state_fields() const {
    constexpr std::size_t kOfModel = sizeof(InternalModel<double, N>) / sizeof(double);
    return b.method == LaneMethod::internal_model ? kState : kState - kOfModel;
  }
  [[nodiscard]] std::size_t ring_words(int words) const { return static_cast<std::size_t>(b.slots * words); }
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

}  // namespace twoport::lab::lanes
