#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/passivity/passivated.h"
#include "common/ports/port.h"

namespace twoport::ports_test {
namespace {

/// Impedance. f(k) = K x(k), with x the sum of v T: what a sampled spring answers.
template <int N>
class Spring {
 public:
  using In = Velocity<N>;
  using Out = Force<N>;
  explicit Spring(double stiffness, Displacement<N> x = {}) : k_{stiffness}, x_{x} {}
  Out step(const In& v, Seconds dt) noexcept {
    x_ += v * dt;
    return Force<N>{k_ * x_.vec()};
  }

 private:
  double k_;
  Displacement<N> x_;
};

/// Admittance. v(k) = v(k-1) + T f / m.
template <int N>
class Mass {
 public:
  using In = Force<N>;
  using Out = Velocity<N>;
  explicit Mass(double mass, Velocity<N> v = {}) : m_{mass}, v_{v} {}
  Out step(const In& f, Seconds dt) noexcept {
    v_ += Velocity<N>{(dt.si() / m_) * f.vec()};
    return v_;
  }

 private:
  double m_;
  Velocity<N> v_;
};

struct Throws : Spring<3> {
  using Spring<3>::Spring;
  Out step(const In& v, Seconds dt) { return Spring<3>::step(v, dt); }
};
struct VelocityToVelocity {
  using In = Velocity<3>;
  using Out = Velocity<3>;
  Out step(const In& v, Seconds) noexcept { return v; }
};

// A one-port is a step between duals that does not throw.
static_assert(OnePort<Spring<1>> && OnePort<Spring<6>> && OnePort<Mass<3>>);
static_assert(!OnePort<Throws>);
static_assert(!OnePort<VelocityToVelocity>);

// Power duals: a force and a velocity of one size, in either order.
static_assert(PowerDual<Force<6>, Velocity<6>> && PowerDual<Velocity<1>, Force<1>>);
static_assert(!PowerDual<Force<3>, Force<3>> && !PowerDual<Velocity<3>, Velocity<3>>);
static_assert(!PowerDual<Force<3>, Velocity<6>>);
static_assert(!PowerDual<Force<3>, Displacement<3>>);  // that is an energy

// What is made passive is a one-port again, in both causalities.
static_assert(OnePort<Passivated<Spring<3>>> && OnePort<Passivated<Mass<6>>>);
static_assert(OnePort<Passivated<Spring<6>, EnergySpringOptions>>);

TEST(Passivated, OfSixAxesNeedsARotationalStiffness) {
  EnergySpringOptions options{.stiffness_n_per_m = 1000.0, .initial = Energy{1e-3}};
  EXPECT_THROW((Passivated{Spring<6>{1.0}, options}), std::invalid_argument);
  EXPECT_NO_THROW((Passivated{Spring<3>{1.0}, options}));
  options.rotational_stiffness_n_m_per_rad = 1.0;
  EXPECT_NO_THROW((Passivated{Spring<6>{1.0}, options}));
}

TEST(Passivated, RefusesOptionsThatHaveNoSense) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const EnergySpringOptions right{.stiffness_n_per_m = 1000.0, .initial = Energy{1e-3}};
  const auto spring = [&](auto member, auto value) {
    EnergySpringOptions o = right;
    o.*member = value;
    return Passivated{Spring<1>{1.0}, o};
  };
  for (const double value : {-1.0, nan}) {
    EXPECT_THROW(spring(&EnergySpringOptions::stiffness_n_per_m, value), std::invalid_argument) << value;
    EXPECT_THROW(spring(&EnergySpringOptions::mass_kg, value), std::invalid_argument) << value;
    EXPECT_THROW(spring(&EnergySpringOptions::initial, Energy{value}), std::invalid_argument) << value;
    for (const auto member : {&ControllerOptions::max_gain, &ControllerOptions::mass_kg,
                              &ControllerOptions::max_turn_rad, &ControllerOptions::radius_of_gyration_m}) {
      ControllerOptions o{.method = Method::classic};
      o.*member = value;
      EXPECT_THROW((Passivated{Spring<1>{1.0}, o}), std::invalid_argument) << value;
    }
  }
  EXPECT_THROW(spring(&EnergySpringOptions::initial, Energy{}), std::invalid_argument);
  EXPECT_THROW((Passivated{Spring<1>{1.0}, ControllerOptions{}, Energy{nan}}), std::invalid_argument);
}

TEST(Passivated, BooksNothingInAPeriodThatIsNone) {
  const double infinity = std::numeric_limits<double>::infinity();
  Passivated spring{Spring<1>{1000.0}, EnergySpringOptions{.stiffness_n_per_m = 1000.0, .initial = Energy{1e-3}}};
  Passivated projected{Spring<1>{1000.0}, ControllerOptions{.method = Method::force_projected}};
  const Velocity<1> v{Velocity<1>::Vector{0.1}};
  for (const double dt : {1e-3, infinity, 0.0, -1e-3, 1e-3})
    for (const double f : {spring.step(v, Seconds{dt})[0], projected.step(v, Seconds{dt})[0]})
      EXPECT_TRUE(std::isfinite(f) && (dt == 1e-3 || f == 0.0)) << dt;
  EXPECT_TRUE(std::isfinite(spring.energy().si()) && std::isfinite(projected.energy().si()));
}

}  // namespace
}  // namespace twoport::ports_test
