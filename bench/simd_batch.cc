// The equations of bench/numpy_batch.py in a loop of vectors by hand, eight (AVX-512) or four (AVX2) simulations at once, for one
// axis and for three: what lanes (lab/lanes/) are measured against. As there, the robot is stepped by the map of the side of the
// wall where the tick begins, and there is no verdict, no summary and no trace: two figures a cell.
//
// usage: bench_simd_batch_WIDTH [CELLS_PER_AXIS [SECONDS]]
#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

namespace {

constexpr int W = TWOPORT_WIDTH;
using V = double __attribute__((vector_size(8 * W)));
using U = std::uint64_t __attribute__((vector_size(8 * W)));
using M = decltype(V{} < V{});

constexpr double T = 5e-4, kHandMass = 0.1, kHandK = 400.0, kHandB = 8.0, kDeviceMass = 0.075, kDeviceB = 0.05,
                 K = 1000.0, B = 20.0, kRobotMass = 0.5, kRobotB = 2.0, kWallK = 5000.0, kWallAt = 0.02,
                 kInitial = 1e-3, kMaxGain = 10.0, kEngage = 0.1, kCatchUp = 0.05;

#define INLINE [[gnu::always_inline]] inline
INLINE V all(double a) {
  return a - V{};
}
INLINE V least(V a, V b) {
  return b < a ? b : a;
}
INLINE V most(V a, V b) {
  return a < b ? b : a;
}
#if TWOPORT_WIDTH == 8
INLINE V root(V a) {
  return (V)_mm512_sqrt_pd((__m512d)a);
}
#else
INLINE V root(V a) {
  return (V)_mm256_sqrt_pd((__m256d)a);
}
#endif
template <int N>
INLINE V dot(const V (&a)[N], const V (&b)[N]) {
  V sum = a[0] * b[0];
  for (int i = 1; i < N; ++i) sum += a[i] * b[i];
  return sum;
}

/// Step of m x'' = u + w t - b x' - k x from x = 0: x and v by v0, u, w; the series of the matrix exponential.
struct Map {
  double xv, xu, xw, vv, vu, vw;
  Map(double m, double b, double k, double h) {
    const double a[4][4] = {{0, h, 0, 0}, {-k / m * h, -b / m * h, h / m, 0}, {0, 0, 0, h}, {0, 0, 0, 0}};
    double sum[4][4] = {}, term[4][4] = {};
    for (int i = 0; i < 4; ++i) sum[i][i] = term[i][i] = 1.0;
    for (int n = 1; n < 30; ++n) {
      double next[4][4] = {};
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
          for (int l = 0; l < 4; ++l) next[i][j] += term[i][l] * a[l][j] / n;
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) term[i][j] = next[i][j], sum[i][j] += next[i][j];
    }
    xv = sum[0][1], xu = sum[0][2], xw = sum[0][3], vv = sum[1][1], vu = sum[1][2], vw = sum[1][3];
  }
};

/// Largest s in [0, 1] with q s² + b s <= a.
INLINE V feasible(V q, V b, V a) {
  const V square = root(most(V{}, b * b + 4.0 * q * a));
  const V s = b <= 0.0 ? (square - b) / (2.0 * q) : 2.0 * a / (square + b);
  return q + b <= a ? all(1.0) : least(most(s, V{}), all(1.0));
}
/// Uniform in (0, 1) of (stream, packet).
INLINE V uniform(U stream, std::uint64_t packet) {
  U z = stream + 0x9e3779b97f4a7c15 * packet;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  z = z ^ (z >> 31);
  return ((V)((z >> 12) | 0x4330000000000000) - 0x1.0p52 + 0.5) * 0x1.0p-52;
}

