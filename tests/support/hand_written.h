#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/vector.h"
#include "sim/plant/integrators.h"

namespace twoport::bench {

/// Press a wall and hold, 20 ms each way, no loss: the scene that the chain and the loops below both run.
inline std::string wall_scene(int dof) {
  const std::string zeros = dof == 1 ? "]" : ", 0, 0]", six = dof == 6 ? " inertia_kg_m2: 1e-3" : "";
  return "dof: " + std::to_string(dof) + " duration_s: 8 rate_hz: 2000\n" +
         "operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 " +
         (dof == 6 ? "rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 " : "") + "}\n" +
         "  path { move_to { position_m: [0.03" + zeros + " duration_s: 1 } } }\n" +
         "device { mass_kg: 0.075 damping_n_s_per_m: 0.05" + six + " }\n" +
         "control { architecture: POSITION_FORCE virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } "
         "passivity { method: FORCE_PROJECTED } }\n" +
         "to_slave { delay_ms: 20 } to_master { delay_ms: 20 }\n" + "robot { mass_kg: 0.5 damping_n_s_per_m: 2 " +
         (dof == 6 ? "inertia_kg_m2: [2e-3, 3e-3, 4e-3]" : "") + " }\n" + "environment { wall { normal: [-1" + zeros +
         " offset_m: -0.02 stiffness_n_per_m: 5000 } }\n";
}

/// The same in numbers. The second part is for rotations.
struct WallParameters {
  double T = 1.0 / 2000, hand_m = 0.1, hand_k = 400, hand_b = 8, device_m = 0.075, device_b = 0.05, k = 1000, b = 20,
         robot_m = 0.5, robot_b = 2, wall_k = 5000, wall_at = 0.02, e0 = 1e-3, max_gain = 10, engage_s = 0.1;
  double hand_kr = 5, hand_br = 0.05, device_j = 1e-3, kr = 10, br = 0.2;
  Eigen::Vector3d robot_j{2e-3, 3e-3, 4e-3};
  int delay_ticks = 40;

  /// How far the hand wants to be at tick k [m]: 30 mm in 1 s, minimum jerk.
  [[nodiscard]] double intended(int tick) const {
    const double s = std::min(1.0, tick * T);
    return 0.03 * (s * s * s * (10.0 - s * (15.0 - 6.0 * s)));
  }
};

/// Largest s in [0, 1] with q s² + b s <= a.
inline double largest_feasible_scale(double q, double b, double a) {
  if (q + b <= a) return 1.0;
  const double root = std::sqrt(std::max(0.0, b * b + 4.0 * q * a));
  return std::clamp(b <= 0.0 ? (root - b) / (2.0 * q) : 2.0 * a / (root + b), 0.0, 1.0);
}

/// The same closed loop as LinkLoop, written out by hand for translations: hand and device on one exact map,
/// constant delays, two-port observer and controller at both ends, virtual coupling, robot on an elastic wall stepped
/// by its exact map and cut at the contact. No reports, mailboxes, modes, telemetry: the cost of the arithmetic.
template <int N>
class HandWritten {
 public:
  using V = Eigen::Matrix<double, N, 1>;

  explicit HandWritten(const WallParameters& p = {})
      : p_{p},
        hand_{{p.hand_m + p.device_m, p.hand_b + p.device_b, p.hand_k}, p.T},
        free_{{p.robot_m, p.robot_b, 0.0}, p.T},
        touch_{{p.robot_m, p.robot_b, p.wall_k}, p.T},
        compliance_{1.0 / (p.b + p.k * p.T)},
        give_{0.5 * p.T / p.device_m},
        to_slave_(static_cast<std::size_t>(p.delay_ticks)),
        to_master_(static_cast<std::size_t>(p.delay_ticks)) {}

