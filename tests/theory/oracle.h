#pragma once

#include <complex>
#include <functional>
#include <span>
#include <vector>

#include "common/coupling/options.h"
#include "lab/theory/sampled_loop.h"

namespace twoport::lab {

// Theory of the loops that the laboratory runs, computed without the laboratory's code: closed forms, frequency sweeps,
// and eigenvalues of exactly discretised loops. SI units; one degree of freedom; a delay of d ticks is z^-d.

// ---- passivity of a sampled wall

/// A discrete transfer function, from the position that is sampled to the force that is held.
using Discrete = std::function<std::complex<double>(std::complex<double> z)>;

/// Least damping of the device with which a sampled and held environment is passive [N s/m].
///
///     b > (T/2) max_θ Re{(1 - e^-jθ) H(e^jθ)} / (1 - cos θ),   0 < θ <= π
///
/// By a sweep of θ, refined where it is largest; H must be smooth against π/2048.
/// Source: Colgate and Schenkel, J. Robotic Systems 14(1), 1997.
double colgate_damping(const Discrete& wall, double period_s);

/// The same of a spring and a damper on the backward difference, d ticks late: H = z^-d (K + B (z-1)/(T z)).
///
///     b_min = max_θ { (K T/2) sin((2d+1)θ/2)/sin(θ/2) - B cos((d+1)θ) }
///
/// d = 0: K T/2 + |B|. B = 0: K (T/2 + d T).
double colgate_damping(double stiffness_n_per_m, double damping_n_s_per_m, double period_s, int delay_ticks = 0);

// ---- stability of a sampled wall

/// The same for b = k_h = g = 0 and the backward difference, by D-decomposition [N/m].
///
///     α = K T²/m,  β = B T/m:     d = 0:  α = 2β(2 - β)/(2 + β)
///     any d:  γ = 4 sin²(θ/2)/cos(θ/2),  β = γ sin((d+½)θ)/sin θ,  α = γ cos((d+½)θ) - β (1 - cos θ)
double critical_stiffness_undamped(double mass_kg, double wall_damping_n_s_per_m, double period_s, int delay_ticks);

/// The stiffest undamped wall there is, over all B: α and the β it needs.
struct Peak {
  double alpha, beta;
};
Peak stiffest_undamped(int delay_ticks);

// ---- bilateral loops

/// A handle in a hand and a robot on a spring, sampled together, each link direction an integer number of ticks:
///
///     m_m ẍ_m = -b_m ẋ_m - k_h x_m - f_m(k)        m_s ẍ_s = -b_s ẋ_s - (k_e x_s + b_e ẋ_s) + f_s(k)
///     f_s(k) = K (s_x x_m(k-d1) - x_s(k)) + B (s_x v_m(k-d1) - v_s(k))
///
///     POSITION_FORCE            f_m(k) = s_f f_s(k-d2)
///     POSITION_MEASURED_FORCE   f_m(k) = s_f (k_e x_s + b_e v_s)(k-d2)
///     POSITION_POSITION         f_m(k) = K (x_m(k) - x_s(k-d2)/s_x) + B (v_m(k) - v_s(k-d2)/s_x)
///
/// Velocities are the true ones at the tick; v_m is (x_m(k) - x_m(k-1))/T where `backward_difference`. This is
/// MasterNode and SlaveNode with method NONE, with these readings:
///
///   delay       a report can be read strictly later than it was posted, so d = max(1, ceil(delay/T)): `ticks_of_delay`
///   tracker     without loss x_sd(k-1) + T v_d(k) is the received position itself, while catch_up_m_per_s exceeds
///               |Δx_rx/T - v_rx|; the damper works on the received velocity, not on v_d
///   order       each side senses, collects, steps and actuates at t_k: no delay of its own
///   robot       without a robot block x_s(k+1) is the position received at k, v_s(k+1) its difference, and f_s(k) what
///               the environment answers: `ideal_robot`
struct BilateralLoop {
  Architecture architecture = Architecture::position_force;
  double master_mass_kg = 0.5, master_damping_n_s_per_m = 2.0, hand_stiffness_n_per_m = 200.0;
  double robot_mass_kg = 0.5, robot_damping_n_s_per_m = 2.0;
  double environment_stiffness_n_per_m = 500.0, environment_damping_n_s_per_m = 0.0;
  double coupling_stiffness_n_per_m = 1000.0, coupling_damping_n_s_per_m = 30.0;
  double force_scale = 1.0, motion_scale = 1.0;
  double period_s = 1e-3;
  int to_slave_ticks = 0, to_master_ticks = 0;
  bool backward_difference = false, ideal_robot = false;
};

/// Ticks that a constant one-way delay takes between our nodes.
int ticks_of_delay(double delay_s, double period_s);

/// Largest |eigenvalue| of the loop from tick to tick.
double spectral_radius(const BilateralLoop& loop);

/// Force scale, or stiffness of the coupling, at which the loop first becomes unstable, from 0 up. 0: unstable at once.
double critical_force_scale(BilateralLoop loop);
double critical_coupling_stiffness(BilateralLoop loop);
/// Largest d1 = d2 up to which the loop is stable, at most `most`; -1: unstable without delay.
int critical_delay_ticks(BilateralLoop loop, int most);

/// The same handle and robot over a wave line of impedance b, closed at the slave by a spring and damper on the
/// difference of the sampled velocities:
///
///     f_m = b v_m - √(2b) w_m,   u_m = √(2b) v_m - w_m,        u_s(k) = u_m(k-d1),   w_m(k) = w_s(k-d2)
///     f_s = (G (√(2b) u_s/b - v_s) + K e)/(1 + G/b),           G = B + K T
///     v_sd = (√(2b) u_s - f_s)/b,   w_s = u_s - √(2/b) f_s,    e += T (v_sd - v_s)
///
/// Returns the largest |eigenvalue|, 1 for the position offset that waves do not correct, and the largest of the others.
struct WaveModes {
  double drift, next;
};
WaveModes wave_modes(const BilateralLoop& loop, double wave_impedance_n_s_per_m);

// ---- absolute stability of a two-port

/// Immittance of a two-port at one frequency, of any kind (z, y, h, g).
struct Immittance {
  std::complex<double> p11, p12, p21, p22;
};

/// Llewellyn's margin; absolutely stable when it is >= 0 at every ω and Re p11, Re p22 >= 0.
///
///     2 Re p11 Re p22 - |p12 p21| - Re(p12 p21)
///
/// It holds for all passive terminations; a negative margin does not mean that a given pair is unstable.
double llewellyn_margin(const Immittance& p);

/// Least margin over ω in [low, high] rad/s, divided by |p12 p21| or by `scale` where that is > 0, and where.
struct LeastMargin {
  double value, at_rad_per_s;
};
LeastMargin least_llewellyn_margin(const std::function<Immittance(double)>& port, double low, double high,
                                   double scale = 0.0);

/// Largest exchanged stiffness that is absolutely stable with local damping b_m, b_s over one-way delays T1, T2 [N/m]:
///
///     K <= 2 √(b_m b_s)/(T1 + T2)
double llewellyn_stiffness(double master_damping_n_s_per_m, double slave_damping_n_s_per_m, double to_slave_s,
                           double to_master_s);

/// Two-ports in continuous time between hand and environment, s = jω.
/// Exchanged springs with local damping only (z).
Immittance exchanged_stiffness(double stiffness_n_per_m, double master_damping_n_s_per_m,
                               double slave_damping_n_s_per_m, double delays_s, double omega);
/// The loop's handle, robot and coupling with one-way delay `delay_s` each way: PF with the measured force (h),
/// position to position (z), or a wave line in place of the delays (z).
Immittance position_measured_force(const BilateralLoop& loop, double delay_s, double omega);
Immittance position_position(const BilateralLoop& loop, double delay_s, double omega);
Immittance wave_line(const BilateralLoop& loop, double wave_impedance_n_s_per_m, double delay_s, double omega);

// ---- energies

/// Energy in flight on a wave line, after any terminations, for constant integer delays [J]; exactly the energy put in
/// less the energy that has left:
///
///     Σ T (f_m v_m - f_s v_sd) = (T/2) (Σ of the last d1 u_m² + Σ of the last d2 w_s²) >= 0
double wave_line_energy(std::span<const double> u_m, std::span<const double> w_s, int to_slave_ticks,
                        int to_master_ticks, double period_s);

/// Energy generated by a sampled and held spring over a motion sampled at the ticks [J]: stored energy less absorbed
/// energy,
///
///     K/2 (x_n² - x_0²) - Σ K x(k-1)·(x(k) - x(k-1)) = K/2 Σ (x(k) - x(k-1))²
double spring_leak(double stiffness_n_per_m, std::span<const double> x);

/// Press to a depth and release at constant speed: K v T D [J].
double press_release_leak(double stiffness_n_per_m, double period_s, double speed_m_per_s, double depth_m);

/// Per period of a sine of amplitude A, N ticks long, the force d ticks late [J]:
///
///     (K A² N/2) (cos(dθ) - cos((d+1)θ)),   θ = 2π/N;      -> π A² ω K (T/2 + d T)
double sine_leak(double stiffness_n_per_m, double amplitude_m, double ticks_per_period, int delay_ticks = 0);

}  // namespace twoport::lab