/// W cells of one delay, for so many ticks. Returns the largest |x| of either side.
template <int N>
V run(int delay, V loss, std::uint64_t seed, int ticks, V& last) {
  const Map hand{kHandMass + kDeviceMass, kHandB + kDeviceB, kHandK, T}, free{kRobotMass, kRobotB, 0.0, T},
      wall{kRobotMass, kRobotB, kWallK, T};
  struct ToSlave {
    V x[N], v[N], in;
  };
  struct ToMaster {
    V f[N], in;
  };
  const auto slots = static_cast<std::size_t>(delay);
  std::vector<ToSlave> to_slave(slots, ToSlave{});
  std::vector<ToMaster> to_master(slots, ToMaster{});
  U stream;
  for (int i = 0; i < W; ++i) stream[i] = (seed + static_cast<std::uint64_t>(i)) * 0xd1342543de82ef95;
  V x_m[N]{}, v_m[N]{}, f_m[N]{}, f_b[N]{}, x_b[N]{}, u[N]{}, d[N]{}, x_s[N]{}, v_s[N]{}, f_s[N]{}, x_sb[N]{},
      x_sd[N]{}, target[N]{}, rx_v[N]{}, rx_f[N]{};
  V bound{}, in_m{}, out_m{}, in_s{}, out_s{}, created{}, worst{}, credit{}, ramp{}, rx_in_m{}, rx_in_s{}, heard_m{},
      heard_s{}, far{};
  constexpr double give = 0.5 * T / kDeviceMass, g = 1.0 / (B + K * T);
  double x_h = 0.0;
  for (int k = 0; k < ticks; ++k) {
    const double s = std::min(1.0, (k + 1) * T), x_next = 0.03 * s * s * s * (10.0 - s * (15.0 - 6.0 * s));
    const auto slot = static_cast<std::size_t>(k % delay);
    const bool old = k >= delay;
    const ToMaster from_slave = to_master[slot];
    const ToSlave from_master = to_slave[slot];
    // Master: account, prediction, packet, controller.
    V moved[N], error[N], w[N], f[N];
    for (int i = 0; i < N; ++i) moved[i] = x_m[i] - x_b[i];
    const V e = dot(f_m, moved);
    in_m += most(e, V{});
    out_m += most(-e, V{});
    for (int i = 0; i < N; ++i) {
      const V expected = u[i] + d[i] - give * (f_b[i] + f_m[i]);
      error[i] = k > 0 ? moved[i] / T - expected : V{};
      u[i] = expected + 0.75 * error[i];
      d[i] += 0.25 * error[i];
      f_b[i] = f_m[i], x_b[i] = x_m[i];
      w[i] = u[i] + d[i] - give * f_m[i];
    }
    bound = most(root(dot(error, error)), 0.95 * bound);
    if (old) {
      for (int i = 0; i < N; ++i) rx_f[i] = from_slave.f[i];
      rx_in_s = most(from_slave.in, rx_in_s);
      heard_m = all(1.0);
    }
    ramp = heard_m != 0.0 ? least(all(1.0), ramp + T / kEngage) : V{};
    for (int i = 0; i < N; ++i) f[i] = ramp * rx_f[i];
    const V f2 = dot(f, f), power = dot(f, w) - root(f2) * bound;
    const V kept = most(V{}, least(most(e, V{}), out_m - (kInitial + rx_in_s)));
    in_m -= kept;
    out_m -= kept;
    const V left = kInitial + least(rx_in_s, in_m) - out_m;
    const M repays = (left < 0.0) & (power > 0.0);
    const V repaid = repays ? least(-left, kMaxGain * T * power * power / f2) : V{};
    const V scale = feasible(give * f2, -power, (most(left, V{}) - repaid) / T);
    for (int i = 0; i < N; ++i) f[i] = f2 > 0.0 ? scale * f[i] : V{};
    // Slave: packet, coupling, controller.
    V between[N];
    for (int i = 0; i < N; ++i) between[i] = x_s[i] - x_sb[i], x_sb[i] = x_s[i];
    created -= dot(f_s, between);
    const M got = (old ? ~M{} : M{}) & (uniform(stream, static_cast<std::uint64_t>(k)) >= loss);
    rx_in_m = got ? most(from_master.in, rx_in_m) : rx_in_m;
    heard_s = got ? all(1.0) : heard_s;
    V v[N], repair[N], f_d[N], step[N];
    for (int i = 0; i < N; ++i) {
      rx_v[i] = got ? from_master.v[i] : rx_v[i];
      target[i] = got ? from_master.x[i] : target[i] + T * rx_v[i];
      repair[i] = (target[i] - x_sd[i]) / T - rx_v[i];
    }
    const V r2 = dot(repair, repair), part = r2 <= kCatchUp * kCatchUp ? all(1.0) : kCatchUp / root(r2);
    for (int i = 0; i < N; ++i) {
      v[i] = rx_v[i] + part * repair[i];
      const V pull = K * (x_sd[i] + T * v[i] - x_s[i]) + B * (rx_v[i] - v_s[i]);
      f_d[i] = heard_s != 0.0 ? pull : V{};
    }
    const V p = dot(f_d, v), q = g * dot(f_d, f_d), a = most(kInitial + rx_in_m - out_s, V{}) / T;
    const V cut = p <= a ? all(1.0) : feasible(q, p - q, a);
    for (int i = 0; i < N; ++i) {
      step[i] = heard_s != 0.0 ? T * (v[i] - (1.0 - cut) * g * f_d[i]) : V{};
      f_s[i] = cut * f_d[i];
      x_sd[i] += step[i];
    }
    const V into = dot(f_s, step);
    out_s += most(into, V{});
    in_s += most(-into, V{});
    created += into;
    worst = least(worst, created);
    credit = most(credit, in_s + worst);
    // The link, then the plants.
    ToSlave& there = to_slave[slot];
    ToMaster& back = to_master[slot];
    there.in = in_m, back.in = credit;
    const M inside = x_s[0] > kWallAt;
    V m2{}, s2{};
    for (int i = 0; i < N; ++i) {
      there.x[i] = x_m[i], there.v[i] = v_m[i], back.f[i] = f_d[i];
      const double rate = i == 0 ? (x_next - x_h) / T : 0.0, at = i == 0 ? x_h : 0.0;
      const V load = kHandK * (at - x_m[i]) + kHandB * rate - f[i];
      const double slope = kHandK * rate;
      x_m[i] = x_m[i] + hand.xv * v_m[i] + hand.xu * load + hand.xw * slope;
      v_m[i] = hand.vv * v_m[i] + hand.vu * load + hand.vw * slope;
      if (i == 0) {
        const V push = f_s[0] - (inside ? kWallK * (x_s[0] - kWallAt) : V{});
        const V x =
            x_s[0] + (inside ? all(wall.xv) : all(free.xv)) * v_s[0] + (inside ? all(wall.xu) : all(free.xu)) * push;
        v_s[0] = (inside ? all(wall.vv) : all(free.vv)) * v_s[0] + (inside ? all(wall.vu) : all(free.vu)) * push;
        x_s[0] = x;
      } else {
        x_s[i] = x_s[i] + free.xv * v_s[i] + free.xu * f_s[i];
        v_s[i] = free.vv * v_s[i] + free.vu * f_s[i];
      }
      f_m[i] = f[i];
      m2 += x_m[i] * x_m[i], s2 += x_s[i] * x_s[i];
    }
    x_h = x_next;
    far = most(far, most(m2, s2));
  }
  last = x_s[0];
  return root(far);
}