  /// One tick of both sides towards the intended position x_h at its end.
  void step(const V& x_h_next) {
    // Master: book, receive, bound, send.
    const double dE = f_m_.dot(x_m_ - x_m_before_);
    (dE > 0.0 ? in_m_ : out_m_) += std::abs(dE);
    const double put_in = std::max(dE, 0.0);
    // Free motion of the handle: alpha-beta filter with feedforward of the force.
    const V expected = u_ + d_ - give_ * (f_m_before_ + f_m_), e = (x_m_ - x_m_before_) / p_.T - expected;
    if (tick_ > 0) {
      u_ = expected + 0.75 * e;
      d_ += 0.25 * e;
      doubt_ = std::max(e.norm(), 0.95 * doubt_);
    }
    f_m_before_ = f_m_;
    x_m_before_ = x_m_;
    const std::size_t at = tick_ % to_slave_.size();
    const ToMaster from_slave = to_master_[at];
    const ToSlave from_master = to_slave_[at];
    const bool heard = tick_ >= to_slave_.size();

    V f = V::Zero();
    // A deficit is cancelled by what the hand puts in.
    known_ = std::max(known_, from_slave.in);
    const double kept = std::max(0.0, std::min(put_in, out_m_ - (p_.e0 + known_)));
    in_m_ -= kept;
    out_m_ -= kept;
    if (heard) {
      ramp_ = std::min(1.0, ramp_ + p_.T / p_.engage_s);
      const V f_d = ramp_ * from_slave.f;
      const V w = u_ + d_ - give_ * f_m_;
      const double available = p_.e0 + std::min(from_slave.in, in_m_) - out_m_;
      const double f2 = f_d.squaredNorm(), power = f_d.dot(w) - std::sqrt(f2) * doubt_;
      const double repaid =
          available < 0.0 && power > 0.0 ? std::min(-available, p_.max_gain * p_.T * power * power / f2) : 0.0;
      f = largest_feasible_scale(give_ * f2, -power, (std::max(available, 0.0) - repaid) / p_.T) * f_d;
    }
    to_slave_[at] = {x_m_, v_m_, in_m_};

    // Slave: receive, couple, bound, send.
    V f_s = V::Zero(), f_back = V::Zero();
    created_ -= f_s_.dot(x_s_ - x_s_before_);
    x_s_before_ = x_s_;
    if (heard) {
      const V v_d = (from_master.x - x_sd_) / p_.T;
      const V repair = v_d - from_master.v;
      const double r2 = repair.squaredNorm();
      const V v = r2 <= 0.0025 ? v_d : V{from_master.v + 0.05 / std::sqrt(r2) * repair};
      const V f_d = p_.k * (x_sd_ + p_.T * v - x_s_) + p_.b * (from_master.v - v_s_);
      const double power = f_d.dot(v), q = compliance_ * f_d.squaredNorm();
      const double a = std::max(p_.e0 + from_master.in - out_s_, 0.0) / p_.T;
      const double s = power <= a ? 1.0 : largest_feasible_scale(q, power - q, a);
      f_s = s * f_d;
      const V moved = p_.T * (v - (1.0 - s) * compliance_ * f_d);
      const double into = f_s.dot(moved);
      (into > 0.0 ? out_s_ : in_s_) += std::abs(into);
      created_ += into;
      x_sd_ += moved;
      f_back = f_d;
    }
    worst_ = std::min(worst_, created_);
    credit_ = std::max(credit_, in_s_ + worst_);
    to_master_[at] = {f_back, credit_};

    // Plants, under the forces held until the next tick.
    const V rate = (x_h_next - x_h_) / p_.T;
    const V u = p_.hand_k * (x_h_ - x_m_) + p_.hand_b * rate - f, slope = p_.hand_k * rate;
    x_m_ += hand_.xv * v_m_ + hand_.xu * u + hand_.xw * slope;
    v_m_ = hand_.vv * v_m_ + hand_.vu * u + hand_.vw * slope;
    x_h_ = x_h_next;
    robot(f_s);
    f_m_ = f;
    f_s_ = f_s;
    ++tick_;
  }

  [[nodiscard]] const V& master() const { return x_m_; }
  [[nodiscard]] const V& slave() const { return x_s_; }

 private:
  struct ToSlave {
    V x = V::Zero(), v = V::Zero();
    double in = 0.0;
  };
  struct ToMaster {
    V f = V::Zero();
    double in = 0.0;
  };

