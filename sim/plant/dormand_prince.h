#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "sim/plant/rigid_contact.h"

namespace twoport::sim {

/// A body under a held force in an environment, by the method of Dormand and Prince, 5(4) (Hairer, Nørsett and Wanner, Solving ODEs I,
/// II.4 and II.6). State of a rigid body: position, attitude as a quaternion q, momentum P and angular momentum L in world axes,
///
///     ẋ = P/m,   q̇ = ½ (0, ω) q,   Ṗ = f - b v + Σ f_i,   L̇ = τ - b_r ω + Σ r_i×f_i,      ω = R J⁻¹ Rᵀ L
///
/// so that without a wrench both momenta are constant to the bit. Of N = 1 and 3: position and velocity.
///
/// Steps are as long as the difference to the embedded solution of fourth order allows: `tolerance_m` for a position, for a rotation
/// times kArm_m, for a velocity times kVelocityTime_s. The length is kept from one tick to the next. Within a step each contact keeps
/// its mode: none, or a feature of the surface with the point sticking (below kStictionSpeed) or sliding; its law goes on smoothly
/// beyond the mode's end. Where a mode ends within a step, or a point enters and leaves a surface within it, the moment is found on the
/// method's continuous extension, and the step is made anew up to there.
///
/// A tick with friction too stiff for explicit steps, or with more than kSteps steps or kCuts changes of mode, is
/// RungeKuttaPlant's (RODAS).
template <int N>
class DormandPrincePlant final : public BodyPlant<N> {
 public:
  using Vector = typename Body<N>::Vector;

  /// How a contact acts during a step.
  struct Mode {
    Feature feature = kNone;
    bool slides = false;
    friend bool operator==(const Mode&, const Mode&) = default;
  };
  /// Position, attitude (x, y, z, w; N = 6), momenta in the manner of Body::Motion::p; one more where the number is odd.
  static constexpr int kNumbers = N == 6 ? 14 : 2 * N;
  using Numbers = Eigen::Matrix<double, kNumbers, 1>;
  /// State between two ticks.
  struct State {
    Numbers y = Numbers::Zero();
    Numbers rate = Numbers::Zero();  ///< of y, under held
    Vector held = Vector::Zero(), environment = Vector::Zero();
    double step = 0.0;        ///< length of the next step, as far as the error tells [s]
    double friction = 0.0;    ///< sum of the contacts' Coulomb damping [N s/m]
    std::vector<Mode> modes;  ///< of each pair of a point and a surface
  };

  DormandPrincePlant(const RobotSpec& robot, std::shared_ptr<const Environment<N>> environment, double dt,
                     const BodyState<N>& start, double tolerance_m, std::size_t few = BroadPhase<kAxes<N>>::kFew)
      : environment_{environment},
        stiff_{robot, environment, dt, start, few},
        dt_{dt},
        tolerance_{tolerance_m},
        mass_{robot.mass_kg},
        damping_{robot.damping_n_s_per_m},
        rotational_damping_{robot.rotational_damping_n_m_s_per_rad} {
    if constexpr (N == 6) inertia_ = vector<3>(robot.inertia_kg_m2), inverse_inertia_ = inertia_.cwiseInverse();
    static const std::vector<Eigen::Vector3d> kOrigin{Eigen::Vector3d::Zero()};
    const std::vector<Eigen::Vector3d>& points = N == 6 ? environment_->tool() : kOrigin;
    look_for_friction();
    for (const Eigen::Vector3d& point : points) {
      for (const Surface& s : environment_->world().surfaces) pairs_.push_back({point, &s});
      reach_ = std::max(reach_, point.norm());
      if constexpr (N == 6) mobility_ = std::max(mobility_, 1.0 / mass_ + point.squaredNorm() / inertia_.minCoeff());
    }
    if (N != 6) mobility_ = 1.0 / mass_;
    for (const Spring& s : environment_->world().springs) {
      Springs sum{s.stiffness_n_per_m,     s.damping_n_s_per_m,    s.anchor_m, 0.0,
                  Eigen::Vector3d::Zero(), Eigen::Matrix3d::Zero()};
      for (std::size_t i = 0; i < points.size(); ++i) {
        if (!s.acts_on(static_cast<int>(i))) continue;
        sum.count += 1.0;
        sum.arms += points[i];
        sum.moments += points[i].squaredNorm() * Eigen::Matrix3d::Identity() - points[i] * points[i].transpose();
      }
      springs_.push_back(sum);
    }
    s_.modes.resize(pairs_.size());
    found_.resize(pairs_.size());
    before_.resize(pairs_.size());
    active_.reserve(pairs_.size());
    changed_.reserve(pairs_.size());
    flips_.reserve(pairs_.size());
    if (environment_->world().surfaces.size() > few)
      near_ = BroadPhase<D>{environment_->world().surfaces, kFast_m_per_s * dt};
    for (std::vector<int>* list : {&near_now_, &near_before_}) list->reserve(pairs_.size());
    looked_.reserve(3 * pairs_.size());
    list_all(looked_);
    s_.step = dt;
    place(start);
  }

