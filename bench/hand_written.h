#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "sim/linear.h"

namespace twoport::bench {

/// The same closed loop as LinkSimulation, written out by hand for translations: hand and device on one exact map,
/// constant delays, two-port observer and controller at both ends, virtual coupling, robot on an elastic wall stepped by
/// its exact map and cut at the contact. No reports, no mailboxes, no modes, no telemetry: what the arithmetic costs.
template <int N>
class HandWritten {
 public:
  using V = Eigen::Matrix<double, N, 1>;
  struct Parameters {
    double T, hand_m, hand_k, hand_b, device_m, device_b, k, b, robot_m, robot_b, wall_k, wall_at, e0, max_gain, engage_s;
    int delay_ticks;
  };

  explicit HandWritten(const Parameters& p)
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
    // What the handle does by itself: alpha-beta filter, the force fed forward.
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
    if (heard) {
      ramp_ = std::min(1.0, ramp_ + p_.T / p_.engage_s);
      const V f_d = ramp_ * from_slave.f;
      const V w = u_ + d_ - give_ * f_m_;
      const double available = p_.e0 + std::min(from_slave.in, in_m_) - out_m_;
      const double f2 = f_d.squaredNorm(), power = f_d.dot(w) - std::sqrt(f2) * doubt_;
      const double repaid =
          available < 0.0 && power > 0.0 ? std::min(-available, p_.max_gain * p_.T * power * power / f2) : 0.0;
      f = share(give_ * f2, -power, (std::max(available, 0.0) - repaid) / p_.T) * f_d;
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
      const double s = power <= a ? 1.0 : share(q, power - q, a);
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

  static double share(double q, double b, double a) {
    if (q + b <= a) return 1.0;
    const double root = std::sqrt(std::max(0.0, b * b + 4.0 * q * a));
    return std::clamp(b <= 0.0 ? (root - b) / (2.0 * q) : 2.0 * a / (root + b), 0.0, 1.0);
  }

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

  Parameters p_;
  sim::Response hand_, free_, touch_;
  double compliance_, give_;
  std::vector<ToSlave> to_slave_;
  std::vector<ToMaster> to_master_;
  V x_m_ = V::Zero(), x_m_before_ = V::Zero(), v_m_ = V::Zero(), f_m_ = V::Zero();
  V f_m_before_ = V::Zero(), u_ = V::Zero(), d_ = V::Zero();
  double doubt_ = 0.0;
  V x_s_ = V::Zero(), x_s_before_ = V::Zero(), v_s_ = V::Zero(), f_s_ = V::Zero(), x_sd_ = V::Zero();
  V x_h_ = V::Zero();
  double in_m_ = 0, out_m_ = 0, in_s_ = 0, out_s_ = 0, created_ = 0, worst_ = 0, credit_ = 0, ramp_ = 0;
  std::size_t tick_ = 0;
};

}  // namespace twoport::bench