  void robot(const V& f) {
    double left = p_.T;
    bool in = x_s_[0] > p_.wall_at;
    while (left > 0.0) {
      V x = x_s_, v = v_s_;
      move(f, in, left, x, v);
      if ((x[0] > p_.wall_at) == in) {
        x_s_ = x, v_s_ = v;
        return;
      }
      double lo = 0.0, hi = left;
      for (int i = 0; i < 60 && hi - lo > 1e-13 * left; ++i) {
        const double mid = 0.5 * (lo + hi);
        const double wall = in ? p_.wall_k : 0.0;
        const sim::AxisState s = sim::propagate({p_.robot_m, p_.robot_b, wall}, {0.0, v_s_[0]},
                                                f[0] - wall * (x_s_[0] - p_.wall_at), 0.0, mid);
        (((x_s_[0] + s.x > p_.wall_at) == in) ? lo : hi) = mid;
      }
      move(f, in, hi, x_s_, v_s_);
      in = !in;
      left -= hi;
    }
  }
  void move(const V& f, bool in, double h, V& x, V& v) const {
    const sim::Response along = h == p_.T ? free_ : sim::Response{{p_.robot_m, p_.robot_b, 0.0}, h};
    const sim::Response across =
        !in ? along : (h == p_.T ? touch_ : sim::Response{{p_.robot_m, p_.robot_b, p_.wall_k}, h});
    const double un = f[0] - (in ? p_.wall_k * (x[0] - p_.wall_at) : 0.0);
    const double xn = x[0] + across.xv * v[0] + across.xu * un, vn = across.vv * v[0] + across.vu * un;
    x += along.xv * v + along.xu * f;
    v = along.vv * v + along.vu * f;
    x[0] = xn, v[0] = vn;
  }

  WallParameters p_;
  sim::Response hand_, free_, touch_;
  double compliance_, give_;
  std::vector<ToSlave> to_slave_;
  std::vector<ToMaster> to_master_;
  V x_m_ = V::Zero(), x_m_before_ = V::Zero(), v_m_ = V::Zero(), f_m_ = V::Zero();
  V f_m_before_ = V::Zero(), u_ = V::Zero(), d_ = V::Zero();
  double doubt_ = 0.0;
  double known_ = 0.0;  ///< largest total of the slave
  V x_s_ = V::Zero(), x_s_before_ = V::Zero(), v_s_ = V::Zero(), f_s_ = V::Zero(), x_sd_ = V::Zero();
  V x_h_ = V::Zero();
  double in_m_ = 0, out_m_ = 0, in_s_ = 0, out_s_ = 0, created_ = 0, worst_ = 0, credit_ = 0, ramp_ = 0;
  std::size_t tick_ = 0;
};

/// The same for poses: wrenches and twists, rotations of hand, handle and coupling, a rigid robot that touches with its
/// tool's origin and is stepped by one Runge-Kutta step a tick (as this wall and mass need), cut at the contact by
/// bisection. Positions, their differences and sums are those of common/base/vector.h; the rest is written out.
class HandWritten6 {
 public:
  using V = Eigen::Matrix<double, 6, 1>;
  using V3 = Eigen::Vector3d;
  using Pose = Position<6>;

  explicit HandWritten6(const WallParameters& p = {})
      : p_{p},
        hand_{{p.hand_m + p.device_m, p.hand_b + p.device_b, p.hand_k}, p.T},
        turn_{{p.device_j, p.hand_br, p.hand_kr}, p.T},
        hand_k_{both(p.hand_k, p.hand_kr)},
        hand_b_{both(p.hand_b, p.hand_br)},
        k_{both(p.k, p.kr)},
        b_{both(p.b, p.br)},
        compliance_{(b_ + k_ * p.T).cwiseInverse()},
        give_{both(0.5 * p.T / p.device_m, 0.5 * p.T / p.device_j)},
        to_slave_(static_cast<std::size_t>(p.delay_ticks)),
        to_master_(static_cast<std::size_t>(p.delay_ticks)) {}

