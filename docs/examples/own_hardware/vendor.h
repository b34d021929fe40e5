#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>

// Stand-ins for the libraries of vendors: simulated hardware that runs by itself, in real time.

/// Calls step(t_s, step_s) for each 0.1 ms that has passed since the last call. False: none has.
class RunsByItself {
 public:
  template <class Step>
  bool catch_up(Step step) {
    const double step_s = 1e-4;
    const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    bool any = false;
    for (; time_s_ + step_s <= now_s; time_s_ += step_s, any = true) step(time_s_, step_s);
    return any;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  double time_s_ = 0.0;
};

/// A haptic device: a handle on a rail, which a hand moves back and forth between 0 and 40 mm with a period of 1.5 s.
/// Non-blocking; position grows to the right, a positive push goes to the right.
class Rail {
 public:
  bool open(int port) { return port == 1; }
  struct Reading {
    double x_m = 0.0, v_m_per_s = 0.0, push_n = 0.0;  ///< `push_n` was held until now
    bool fresh = false, broken = false;
  };
  Reading read() {
    const double mass_kg = 0.12, stiffness_n_per_m = 300.0, damping_n_s_per_m = 4.0;
    reading_.fresh = clock_.catch_up([&](double t_s, double step_s) {
      const double target_m = 0.02 * (1.0 - std::cos(2.0 * 3.14159 / 1.5 * t_s));
      const double hand_n = stiffness_n_per_m * (target_m - reading_.x_m) - damping_n_s_per_m * reading_.v_m_per_s;
      reading_.v_m_per_s += step_s / mass_kg * (hand_n + push_n_);
      reading_.x_m += step_s * reading_.v_m_per_s;
    });
    reading_.push_n = push_n_;
    return reading_;
  }
  void push(double n) { push_n_ = n; }

 private:
  RunsByItself clock_;
  Reading reading_;
  double push_n_ = 0.0;
};

/// A robot: a cart with a force sensor at its front, 20 mm before a wall. Non-blocking, torque control.
class Cart {
 public:
  struct Reading {
    double x_m = 0.0, v_m_per_s = 0.0, sensor_n = 0.0;  ///< `sensor_n`: of the wall on the cart
  };
  Reading read() {
    const double mass_kg = 0.5, damping_n_s_per_m = 2.0, wall_n_per_m = 3000.0;
    clock_.catch_up([&](double, double step_s) {
      reading_.sensor_n = -wall_n_per_m * std::max(0.0, reading_.x_m - 0.02);
      reading_.v_m_per_s += step_s / mass_kg * (drive_n_ + reading_.sensor_n - damping_n_s_per_m * reading_.v_m_per_s);
      reading_.x_m += step_s * reading_.v_m_per_s;
    });
    return reading_;
  }
  void drive(double n) { drive_n_ = n; }

 private:
  RunsByItself clock_;
  Reading reading_;
  double drive_n_ = 0.0;
};

/// An arm of two joints and a slide [rad], [rad], [m], whose motors carry its weight. In a hand its first joint goes to and fro between 0 and
/// 0.5 rad with a period of 3 s; by itself this joint meets a wall at 0.3 rad. Non-blocking, torque control.
class Scara {
 public:
  explicit Scara(bool in_hand) : in_hand_{in_hand} {}
  struct Reading {
    double q[3]{}, v[3]{};
    double motor[3]{};    ///< that the motors have held until now
    double outside[3]{};  ///< of hand or wall on the joints
  };
  Reading read() {
    const double inertia[3]{0.18, 0.03, 0.3}, stiffness[3]{30.0, 5.0, 300.0}, grip[3]{1.0, 0.2, 5.0};
    clock_.catch_up([&](double t_s, double step_s) {
      for (int i = 0; i < 3; ++i) {
        double& q = reading_.q[i];
        double& v = reading_.v[i];
        const double target = i == 0 ? 0.25 * (1.0 - std::cos(2.0 * 3.14159 / 3.0 * t_s)) : 0.0;
        reading_.outside[i] = in_hand_ ? stiffness[i] * (target - q) - grip[i] * v
                              : i == 0 ? -2000.0 * std::max(0.0, q - 0.3)
                                       : 0.0;
        v += step_s / inertia[i] * (motor_[i] + reading_.outside[i] - 0.1 * v);
        q += step_s * v;
      }
    });
    std::copy_n(motor_, 3, reading_.motor);
    return reading_;
  }
  void drive(const double* torque) { std::copy_n(torque, 3, motor_); }

 private:
  RunsByItself clock_;
  bool in_hand_;
  Reading reading_;
  double motor_[3]{};
};
