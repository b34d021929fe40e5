#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/low_pass.h"
#include "common/base/vector.h"
#include "common/contact/signed_distance.h"
#include "common/method/transparency/surface/surface_patch.h"
#include "common/passivity/energy_spring.h"

namespace twoport {

/// Whether something is touched, from a force or from a torque that counts as a force.
///
///     |LP_a f| > 0.3 N begins it; |LP_a f| < 0.1 N for 3 ms ends it
template <int D>
class ContactDetector {
 public:
  void reset() noexcept { contact_ = false, f_.setZero(), quiet_s_ = 0.0; }
  /// `filter_s`: a.
  void step(const Point<D>& f, Seconds dt, double filter_s = kLeastFilter_s) noexcept {
    low_pass(f_, f, dt, filter_s);
    const double size = f_.norm();
    begins_ = !contact_ && size > kOn_n;
    if (!contact_) {
      quiet_s_ = 0.0;
      contact_ = begins_;
    } else {
      quiet_s_ = size < kOff_n ? quiet_s_ + dt.si() : 0.0;
      contact_ = quiet_s_ < kOff_s;
    }
  }
  [[nodiscard]] bool contact() const noexcept { return contact_; }
  [[nodiscard]] bool begins() const noexcept { return begins_; }       ///< in this tick
  [[nodiscard]] const Point<D>& force() const noexcept { return f_; }  ///< LP_a f

  static constexpr double kLeastFilter_s = 3e-3;

 private:
  static constexpr double kOn_n = 0.3, kOff_n = 0.1, kOff_s = 3e-3;
  bool contact_ = false, begins_ = false;
  double quiet_s_ = 0.0;
  Point<D> f_ = Point<D>::Zero();
};

/// Contact by a torque without a force, as of two pegs that are twisted in their holes. The torque of a sensor counts ten times and
/// more, its noise likewise, so the detector's low pass follows the noise:
///
///     σ² = LP_0.1s |t(k) - t(k-1)|²/2, in the first 0.1 s its mean;   a = T/2 (σ/75 mN)², between 3 ms and 0.1 s
///
/// In its first 0.1 s it begins no contact: neither noise nor the sensor's bias is known.
class TorqueContact {
 public:
  void reset() noexcept { detector_.reset(); }
  /// `t`: sqrt(K_c/K_r) τ.
  void step(const Eigen::Vector3d& t, Seconds dt) noexcept {
    learned_s_ = std::min(kNoise_s, learned_s_ + dt.si());
    low_pass(variance_, 0.5 * (t - before_).squaredNorm(), dt, learned_s_);
    before_ = t;
    if (learned_s_ < kNoise_s) return;
    detector_.step(t, dt,
                   std::clamp(0.5 * dt.si() * variance_ / (kNoise_n * kNoise_n), ContactDetector<3>::kLeastFilter_s,
                              kMostFilter_s));
  }
  [[nodiscard]] bool contact() const noexcept { return detector_.contact(); }

 private:
  static constexpr double kNoise_s = 0.1, kNoise_n = 75e-3, kMostFilter_s = 0.1;
  ContactDetector<3> detector_;
  Eigen::Vector3d before_ = Eigen::Vector3d::Zero();
  double variance_ = 0.0, learned_s_ = 0.0;
};

/// Estimates at the slave the surface that the robot touches, from position, velocity and force sensor, all in the master's
/// world and units (thresholds are then in forces that the hand feels). f: force of the robot on the environment. LP_a: first
/// order low pass with time constant a; at the start of a contact all filters start from the present value.
///
///     contact    ContactDetector of f, a = 3 ms
///     x', v', f' = (z - LP_20ms z)·n                                  motion and force across the surface, without offset;
///                                                                     x' of s, the point of the robot that touches now
///     K, B       least squares of f' = K x' + B v', mean over 0.5 s, with K = 2000 N/m as prior at (30 µm)², (3 mm/s)²;
///                only where |x'| >= 0.8 |s - LP_20ms s|: pressed, not slid; and |f'| > 0.05 N or |x'| > 0.5 mm, as of a weight
///     v_q        = LP_10ms[LP_20ms v - (f - LP_20ms f)/(20 ms K)]     velocity of x - f/K, which moves along the surface
///     f_q        = LP_10ms LP_20ms f                                  same filters: friction does not tilt the normal
///     sliding    |v_q| > 8 mm/s and |f_q·u| < 0.75 |f_q|, u = v_q/|v_q|:
///                n = LP_30ms of a/|a|,  a = f_q - (f_q·u) u;   μ = LP_50ms of min(1, max(0, f_q·u/|a|))
///     at rest    n = LP_100ms of f_q/|f_q|, in the first 0.3 s of a contact, where μ < 0.05 and n moves by less than 14°
///     p          = x - max(0, f·n - B v·n)/K n                        from the elastic part of the force, in every tick
///     κ          = cov(x_across, n)/(var(x_across) + (4.5 mm)²)       mean over 15 mm of way, |κ| <= 200 /m
///
/// n, p, K and κ are constants of a constant surface. Estimates that follow the force instead, n = f/|f| and p at the
/// beginning of the contact, close a delayed loop that oscillates.
template <int D>
class SurfaceEstimator {
 public:
  void reset() noexcept { detector_.reset(); }