  void surfaces_have_changed() noexcept override {
    look_for_friction();
    stiff_.surfaces_have_changed();
    place(body());
  }

  [[nodiscard]] std::unique_ptr<BodyPlant<N>> copy() const override {
    return std::make_unique<DormandPrincePlant>(*this);
  }
  BodyState<N> advance(const Force<N>& force) noexcept override {
    const Vector f = port_vector<N>(force.vec());
    add_force(s_.rate, f - s_.held);
    s_.held = f;
    if (rough_ && s_.friction * mobility_ * dt_ > kStiff) [[unlikely]] {
      go_stiff(dt_);
      return body();
    }
    double left = dt_;
    for (int steps = 0, cuts = 0; left > 0.0; ++steps) {
      if (steps >= kSteps || cuts >= kCuts) [[unlikely]] {
        go_stiff(left);
        break;
      }
      const double wanted = std::min(s_.step, left);
      const double h = wanted < left ? left / std::ceil(left / wanted) : left;
      const double error = make_step(h);
      if (!(error <= 1.0)) [[unlikely]] {
        s_.step = h * (error > 1.0 ? std::max(0.2, 0.9 * std::pow(error, -0.2)) : 0.2);
        if (!(s_.step > 1e-12 * dt_)) s_.step = 1e-12 * dt_, steps = kSteps;
        continue;
      }
      if (find_changes(h)) [[unlikely]] {
        const double taken = step_to_change(h);
        ++cuts;
        left = taken == left ? 0.0 : left - taken;
        continue;
      }
      keep_look();
      s_.friction = end_friction_;
      s_.y = next_;
      s_.rate = stage_[6];
      s_.environment = end_environment_;
      left = h == left ? 0.0 : left - h;
      const double longer = error < 3e-4 ? 5.0 * h : h * std::min(5.0, 0.9 * std::pow(error, -0.2));
      s_.step = std::min(h < s_.step ? std::max(s_.step, longer) : longer, dt_);
    }
    return body();
  }
  [[nodiscard]] BodyState<N> body() const noexcept { return body_at(s_.y); }
  [[nodiscard]] Force<N> environment_force() const noexcept override { return Force<N>{s_.environment}; }
  void kick(const Velocity<N>& dv) noexcept override {
    BodyState<N> now = body();
    now.v += dv;
    place(now);
  }

 private:
  static constexpr int kSteps = 4000;              // of a tick
  static constexpr int kCuts = 200;                // of a tick
  static constexpr double kStiff = 100.0;          // time constants of friction in a tick: beyond, RODAS
  static constexpr double kArm_m = 0.1;            // of a rotation, in the error
  static constexpr double kVelocityTime_s = 0.01;  // of a velocity, in the error
  static constexpr double kFast_m_per_s = 5.0;     // of a point: beyond, all of many surfaces are looked at
  static constexpr int D = kAxes<N>;
  using Where = Point<D>;