  /// One tick of both sides towards the intended pose x_h at its end.
  void step(const Pose& x_h_next) {
    // Master: book, receive, bound, send.
    const Displacement<6> moved_m = x_m_ - x_m_before_;
    const double dE =
        f_m_.dot(moved_m.vec()) + p_.T * p_.T / 12.0 * f_m_.tail<3>().dot(turning(v_m_before_).cross(turning(v_m_)));
    (dE > 0.0 ? in_m_ : out_m_) += std::abs(dE);
    const double put_in = std::max(dE, 0.0);
    // Free motion of the handle: alpha-beta filter with feedforward of the force.
    const V expected = u_ + d_ - give_.cwiseProduct(f_m_before_ + f_m_), e = moved_m.vec() / p_.T - expected;
    if (tick_ > 0) {
      u_ = expected + 0.75 * e;
      d_ += 0.25 * e;
      doubt_ = std::max(e.head<3>().norm(), 0.95 * doubt_);
      spin_doubt_ = std::max(e.tail<3>().norm(), 0.95 * spin_doubt_);
    }
    f_m_before_ = f_m_;
    x_m_before_ = x_m_;
    const std::size_t at = tick_ % to_slave_.size();
    const ToMaster from_slave = to_master_[at];
    const ToSlave from_master = to_slave_[at];
    const bool heard = tick_ >= to_slave_.size();

    V f = V::Zero();
    // A deficit is cancelled by what the hand puts in.
    known_ = std::max(known_, from_slave.in);
    const double kept = std::max(0.0, std::min(put_in, out_m_ - (p_.e0 + known_)));
    in_m_ -= kept;
    out_m_ -= kept;
    if (heard) {
      ramp_ = std::min(1.0, ramp_ + p_.T / p_.engage_s);
      const V f_d = ramp_ * from_slave.f;
      const V w = u_ + d_ - give_.cwiseProduct(f_m_);
      const double available = p_.e0 + std::min(from_slave.in, in_m_) - out_m_;
      const double power = f_d.dot(w) - f_d.head<3>().norm() * doubt_ - f_d.tail<3>().norm() * spin_doubt_;
      const double repaid = available < 0.0 && power > 0.0
                                ? std::min(-available, p_.max_gain * p_.T * power * power / f_d.squaredNorm())
                                : 0.0;
      f = largest_feasible_scale(f_d.dot(give_.cwiseProduct(f_d)), -power, (std::max(available, 0.0) - repaid) / p_.T) *
          f_d;
    }
    v_m_before_ = v_m_;
    to_slave_[at] = {x_m_, v_m_, in_m_};

    // Slave: receive, couple, bound, send.
    V f_s = V::Zero(), f_back = V::Zero();
    created_ -= f_s_.dot((x_s_ - x_s_before_).vec());
    x_s_before_ = x_s_;
    if (heard) {
      V repair = (from_master.x - x_sd_).vec() / p_.T - from_master.v;
      repair.head<3>() *= bounded(repair.head<3>().squaredNorm(), 0.05);
      repair.tail<3>() *= bounded(repair.tail<3>().squaredNorm(), 0.5);
      const V v = from_master.v + repair;
      const V f_d =
          k_.cwiseProduct((x_sd_ + Displacement<6>{p_.T * v} - x_s_).vec()) + b_.cwiseProduct(from_master.v - v_s_);
      const V give = compliance_.cwiseProduct(f_d);
      const double power = f_d.dot(v), q = f_d.dot(give);
      const double a = std::max(p_.e0 + from_master.in - out_s_, 0.0) / p_.T;
      const double s = power <= a ? 1.0 : largest_feasible_scale(q, power - q, a);
      f_s = s * f_d;
      const V moved = p_.T * (v - (1.0 - s) * give);
      const double into = f_s.dot(moved);
      (into > 0.0 ? out_s_ : in_s_) += std::abs(into);
      created_ += into;
      x_sd_ = x_sd_ + Displacement<6>{moved};
      f_back = f_d;
    }
    worst_ = std::min(worst_, created_);
    credit_ = std::max(credit_, in_s_ + worst_);
    to_master_[at] = {f_back, credit_};

    // Plants, under the forces held until the next tick.
    hand(x_h_next, f);
    robot(f_s);
    f_m_ = f;
    f_s_ = f_s;
    ++tick_;
  }

  [[nodiscard]] const Pose& master() const { return x_m_; }
  [[nodiscard]] const Pose& slave() const { return x_s_; }

 private:
  struct ToSlave {
    Pose x;
    V v = V::Zero();
    double in = 0.0;
  };
  struct ToMaster {
    V f = V::Zero();
    double in = 0.0;
  };

  static V both(double translation, double rotation) {
    V v;
    v << V3::Constant(translation), V3::Constant(rotation);
    return v;
  }
  static V3 turning(const V& v) { return v.tail<3>(); }
  static double bounded(double norm2, double limit) { return norm2 <= limit * limit ? 1.0 : limit / std::sqrt(norm2); }

  void hand(const Pose& x_h_next, const V& f) {
    const V rate = (x_h_next - x_h_).vec() / p_.T, stretch = (x_h_ - x_m_).vec();
    const V u = hand_k_.cwiseProduct(stretch) + hand_b_.cwiseProduct(rate) - f;
    V slope = hand_k_.cwiseProduct(rate);
    const V3 r = stretch.tail<3>(), w_h = rate.tail<3>(), w0 = v_m_.tail<3>();
    slope.tail<3>() -= p_.hand_kr * r.cross(0.5 * (w_h + w0) - r.cross(w_h - w0) / 12.0);
    V moved, v;
    moved << hand_.xv * v_m_.head<3>() + hand_.xu * u.head<3>() + hand_.xw * slope.head<3>(),
        turn_.xv * v_m_.tail<3>() + turn_.xu * u.tail<3>() + turn_.xw * slope.tail<3>();
    v << hand_.vv * v_m_.head<3>() + hand_.vu * u.head<3>() + hand_.vw * slope.head<3>(),
        turn_.vv * v_m_.tail<3>() + turn_.vu * u.tail<3>() + turn_.vw * slope.tail<3>();
    const V3 w1 = v.tail<3>();
    moved.tail<3>() -= p_.T * p_.T / 12.0 * w0.cross(w1);
    x_m_ = x_m_ + Displacement<6>{moved};
    v_m_ = v;
    x_h_ = x_h_next;
  }