  /// x: point of contact; it is the robot's own point, s = x.
  void step(const Point<D>& x, const Point<D>& v, const Point<D>& f, Seconds dt) noexcept { step(x, x, v, f, dt); }
  /// Where the contact moves over the robot, x moves and s does not. Only differences of s matter.
  void step(const Point<D>& x, const Point<D>& s, const Point<D>& v, const Point<D>& f, Seconds dt) noexcept {
    detector_.step(f, dt);
    if (detector_.begins()) return begin(x, s, v, f);
    if (!contact()) return;
    age_s_ += dt.si();
    filter(s, v, f, dt);
    fit_stiffness(s, v, f, dt);
    if constexpr (D != 1) {
      fit_normal(dt);
      fit_curvature(x, dt);
    }
    const double elastic = std::max(0.0, f.dot(patch_.normal) - damping_ * v.dot(patch_.normal));
    patch_.point = x - elastic / patch_.stiffness * patch_.normal;
  }

  [[nodiscard]] bool contact() const noexcept { return detector_.contact(); }
  /// Of the present contact, or of the last one.
  [[nodiscard]] const SurfacePatch<D>& patch() const noexcept { return patch_; }

 private:
  static constexpr double kSlow_s = 20e-3, kSlower_s = 10e-3;
  static constexpr double kStiffnessMemory_s = 0.5, kPrior_n_per_m = 2000.0, kPriorTravel_m = 30e-6,
                          kPriorSpeed_m_per_s = 3e-3;
  static constexpr double kLeast_n_per_m = 100.0, kMost_n_per_m = 50000.0, kPressed = 0.8, kLeastForce_n = 0.05,
                          kLeastTravel_m = 0.5e-3;
  static constexpr double kSlidingSpeed_m_per_s = 8e-3, kMostFriction = 0.75, kNormal_s = 30e-3, kFriction_s = 50e-3;
  static constexpr double kRestNormal_s = 0.1, kRestAge_s = 0.3, kFrictionless = 0.05, kRestCosine = 0.970;  // 14°
  static constexpr double kCurvatureMemory_m = 15e-3, kCurvaturePrior_m = 4.5e-3, kMostCurvature_per_m = 200.0;

  void begin(const Point<D>& x, const Point<D>& s, const Point<D>& v, const Point<D>& f) noexcept {
    age_s_ = 0.0;
    x_slow_ = s, x_mean_ = x, v_slow_ = v_surface_ = v, f_slow_ = f_surface_ = f;
    xx_ = xv_ = vv_ = xf_ = vf_ = 0.0;
    damping_ = variance_ = covariance_ = 0.0;
    patch_.normal = n_mean_ = detector_.force() / detector_.force().norm();
    patch_.stiffness = kPrior_n_per_m;
    patch_.friction = patch_.curvature = 0.0;
    patch_.point = x - std::max(0.0, f.dot(patch_.normal)) / patch_.stiffness * patch_.normal;
  }

  void filter(const Point<D>& s, const Point<D>& v, const Point<D>& f, Seconds dt) noexcept {
    low_pass(x_slow_, s, dt, kSlow_s);
    low_pass(v_slow_, v, dt, kSlow_s);
    low_pass(f_slow_, f, dt, kSlow_s);
    const Point<D> sliding = v_slow_ - (f - f_slow_) / (kSlow_s * patch_.stiffness);
    low_pass(v_surface_, sliding, dt, kSlower_s);
    low_pass(f_surface_, f_slow_, dt, kSlower_s);
  }

  void fit_stiffness(const Point<D>& s, const Point<D>& v, const Point<D>& f, Seconds dt) noexcept {
    const Point<D> moved = s - x_slow_;
    const double travel = moved.dot(patch_.normal), force = (f - f_slow_).dot(patch_.normal);
    const double speed = (v - v_slow_).dot(patch_.normal);
    if (std::abs(travel) < kPressed * moved.norm() ||
        (std::abs(force) < kLeastForce_n && std::abs(travel) < kLeastTravel_m))
      return;
    low_pass(xx_, travel * travel, dt, kStiffnessMemory_s);
    low_pass(xv_, travel * speed, dt, kStiffnessMemory_s);
    low_pass(vv_, speed * speed, dt, kStiffnessMemory_s);
    low_pass(xf_, travel * force, dt, kStiffnessMemory_s);
    low_pass(vf_, speed * force, dt, kStiffnessMemory_s);
    constexpr double kXx = kPriorTravel_m * kPriorTravel_m, kVv = kPriorSpeed_m_per_s * kPriorSpeed_m_per_s;
    const double a = xx_ + kXx, c = vv_ + kVv, p = xf_ + kPrior_n_per_m * kXx;
    const double determinant = a * c - xv_ * xv_;
    patch_.stiffness = std::clamp((p * c - vf_ * xv_) / determinant, kLeast_n_per_m, kMost_n_per_m);
    damping_ = std::max(0.0, (a * vf_ - xv_ * p) / determinant);
  }

