#pragma once

#include <limits>
#include <memory>

#include "common/hardware/transparency_host.h"
#include "common/method/layers.h"

namespace twoport {

/// A force that a shared library, or a function of the caller, computes. Where it fails the wish is not finite until the run ends, so
/// the node releases the port. A copy shares what computes.
template <int N>
class PluginMaster final : public Copyable<PluginMaster<N>, MasterTransparency<N>> {
 public:
  explicit PluginMaster(const ControlOptions& o)
      : host_{o.plugin.host ? o.plugin.host
                            : start_transparency_process(o.plugin.file, o.plugin.arguments, N, o.known.master_tick,
                                                         o.plugin.waits)} {}
  void start(const DeviceSample<N>&) noexcept override {}
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    in_.dt_s = in.dt.si();
    in_.coupled = in.active ? 1 : 0;
    put(in.device.x, in_.position_m, in_.attitude);
    put(in.device.v.vec(), in_.velocity);
    put(in.device.applied.vec(), in_.applied);
    in_.has_report = in.slave.has_report ? 1 : 0;
    in_.report_is_new = in.slave.is_new ? 1 : 0;
    put(in.slave.newest.x, in_.slave_position_m, in_.slave_attitude);
    put(in.slave.newest.v.vec(), in_.slave_velocity);
    put(in.slave.newest.f.vec(), in_.slave_force);
    failed_ = failed_ || !host_->step(in_, out_);
    Wish<N> out{.idle = !in.active, .f = force(out_.force), .damper = force(out_.damper), .damped = true};
    if (failed_) [[unlikely]]
      out.f = Force<N>{Force<N>::Vector::Constant(std::numeric_limits<double>::quiet_NaN())};
    out.f = in.ramp * out.f;
    out.damper = in.ramp * out.damper;
    if (out_.stored_j >= 0.0) out.stored = Energy{out_.stored_j};
    if (out.idle) return {.f = 0.0 * out.total()};  // what is not finite stays so
    return out;
  }
  void failed(const MasterInput<N>&) noexcept override { failed_ = true; }

 private:
  static void put(const typename Force<N>::Vector& from, double* to) noexcept {
    for (int i = 0; i < N; ++i) to[i] = from[i];
  }
  static void put(const Position<N>& from, double* translation, double* attitude) noexcept {
    const auto p = from.translation();
    for (int i = 0; i < kAxes<N>; ++i) translation[i] = p[i];
    attitude[0] = 1.0;
    if constexpr (N == 6) {
      const Eigen::Quaterniond& q = from.attitude();
      attitude[0] = q.w(), attitude[1] = q.x(), attitude[2] = q.y(), attitude[3] = q.z();
    }
  }
  static Force<N> force(const double* from) noexcept {
    typename Force<N>::Vector f;
    for (int i = 0; i < N; ++i) f[i] = from[i];
    return Force<N>{f};
  }

  std::shared_ptr<TransparencyHost> host_;
  twoport_transparency_reading in_{};
  twoport_transparency_wish out_{.force = {}, .damper = {}, .stored_j = -1.0};
  bool failed_ = false;
};

}  // namespace twoport
