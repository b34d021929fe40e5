#pragma once

#include <optional>

#include "common/arm/arm_model.h"
#include "common/method/transparency/internal_model/master.h"

namespace twoport {

/// Master half of internal-model control of joints: the arm's surface in the metric (InternalModelMaster<kJointPort>), which moves no finger, and
/// beside it, where the follower's last joint is two fingers, what they hold as a surface across that axis (InternalModelMaster<1>).
///
///     f_i = f_arm,i;   f_last = f_fingers       likewise damper, o, f_m
///     stored = stored of the arm + stored of the fingers
template <int N>
class JointModelMaster final : public Copyable<JointModelMaster<N>, MasterTransparency<N>> {
 public:
  explicit JointModelMaster(const ControlOptions& o) : arm_{o} {
    if (o.follower == nullptr || !o.follower->has_fingers()) return;
    axis_ = static_cast<int>(o.follower->size()) - 1;
    fingers_.emplace(o);
  }

  void start(const DeviceSample<N>& device) noexcept override {
    arm_.start(device);
    if (fingers_) fingers_->start(of_fingers(device));
  }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    Wish<N> out = arm_.wish(in);
    if (!fingers_) return out;
    slave_.newest.f = of_fingers(in.slave.newest.f);
    slave_.newest.echo_ns = in.slave.newest.echo_ns;
    slave_.received_at = in.slave.received_at;
    slave_.is_new = in.slave.is_new;
    if (arm_.has_payload()) write(arm_.said_by_slave().of_fingers(axis_), slave_.words);
    const Wish<1> fingers = with_fingers(in, [&](const MasterInput<1>& own) { return fingers_->wish(own); });
    if (out.idle) return out;
    set(out.f, fingers.f);
    set(out.damper, fingers.damper);
    *out.stored += *fingers.stored;
    return out;
  }
  void shown(const Force<N>& f, double share, const MasterInput<N>& in) noexcept override {
    arm_.shown(f, share, in);
    said_by_master_ = arm_.says();
    if (!fingers_) return;
    with_fingers(in, [&](const MasterInput<1>& own) { fingers_->shown(of_fingers(f), share, own); });
    set(said_by_master_.offset.value, fingers_->says().offset.value);
    set(said_by_master_.felt.value, fingers_->says().felt.value);
  }
  [[nodiscard]] bool has_payload() const noexcept override { return arm_.has_payload(); }
  void write_payload(Words& words) const noexcept override { write(said_by_master_, words); }

 private:
  template <class Kind>
  [[nodiscard]] Coords<Kind, 1> of_fingers(const Coords<Kind, N>& all) const noexcept {
    return Coords<Kind, 1>{Point<1>{all.vec()[axis_]}};
  }
  [[nodiscard]] DeviceSample<1> of_fingers(const DeviceSample<N>& all) const noexcept {
    DeviceSample<1> out;
    out.x = Position<1>{Point<1>{all.x.translation()[axis_]}};
    out.v = of_fingers(all.v);
    out.applied = of_fingers(all.applied);
    return out;
  }
  /// The same tick of the fingers alone.
  template <class Call>
  auto with_fingers(const MasterInput<N>& in, Call call) const noexcept {
    const DeviceSample<1> device = of_fingers(in.device);
    const Interval<1> interval{of_fingers(in.interval.moved), of_fingers(in.interval.v0), of_fingers(in.interval.v1)};
    return call(MasterInput<1>{in.dt, in.ended, device, interval, in.first, slave_, in.slave_energy_in,
                               in.slave_energy_net, in.account, in.active, in.paused, nullptr, in.ramp, nullptr});
  }
  template <class Kind>
  void set(Coords<Kind, N>& all, const Coords<Kind, 1>& fingers) const noexcept {
    auto v = all.vec();
    v[axis_] = fingers.vec()[0];
    all = Coords<Kind, N>{v};
  }

  InternalModelMaster<N> arm_;
  std::optional<InternalModelMaster<1>> fingers_;
  int axis_ = 0;        ///< of the fingers
  PeerState<1> slave_;  ///< what it says of them
  MasterSays<N> said_by_master_;
};

}  // namespace twoport
