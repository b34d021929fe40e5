// What internal-model control claims beyond what every method is asked: least energy through the master port for any
// packets, and contact with walls that are damped, left, curved, felt with a bias, stiffer than the device can show.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/method/internal_model/internal_model.h"
#include "common/scene/load.h"
#include "lab/engine/loops.h"
#include "master/master_node.h"
#include "sim/sim_device.h"

namespace twoport {
namespace {

// ---- hostile packets

struct Hostile {
  int dof;
  double rate_hz;
  std::string hand;
  int seed;
};

Scene hostile_scene(const Hostile& c) {
  const std::string six_hand =
      c.dof == 6 ? " inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: 0.02"
                 : "";
  // A violent hand: 3 Hz with 5 cm on one axis, 7 Hz with 1 cm by tremor on all: about 1 m/s.
  return parse_scene("dof: " + std::to_string(c.dof) + " duration_s: 20 rate_hz: " + std::to_string(c.rate_hz) +
                         " seed: " + std::to_string(c.seed) + " operator { hand { " + c.hand + six_hand +
                         " } path { sine { axis: 0 amplitude_m: 0.05 frequency_hz: 3 duration_s: 20 } } " +
                         "tremor { rms_m: 0.004 } } device { mass_kg: 0.1 damping_n_s_per_m: 0.05 max_force_n: 20 " +
                         (c.dof == 6 ? "inertia_kg_m2: 1e-4 " : "") +
                         "} control { passivity { method: INTERNAL_MODEL } } robot { mass_kg: 1 " +
                         (c.dof == 6 ? "inertia_kg_m2: 1e-3 " : "") + "}",
                     "hostile");
}

/// Reports that no robot sends: any force, any surface, a set point that jumps.
template <int N>
class HostileSlave {
 public:
  explicit HostileSlave(int seed) : random_{static_cast<unsigned>(seed)} {}

  /// The newest report, for a handle at `x`; a new one comes after 7 to 400 ticks, sometimes after 1500.
  const PeerState<N>& at(int tick, Duration now, const Position<N>& x) {
    peer_.is_new = tick == next_;
    if (tick != next_) return peer_;
    next_ += uniform(0.0, 1.0) < 0.05 ? 1500 : static_cast<int>(uniform(7.0, 400.0));
    peer_.has_report = true;
    peer_.received_at = now;
    peer_.newest.echo_ns = (now - to_duration(uniform(0.0, 1.5))).count();
    peer_.newest.f = Force<N>{vector<N>(uniform(3.0, 20.0))};
    constexpr int D = kAxes<N>;
    SurfaceReport<N> said;
    said.contact.value = uniform(0.0, 1.0) < 0.7 ? 1.0 : 0.0;
    said.normal.value = Direction<D>{vector<D>(1.0)};
    said.point.value = Position<D>{Point<D>{x.translation() + vector<D>(uniform(0.0, 0.03))}};
    said.stiffness.value = std::pow(10.0, uniform(1.0, 4.7));
    said.friction.value = uniform(-0.5, 2.0);
    said.curvature.value = uniform(0.0, 1.0) < 0.5 ? 0.0 : uniform(-300.0, 300.0);
    typename Displacement<N>::Vector jump = Displacement<N>::Vector::Zero();
    jump.template head<D>() = vector<D>(uniform(0.0, 0.05));
    said.echo.value = x + Displacement<N>{jump};
    said.robot.value = Position<D>{Point<D>{x.translation() + vector<D>(uniform(0.0, 0.05))}};
    said.lever.value = Displacement<3>{vector<3>(0.1)};
    write(said, peer_.words);
    return peer_;
  }

 private:
  double uniform(double from, double to) { return std::uniform_real_distribution<>{from, to}(random_); }
  template <int K>
  Eigen::Matrix<double, K, 1> vector(double length) {
    Eigen::Matrix<double, K, 1> v;
    for (int i = 0; i < K; ++i) v[i] = std::normal_distribution<>{}(random_);
    return v * (length / v.norm());
  }

  std::mt19937 random_;
  PeerState<N> peer_;
  int next_ = 0;
};

template <int N>
double least_energy_j(const Hostile& c) {
  const Scene scene = hostile_scene(c);
  const Seconds dt{1.0 / c.rate_hz};
  sim::SimDevice<N> device{scene, dt};
  MasterNode<N, InternalModelMaster<N>> master{scene.control};
  HostileSlave<N> slave{c.seed};
  double least = 0.0, largest = 0.0;
  for (int k = 0; k < static_cast<int>(scene.duration_s * c.rate_hz); ++k) {
    const Duration now = tick_time(k, c.rate_hz);
    if (k > 0) device.advance();
    const auto out = master.step(Tick<MasterClock>{Instant<MasterClock>{now}, dt}, device.sense(), slave.at(k, now, device.x()));
    EXPECT_TRUE(all_finite(out.command)) << "tick " << k;
    device.actuate(out.command);
    least = std::min(least, device.port_energy().si());
    largest = std::max(largest, std::sqrt(out.command.squared_norm()));
  }
  EXPECT_GT(largest, 1.0) << "the packets must matter";
  return least;
}

TEST(X, Hostile) {
  for (const int dof : {1, 3, 6})
    for (const double rate : {100.0, 250.0, 1000.0, 4000.0}) {
      double least = 0;
      for (const char* hand : {"stiffness_n_per_m: 100 damping_n_s_per_m: 0.3", "mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8",
                               "mass_kg: 0.05 stiffness_n_per_m: 1500 damping_n_s_per_m: 3"})
        for (int seed = 1; seed <= 10; ++seed) {
          const Hostile c{dof, rate, hand, seed};
          const double e = dof == 1 ? least_energy_j<1>(c) : dof == 3 ? least_energy_j<3>(c) : least_energy_j<6>(c);
          least = std::min(least, e);
        }
      printf("dof %d rate %g least %.6f mJ\n", dof, rate, least * 1e3);
    }
}

}  // namespace
}  // namespace twoport