  struct Pair {
    Eigen::Vector3d point;
    const Surface* surface;
  };
  /// A spring on all its points: Σ r and Σ (|r|² 1 - r rᵀ) over them, in tool axes.
  struct Springs {
    double stiffness, damping;
    Eigen::Vector3d anchor;
    double count;
    Eigen::Vector3d arms;
    Eigen::Matrix3d moments;
  };
  struct Active {
    int pair;
    Mode mode;
  };
  /// A pair at the end of a step. `pressed` is positive in contact: min(depth, K depth - B v_n).
  struct Found {
    double distance, rate, pressed;
    double slip;  ///< |v_t|² - kStictionSpeed²
    Mode mode;
  };
  /// What the rates of a state need.
  struct Frame {
    Eigen::Matrix3d R;
    Eigen::Vector3d x, v, w, w_body;
  };
  struct FrameOfPoint {
    Where x, v;
  };
  using AnyFrame = std::conditional_t<N == 6, Frame, FrameOfPoint>;

  [[nodiscard]] AnyFrame frame(const Numbers& y) const noexcept {
    if constexpr (N == 6) {
      Frame f;
      const double qx = y[3], qy = y[4], qz = y[5], qw = y[6];
      const double xx = qx * qx, yy = qy * qy, zz = qz * qz, xy = qx * qy, xz = qx * qz, yz = qy * qz, wx = qw * qx,
                   wy = qw * qy, wz = qw * qz;
      f.R << 1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy), 2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz),
          2.0 * (yz - wx), 2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy);
      f.x = y.template head<3>();
      f.v = y.template segment<3>(7) / mass_;
      f.w_body = (f.R.transpose() * y.template segment<3>(10)).cwiseProduct(inverse_inertia_);
      f.w = f.R * f.w_body;
      return f;
    } else {
      return {y.template head<N>(), y.template tail<N>()};
    }
  }
  /// Place, velocity and arm of a pair's point.
  struct At {
    Where arm, p, v;
  };
  [[nodiscard]] At at(const AnyFrame& f, const Pair& pair) const noexcept {
    if constexpr (N == 6) {
      Eigen::Vector3d arm = f.R * pair.point;
      return {arm, f.x + arm, f.v + f.w.cross(arm)};
    } else {
      (void)pair;
      return {Where::Zero(), f.x, f.v};
    }
  }
  [[nodiscard]] static Where along_surface(const SignedDistance<D>& d, const Where& v, double vn) noexcept {
    const double squared = d.normal.squaredNorm();
    return std::abs(squared - 1.0) > 1e-9 ? Where{v - vn / squared * d.normal} : Where{v - vn * d.normal};
  }
  /// The law of a contact (common/contact/contact_law.h) in a mode that is kept: it may pull, and sticks at any speed.
  static Where force(const Material& m, const SignedDistance<D>& d, const Where& v, bool slides,
                     double& coulomb) noexcept {
    const double vn = d.normal.dot(v), fn = -m.stiffness_n_per_m * d.distance - m.damping_n_s_per_m * vn;
    Where f = fn * d.normal;
    if constexpr (D > 1) {
      if (m.friction > 0.0 || m.viscous_friction_n_s_per_m > 0.0) {
        const Where vt = along_surface(d, v, vn);
        const double speed = slides ? std::max(vt.norm(), kStictionSpeed) : kStictionSpeed;
        coulomb = m.friction * std::max(fn, 0.0) / speed;
        f -= (m.viscous_friction_n_s_per_m + coulomb) * vt;
      }
    }
    return f;
  }
  static void look(const Pair& pair, const At& a, Found& out) noexcept {
    const Material& m = pair.surface->material;
    const SignedDistance<D> d = signed_distance<D>(pair.surface->shape, a.p, kNearest);
    const double vn = d.normal.dot(a.v);
    out.distance = d.distance;
    out.rate = vn;
    out.pressed = std::min(-d.distance, -m.stiffness_n_per_m * d.distance - m.damping_n_s_per_m * vn);
    out.slip = -1.0;
    out.mode = {};
    if (!(out.pressed > 0.0)) return;
    if (D > 1 && m.friction > 0.0) out.slip = along_surface(d, a.v, vn).squaredNorm() - kStictionSpeed * kStictionSpeed;
    out.mode = {d.feature, out.slip > 0.0};
  }

  /// Which pairs to look at: of many surfaces those near the points now or at the step's start, and those in contact. Another pair is
  /// further from both than its point goes in the step: it neither touches nor dips.
  void list_near(const AnyFrame& at_y) noexcept {
    if (near_.empty()) return;
    near_now_.clear();
    double speed = at_y.v.norm();
    if constexpr (N == 6) speed += at_y.w.norm() * reach_;
    if (speed < kFast_m_per_s) {
      const std::size_t surfaces = environment_->world().surfaces.size();
      for (std::size_t first = 0; first < pairs_.size(); first += surfaces)
        for (const int i : near_.at(at(at_y, pairs_[first]).p)) near_now_.push_back(static_cast<int>(first) + i);
    } else {
      list_all(near_now_);
    }
    looked_.assign(near_now_.begin(), near_now_.end());
    looked_.insert(looked_.end(), near_before_.begin(), near_before_.end());
    for (const Active& a : active_) looked_.push_back(a.pair);
    std::sort(looked_.begin(), looked_.end());
    looked_.erase(std::unique(looked_.begin(), looked_.end()), looked_.end());
    for (const int i : near_now_)
      if (!std::binary_search(near_before_.begin(), near_before_.end(), i)) before_[static_cast<std::size_t>(i)] = {};
  }
  void look_at_near(const Numbers& y) noexcept {
    const AnyFrame at_y = frame(y);
    list_near(at_y);
    for (const int i : looked_) {
      const auto n = static_cast<std::size_t>(i);
      look(pairs_[n], at(at_y, pairs_[n]), found_[n]);
    }
  }
  void list_all(std::vector<int>& list) noexcept {
    for (std::size_t i = 0; i < pairs_.size(); ++i) list.push_back(static_cast<int>(i));
  }
  /// What was looked at last is of the step's start from now on.
  void keep_look() noexcept {
    std::swap(before_, found_);
    std::swap(near_before_, near_now_);
  }

  /// Rates of y. `kLook`: also what the pairs are at, in found_.
  template <bool kLook>
  void evaluate(const Numbers& y, const Vector& f, Numbers& rate, Vector& environment) noexcept {
    const AnyFrame at_y = frame(y);
    Where force_sum = Where::Zero(), torque_sum = Where::Zero();
    double friction = 0.0;
    for (const Springs& s : springs_) {
      if constexpr (N == 6) {
        const Eigen::Vector3d arms = at_y.R * s.arms, pull = s.stiffness * (s.anchor - at_y.x);
        force_sum += s.count * (pull - s.damping * at_y.v) - s.stiffness * arms - s.damping * at_y.w.cross(arms);
        torque_sum += arms.cross(pull - s.damping * at_y.v) - s.damping * (at_y.R * (s.moments * at_y.w_body));
      } else {
        force_sum += s.stiffness * (s.anchor.template head<D>() - at_y.x) - s.damping * at_y.v;
      }
    }
    for (const Active& contact : active_) {
      const Pair& pair = pairs_[static_cast<std::size_t>(contact.pair)];
      const At a = at(at_y, pair);
      double coulomb = 0.0;
      const Where fc = force(pair.surface->material, signed_distance<D>(pair.surface->shape, a.p, contact.mode.feature),
                             a.v, contact.mode.slides, coulomb);
      force_sum += fc;
      if constexpr (N == 6) torque_sum += a.arm.cross(fc);
      friction += coulomb;
    }
    if constexpr (kLook) {
      end_friction_ = friction;
      if (!near_.empty()) [[unlikely]]
        look_at_near(y);
      else
        for (std::size_t i = 0; i < pairs_.size(); ++i) look(pairs_[i], at(at_y, pairs_[i]), found_[i]);
    }
    if constexpr (N == 6) {
      environment = {force_sum, torque_sum};
      const Eigen::Vector3d p_rate = f.linear + force_sum - damping_ * at_y.v,
                            l_rate = f.angular + torque_sum - rotational_damping_ * at_y.w;
      const double wx = 0.5 * at_y.w.x(), wy = 0.5 * at_y.w.y(), wz = 0.5 * at_y.w.z();
      const double qx = y[3], qy = y[4], qz = y[5], qw = y[6];
      rate << at_y.v, wx * qw + wy * qz - wz * qy, wy * qw + wz * qx - wx * qz, wz * qw + wx * qy - wy * qx,
          -(wx * qx + wy * qy + wz * qz), p_rate, l_rate, 0.0;
    } else {
      environment = force_sum;
      rate.template head<N>() = at_y.v;
      rate.template tail<N>() = (f + force_sum - damping_ * at_y.v) / mass_;
    }
  }

  /// One step of h from the state, into next_; stages 0 to 5 filled. Returns its error over what is allowed.
  double make_step(double h) noexcept {
    stage_[0] = s_.rate;
    const auto at_stage = [&](auto... weights) {
      Numbers y = s_.y;
      std::size_t j = 0;
      ((y += (h * weights) * stage_[j++]), ...);
      return y;
    };
    Vector unused;
    evaluate<false>(at_stage(1.0 / 5), s_.held, stage_[1], unused);
    evaluate<false>(at_stage(3.0 / 40, 9.0 / 40), s_.held, stage_[2], unused);
    evaluate<false>(at_stage(44.0 / 45, -56.0 / 15, 32.0 / 9), s_.held, stage_[3], unused);
    evaluate<false>(at_stage(19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729), s_.held, stage_[4],
                    unused);
    evaluate<false>(at_stage(9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656), s_.held,
                    stage_[5], unused);
    next_ = at_stage(35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84);
    if constexpr (N == 6) {
      const double scale =
          1.5 - 0.5 * (next_[3] * next_[3] + next_[4] * next_[4] + next_[5] * next_[5] + next_[6] * next_[6]);
      next_.template segment<4>(3) *= scale;
    }
    evaluate<true>(next_, s_.held, stage_[6], end_environment_);
    constexpr double kError[] = {71.0 / 57600,      0.0,        -71.0 / 16695, 71.0 / 1920,
                                 -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    Numbers off = Numbers::Zero();
    for (std::size_t j = 0; j < 7; ++j) off += (h * kError[j]) * stage_[j];
    const auto largest = [&](int from, int count) { return off.segment(from, count).cwiseAbs().maxCoeff(); };
    double error = 0.0;
    if constexpr (N == 6)
      error = std::max({largest(0, 3), 2.0 * kArm_m * largest(3, 4), kVelocityTime_s / mass_ * largest(7, 3),
                        kVelocityTime_s * kArm_m * inverse_inertia_.maxCoeff() * largest(10, 3)});
    else
      error = std::max(largest(0, N), kVelocityTime_s * largest(N, N));
    return std::isfinite(next_[0]) ? error / tolerance_ : std::numeric_limits<double>::infinity();
  }

  /// Which pairs leave their mode within the step just made, whose end is in found_.
  [[nodiscard]] bool find_changes(double h) noexcept {
    changed_.clear();
    for (const int pair : looked_) {
      const auto i = static_cast<std::size_t>(pair);
      const Found &a = before_[i], &b = found_[i];
      const bool none = s_.modes[i].feature == kNone;
      if (b.mode != s_.modes[i] && !(none && b.mode.feature == kNone))
        changed_.push_back(pair);
      else if (none && b.mode.feature == kNone && a.rate < 0.0 && b.rate > 0.0 && a.distance > 0.0 &&
               a.distance + h * a.rate < 0.0 && dips(a, b, h))
        changed_.push_back(pair);
    }
    return !changed_.empty();
  }
  /// Does the cubic through both ends turn around inside?
  [[nodiscard]] static bool dips(const Found& a, const Found& b, double h) noexcept {
    // With constant acceleration the least distance is where the rate is 0.
    const double t = h * a.rate / (a.rate - b.rate);
    return a.distance + 0.5 * a.rate * t < 0.0;
  }

  /// The continuous extension of the step of h that make_step() has made.
  [[nodiscard]] Numbers within(double share, double h) const noexcept {
    constexpr double kExtension[] = {-12715105075.0 / 11282082432.0,  0.0,
                                     87487479700.0 / 32700410799.0,   -10690763975.0 / 1880347072.0,
                                     701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
                                     69997945.0 / 29380423.0};
    Numbers bend = Numbers::Zero();
    for (std::size_t j = 0; j < 7; ++j) bend += kExtension[j] * stage_[j];
    const double rest = 1.0 - share;
    const Numbers by = next_ - s_.y, first = h * stage_[0] - by, last = by - h * stage_[6] - first;
    return s_.y + share * (by + rest * (first + share * (last + (rest * h) * bend)));
  }
  /// Positive while all changed pairs are in their modes.
  [[nodiscard]] double kept(double share, double h) noexcept {
    const AnyFrame at_y = frame(within(share, h));
    double least = std::numeric_limits<double>::infinity();
    for (const int i : changed_) {
      const auto n = static_cast<std::size_t>(i);
      Found f;
      look(pairs_[n], at(at_y, pairs_[n]), f);
      const Mode mode = s_.modes[n];
      double g = 0.0;
      if (mode.feature == kNone)
        g = -f.pressed;
      else if (!(f.pressed > 0.0))
        g = f.pressed;
      else if (f.mode.feature != mode.feature)
        g = -1.0;
      else if (D > 1 && pairs_[n].surface->material.friction > 0.0 && found_[n].mode.feature == mode.feature)
        g = mode.slides ? f.slip : -f.slip;
      else
        g = found_[n].mode.feature == kNone ? f.pressed : 1.0;
      least = std::min(least, g);
    }
    return least;
  }
  /// Goes to the first change within the step of h just made, and into the modes beyond it. Returns the way in time.
  double step_to_change(double h) noexcept {
    double lo = 0.0, hi = 1.0, at_hi = kept(1.0, h);
    if (!(at_hi < 0.0)) {  // a dip: from within
      for (const int i : changed_) {
        const Found &a = before_[static_cast<std::size_t>(i)], &b = found_[static_cast<std::size_t>(i)];
        if (a.rate < b.rate) hi = std::min(hi, a.rate / (a.rate - b.rate));
      }
      at_hi = kept(hi, h);
    }
    double at_lo = kept(0.0, h);
    double share = hi;
    if (at_hi < 0.0 && at_lo > 0.0) {
      for (int i = 0, side = 0; i < 60 && hi - lo > 1e-9; ++i) {
        const double secant = hi - at_hi * (hi - lo) / (at_hi - at_lo);
        const double t = i < 20 ? std::clamp(secant, lo + 0.2e-9, hi - 0.2e-9) : 0.5 * (lo + hi);
        const double g = kept(t, h);
        if (g > 0.0) {
          lo = t, at_lo = g;
          if (side < 0) at_hi *= 0.5;
          side = -1;
        } else {
          hi = t, at_hi = g;
          if (side > 0) at_lo *= 0.5;
          side = 1;
        }
      }
      share = hi;
    } else if (at_hi < 0.0) {
      share = 0.0;  // at once
    }
    // The modes beyond the change, of the pairs that change there.
    const AnyFrame beyond = frame(within(share, h));
    flips_.clear();
    for (const int i : changed_) {
      const auto n = static_cast<std::size_t>(i);
      Found f;
      look(pairs_[n], at(beyond, pairs_[n]), f);
      if (f.mode != s_.modes[n]) flips_.push_back({i, f.mode});
    }
    const double part = share * h;
    if (part > 0.0) {
      make_step(part);
      s_.y = next_;
    }
    for (const Active& flip : flips_) set_mode(flip);
    look_here();
    return share < 1.0 ? part : h;
  }

  /// Everything that belongs to s_.y, in its modes.
  void look_here() noexcept {
    evaluate<true>(s_.y, s_.held, s_.rate, s_.environment);
    s_.friction = end_friction_;
    keep_look();
  }
  void look_for_friction() noexcept {
    rough_ = false;
    for (const Surface& s : environment_->world().surfaces) rough_ = rough_ || s.material.friction > 0.0;
  }
  void place(const BodyState<N>& at) noexcept {
    s_.y = numbers(at);
    for (const Active& a : active_) s_.modes[static_cast<std::size_t>(a.pair)] = {};
    active_.clear();
    const AnyFrame at_y = frame(s_.y);
    list_near(at_y);
    for (const int i : looked_) {
      const Pair& pair = pairs_[static_cast<std::size_t>(i)];
      Found f;
      look(pair, this->at(at_y, pair), f);
      if (f.mode.feature != kNone) set_mode({i, f.mode});
    }
    look_here();
  }
  /// In s_.modes and active_, which is ascending.
  void set_mode(const Active& to) noexcept {
    s_.modes[static_cast<std::size_t>(to.pair)] = to.mode;
    auto found = std::lower_bound(active_.begin(), active_.end(), to.pair,
                                  [](const Active& a, int pair) { return a.pair < pair; });
    const bool is_there = found != active_.end() && found->pair == to.pair;
    if (to.mode.feature == kNone) {
      if (is_there) active_.erase(found);
    } else if (is_there) {
      found->mode = to.mode;
    } else {
      active_.insert(found, to);
    }
  }
  void go_stiff(double left) noexcept { place(stiff_.advance_stiff(body(), Force<N>{s_.held}, left)); }

  [[nodiscard]] Numbers numbers(const BodyState<N>& at) const noexcept {
    Numbers y = Numbers::Zero();
    y.template head<D>() = at.x.translation();
    if constexpr (N == 6) {
      const Eigen::Quaterniond q = at.x.attitude().normalized();
      const Eigen::Matrix3d R = q.toRotationMatrix();
      const Eigen::Matrix<double, 6, 1> v = at.v.vec();
      y.template segment<4>(3) = q.coeffs();
      y.template segment<3>(7) = mass_ * v.template head<3>();
      y.template segment<3>(10) = R * inertia_.cwiseProduct(R.transpose() * v.template tail<3>());
    } else {
      y.template tail<N>() = at.v.vec();
    }
    return y;
  }
  [[nodiscard]] BodyState<N> body_at(const Numbers& y) const noexcept {
    const AnyFrame f = frame(y);
    if constexpr (N == 6)
      return {Position<6>{f.x, Eigen::Quaterniond{y[6], y[3], y[4], y[5]}}, Velocity<6>{SpatialVector{f.v, f.w}}};
    else
      return {Position<N>{f.x}, Velocity<N>{f.v}};
  }
  void add_force(Numbers& rate, const Vector& f) const noexcept {
    if constexpr (N == 6) {
      rate.template segment<3>(7) += f.linear;
      rate.template segment<3>(10) += f.angular;
    } else {
      rate.template tail<N>() += f / mass_;
    }
  }

  std::shared_ptr<const Environment<N>> environment_;
  RungeKuttaPlant<N> stiff_;
  double dt_, tolerance_, mass_, damping_, rotational_damping_, mobility_ = 0.0;
  bool rough_ = false;
  Eigen::Vector3d inertia_ = Eigen::Vector3d::Ones(), inverse_inertia_ = Eigen::Vector3d::Ones();
  std::vector<Pair> pairs_;
  std::vector<Springs> springs_;
  State s_;
  // Of a step; no state.
  std::array<Numbers, 7> stage_;
  Numbers next_;
  Vector end_environment_ = Vector::Zero();
  double end_friction_ = 0.0;
  std::vector<Active> active_, flips_;
  std::vector<Found> found_, before_;  ///< at the step's end and at its start
  std::vector<int> changed_;
  BroadPhase<D> near_;                       ///< of surfaces that grew by kFast_m_per_s dt; empty: the surfaces are few
  std::vector<int> near_now_, near_before_;  ///< pairs at the step's end and at its start
  std::vector<int> looked_;                  ///< pairs in found_, ascending
  double reach_ = 0.0;                       ///< of the farthest point [m]
};

}  // namespace twoport::sim
