#include <twoport/passivity/passivated.h>

#include <algorithm>
#include <cstdio>

using namespace twoport;

/// A wall at x = 0, 5 kN/m: velocity in, force out, power f·v into it.
struct OwnWall {
  using In = Velocity<1>;
  using Out = Force<1>;
  double x_m = -0.01;
  Force<1> step(const Velocity<1>& v, Seconds dt) noexcept {
    x_m += v[0] * dt.si();
    return Force<1>{Force<1>::Vector{std::max(0.0, 5000.0 * x_m)}};
  }
};

/// Throws a 75 g handle at the wall; energy that has gone into it when the handle is back, and the smallest ever [J].
template <OnePort Wall>
void bounce(const char* name, Wall wall) {
  const Seconds dt{1e-3};
  double v = 0.3, f = 0.0, into = 0.0, least = 0.0;
  for (int k = 0; k < 200; ++k) {
    const double before = v;
    v -= f / 0.075 * dt.si();
    const Velocity<1> mean{Velocity<1>::Vector{0.5 * (before + v)}};  // exact while the force is held
    into += f * mean[0] * dt.si();
    least = std::min(least, into);
    f = wall.step(mean, dt)[0];
  }
  std::printf("%-10s left at %+.3f m/s after +0.300, energy %+.3f mJ, smallest %+.3f mJ\n", name, v, 1e3 * into,
              1e3 * least);
}

int main() {
  bounce("plain", OwnWall{});
  bounce("passivated", Passivated{OwnWall{}, ControllerOptions{.method = Method::force_projected}});
  const EnergySpringOptions spring{.stiffness_n_per_m = 5000.0, .mass_kg = 0.075, .initial = Energy{10e-6}};
  bounce("spring", Passivated{OwnWall{}, spring});
}