template <int N>
void measure(int count, double seconds) {
  const auto ticks = static_cast<int>(std::lround(seconds / T));
  const auto value = [&](int i, double from, double to) { return from + (to - from) * i / std::max(1, count - 1); };
  int near = 0, cells = 0;
  double first = 0.0;
  const std::clock_t start = std::clock();  // CPU time
  for (int i = 0; i < count; ++i) {
    const int delay = std::max(1, static_cast<int>(std::ceil(value(i, 1.0, 100.0) * 1e-3 / T - 1e-9)));
    for (int j = 0; j < count; j += W) {
      V loss, last;
      for (int l = 0; l < W; ++l) loss[l] = value(std::min(j + l, count - 1), 0.0, 0.5);
      const V far = run<N>(delay, loss, static_cast<std::uint64_t>(i * count + j), ticks, last);
      if (i + j == 0) first = last[0];
      for (int l = 0; l < W && j + l < count; ++l) near += far[l] < 0.1, ++cells;
    }
  }
  const double spent = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  std::printf(
      "%d axes, %d at once: %d cells of %g s at 2 kHz in %.2f s: %.0f cells/s, %.1f ns a tick; %.3f stay within 0.1 m, "
      "x_s of the first ends at %.6f m\n",
      N, W, cells, seconds, spent, cells / spent, 1e9 * spent / cells / ticks, static_cast<double>(near) / cells,
      first);
}

}  // namespace

int main(int argc, char** argv) {
  const int count = argc > 1 ? std::atoi(argv[1]) : 32;
  const double seconds = argc > 2 ? std::atof(argv[2]) : 8.0;
  measure<1>(count, seconds);
  measure<3>(count, seconds);
}
