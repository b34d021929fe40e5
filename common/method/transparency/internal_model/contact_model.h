#pragma once

#include <algorithm>
#include <type_traits>

#include "common/method/transparency/contact_spring/master.h"
#include "common/method/transparency/internal_model/joint_model.h"
#include "common/method/transparency/internal_model/master.h"

namespace twoport {

/// Master half of internal-model control in six degrees of freedom: of the plane at one point (InternalModelMaster) and the spring
/// in all axes (ContactSpringMaster) the one that predicts the measured wrench better. Both run in every tick; wish, offset and
/// felt force are blended, so a choice makes no jump.
///
///     e_p, e_s = LP_0.3s of |what the plane, the spring has not predicted of the newest wrench|²     in contact only
///                a torque counts by sqrt(K_c/K_r)
///     spring   where e_p > e_s/2 + (0.1 N)², or where the slave feels a torque and no force
///     plane    where e_p < e_s/20 · min(1, 0.25 s/R) and e_s > (0.1 N)²; after 5 s without contact; at the start
///     w        0 plane, 1 spring; changes by 1 in 0.1 s;    f_d = (1 - w) f_p + w f_s,  likewise damper, stored energy, o, f_m
///
/// Between the two and at rest, where nothing is to be predicted, the choice stays.
template <int N>
class ContactModelMaster final : public Copyable<ContactModelMaster<N>, MasterTransparency<N>> {
 public:
  explicit ContactModelMaster(const ControlOptions& o)
      : plane_{o},
        spring_{o},
        stiffness_ratio_{o.coupling.rotational_stiffness_n_m_per_rad > 0.0
                             ? o.motion_scale * o.motion_scale * o.coupling.stiffness_n_per_m /
                                   o.coupling.rotational_stiffness_n_m_per_rad
                             : 0.0} {}

  void start(const DeviceSample<N>& device) noexcept override {
    plane_.start(device);
    spring_.start(device);
    begin_with_plane();
    share_ = 0.0;
  }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    const Wish<N> plane = plane_.wish(in), spring = spring_.wish(in);
    if (plane.idle) return {};
    choose(in.dt);
    Wish<N> out{.idle = false,
                .f = blend(plane.f, spring.f),
                .damper = blend(plane.damper, spring.damper),
                .damped = true,
                .stored = (1.0 - share_) * *plane.stored + share_ * *spring.stored};
    out.figures[layer_figure("contact_spring_share")] = share_;
    return out;
  }
  void shown(const Force<N>& f, double share, const MasterInput<N>& in) noexcept override {
    plane_.shown(f, share, in);
    spring_.shown(f, share, in);
    said_by_master_.offset.value = blend(plane_.says().offset.value, spring_.says().offset.value);
    said_by_master_.felt.value = blend(plane_.says().felt.value, spring_.says().felt.value);
  }
  [[nodiscard]] bool has_payload() const noexcept override { return plane_.has_payload(); }
  void write_payload(Words& words) const noexcept override { write(said_by_master_, words); }

 private:
  static constexpr double kError_s = 0.3, kError_n = 0.1, kToSpring = 0.5, kToPlane = 0.05, kChange_s = 0.1,
                          kFree_s = 5.0, kLong_s = 0.25;

  template <class Value>
  [[nodiscard]] Value blend(const Value& plane, const Value& spring) const noexcept {
    return Value{(1.0 - share_) * plane.vec() + share_ * spring.vec()};
  }
  void begin_with_plane() noexcept {
    springs_ = false;
    plane_error_ = spring_error_ = free_s_ = 0.0;
  }
  void choose(Seconds dt) noexcept {
    if (plane_.touches()) {
      const auto squared = [&](const Force<N>& f) {
        const double size = wrench_norm(f, stiffness_ratio_);
        return size * size;
      };
      low_pass(plane_error_, squared(plane_.unexplained()), dt, kError_s);
      low_pass(spring_error_, squared(spring_.unexplained()), dt, kError_s);
      const double to_plane = kToPlane * std::min(1.0, kLong_s / plane_.round_trip().si());
      if (!plane_.touches_surface() || plane_error_ > kToSpring * spring_error_ + kError_n * kError_n) springs_ = true;
      if (plane_.touches_surface() && plane_error_ < to_plane * spring_error_ && spring_error_ > kError_n * kError_n)
        springs_ = false;
      free_s_ = 0.0;
    } else if ((free_s_ += dt.si()) > kFree_s) {
      begin_with_plane();
    }
    const double change = dt.si() / kChange_s;
    share_ = std::clamp(share_ + (springs_ ? change : -change), 0.0, 1.0);
  }

  InternalModelMaster<N> plane_;
  ContactSpringMaster<N> spring_;
  double stiffness_ratio_;                         ///< K_c/K_r in the master's units
  double plane_error_ = 0.0, spring_error_ = 0.0;  ///< e_p, e_s [N²]
  double share_ = 0.0, free_s_ = 0.0;              ///< w; time without contact
  bool springs_ = false;
  MasterSays<N> said_by_master_;
};

/// One, three degrees of freedom: the plane. Lanes (lab/lanes/internal_model.h) have the same.
template <int N>
using InternalModel =
    std::conditional_t<N == 6, ContactModelMaster<N>,
                       std::conditional_t<N == kJointPort, JointModelMaster<N>, InternalModelMaster<N>>>;

}  // namespace twoport