  void fit_normal(Seconds dt) noexcept {
    const double speed = v_surface_.norm(), force = f_surface_.norm();
    if (speed > kSlidingSpeed_m_per_s) {
      const Point<D> u = v_surface_ / speed;
      const double along = f_surface_.dot(u);
      if (std::abs(along) < kMostFriction * force) {
        const Point<D> across = f_surface_ - along * u;
        const double size = across.norm();
        turn(across / size, dt, kNormal_s);
        low_pass(patch_.friction, std::clamp(along / size, 0.0, 1.0), dt, kFriction_s);
        return;
      }
    }
    if (age_s_ < kRestAge_s && patch_.friction < kFrictionless && f_surface_.dot(patch_.normal) > kRestCosine * force)
      turn(f_surface_ / force, dt, kRestNormal_s);
  }
  void turn(const Point<D>& to, Seconds dt, double tau_s) noexcept {
    low_pass(patch_.normal, to, dt, tau_s);
    const double size = patch_.normal.norm();
    if (size > 1e-3) {
      patch_.normal /= size;
    } else {
      patch_.normal = to;
    }
  }

  void fit_curvature(const Point<D>& x, Seconds dt) noexcept {
    const Point<D>& n = patch_.normal;
    const double way = (v_surface_ - v_surface_.dot(n) * n).norm() * dt.si();
    const double a = std::min(1.0, way / kCurvatureMemory_m);
    Point<D> from_mean = x - x_mean_;
    from_mean -= from_mean.dot(n) * n;
    const Point<D> turned = n - n_mean_;
    variance_ = (1.0 - a) * (variance_ + a * from_mean.squaredNorm());
    covariance_ = (1.0 - a) * (covariance_ + a * from_mean.dot(turned));
    x_mean_ += a * (x - x_mean_);
    n_mean_ += a * (n - n_mean_);
    patch_.curvature = std::clamp(covariance_ / (variance_ + kCurvaturePrior_m * kCurvaturePrior_m),
                                  -kMostCurvature_per_m, kMostCurvature_per_m);
  }

  SurfacePatch<D> patch_;
  ContactDetector<D> detector_;
  double age_s_ = 0.0;
  double damping_ = 0.0;  ///< B
  double xx_ = 0.0, xv_ = 0.0, vv_ = 0.0, xf_ = 0.0, vf_ = 0.0;
  double variance_ = 0.0, covariance_ = 0.0;
  Point<D> x_slow_ = Point<D>::Zero(), v_slow_ = Point<D>::Zero(), f_slow_ = Point<D>::Zero(),
           v_surface_ = Point<D>::Zero(), f_surface_ = Point<D>::Zero(), x_mean_ = Point<D>::Zero(),
           n_mean_ = Point<D>::Zero();
};

/// Bias of a force sensor: the mean reading of the first second, then its low pass (1 s; N = 6: 10 s and 10 s, as a light press in many contacts
/// passes for none for longer), while it is less than 0.3 N away,
/// the robot touches nothing and the bias is below 0.3 N. The thresholds are in the master's units, the readings in the slave's.
/// A torque counts by sqrt(K_c/K_r) in the bias, not in a reading, whose noise would then keep it from being learned.
template <int N>
class SensorBias {
 public:
  /// `force_scale`: newtons at the master for one at the slave. `stiffness_ratio`: K_c/K_r of the slave.
  SensorBias(double force_scale, double stiffness_ratio)
      : most_n_{kMost_n / force_scale}, stiffness_ratio_{stiffness_ratio} {}

  /// `f`: the sensor's reading, in free space only.
  void learn(const Force<N>& f, Seconds dt) noexcept {
    if (translation(f - value_) >= most_n_) return;
    learned_s_ = std::min(kMemory_s, learned_s_ + dt.si());
    Force<N> next = value_;
    low_pass(next, f, dt, learned_s_);
    if (wrench_norm(next, stiffness_ratio_) <= most_n_) value_ = next;
  }
  [[nodiscard]] const Force<N>& value() const noexcept { return value_; }

 private:
  static constexpr double kMost_n = 0.3, kMemory_s = N == 6 ? 10.0 : 1.0;
  static double translation(const Force<N>& f) noexcept { return f.vec().template head<kAxes<N>>().norm(); }

  double most_n_, stiffness_ratio_, learned_s_ = 0.0;
  Force<N> value_;
};

}  // namespace twoport