  /// Pose, momentum and angular momentum.
  struct Body {
    Pose x;
    V p = V::Zero();
  };
  struct Slope {
    V v, p;
  };
  [[nodiscard]] bool touches(const Body& m) const { return m.x.translation()[0] > p_.wall_at; }
  [[nodiscard]] V velocity(const Body& m) const {
    const Eigen::Matrix3d R = m.x.attitude().toRotationMatrix();
    V v;
    v << m.p.head<3>() / p_.robot_m, R * (R.transpose() * m.p.tail<3>()).cwiseQuotient(p_.robot_j);
    return v;
  }
  [[nodiscard]] Slope slope(const Body& m, const V& f, bool in) const {
    Slope s{velocity(m), f};
    s.p.head<3>() -= p_.robot_b * s.v.head<3>();
    if (in) s.p[0] -= p_.wall_k * (m.x.translation()[0] - p_.wall_at);
    return s;
  }
  /// Rate of the rotation vector r that turns with ω: ω - ½ r×ω + (1/12) r×(r×ω).
  static V turned(const V& moved, V v) {
    const V3 r = moved.tail<3>(), w = v.tail<3>(), rw = r.cross(w);
    v.tail<3>() = w - 0.5 * rw + r.cross(rw) / 12.0;
    return v;
  }
  static Body at(const Body& m, const V& moved, const V& dp) { return {m.x + Displacement<6>{moved}, m.p + dp}; }
  [[nodiscard]] Body runge_kutta(const Body& m, const V& f, bool in, double h) const {
    const Slope a = slope(m, f, in);
    const V xa = 0.5 * h * a.v;
    const Slope b = slope(at(m, xa, 0.5 * h * a.p), f, in);
    const V vb = turned(xa, b.v), xb = 0.5 * h * vb;
    const Slope c = slope(at(m, xb, 0.5 * h * b.p), f, in);
    const V vc = turned(xb, c.v), xc = h * vc;
    const Slope d = slope(at(m, xc, h * c.p), f, in);
    return at(m, h / 6.0 * (a.v + 2.0 * (vb + vc) + turned(xc, d.v)), h / 6.0 * (a.p + 2.0 * (b.p + c.p) + d.p));
  }
  void robot(const V& f) {
    for (double left = p_.T; left > 0.0;) {
      const bool in = touches(body_);
      double h = left;
      Body next = runge_kutta(body_, f, in, h);
      if (touches(next) != in) {
        for (double lo = 0.0; h - lo > 1e-7 * left;) {
          const double mid = 0.5 * (lo + h);
          const Body trial = runge_kutta(body_, f, in, mid);
          if (touches(trial) == in) {
            lo = mid;
          } else {
            h = mid;
            next = trial;
          }
        }
      }
      body_ = next;
      left -= h;
    }
    x_s_ = body_.x;
    v_s_ = velocity(body_);
  }

  WallParameters p_;
  sim::Response hand_, turn_;
  V hand_k_, hand_b_, k_, b_, compliance_, give_;
  std::vector<ToSlave> to_slave_;
  std::vector<ToMaster> to_master_;
  Pose x_m_, x_m_before_, x_s_, x_s_before_, x_sd_, x_h_;
  V v_m_ = V::Zero(), v_m_before_ = V::Zero(), f_m_ = V::Zero(), v_s_ = V::Zero(), f_s_ = V::Zero();
  V f_m_before_ = V::Zero(), u_ = V::Zero(), d_ = V::Zero();
  double doubt_ = 0.0, spin_doubt_ = 0.0;
  double known_ = 0.0;  ///< largest total of the slave
  Body body_;
  double in_m_ = 0, out_m_ = 0, in_s_ = 0, out_s_ = 0, created_ = 0, worst_ = 0, credit_ = 0, ramp_ = 0;
  std::size_t tick_ = 0;
};

}  // namespace twoport::bench
