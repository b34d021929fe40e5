#pragma once

#include <cstdint>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/link/report.h"

namespace twoport {

/// All that a node takes in and puts out in a tick, but for the reports that it receives; proto/recording.proto.
template <int N>
struct TickRecord {
  std::uint64_t number = 0;
  Duration now{0};
  Seconds dt{}, ended{};
  double t_s = -1.0;  ///< since the first contact with the other side; -1 before
  std::uint32_t epoch_before = 0;
  bool peer_restarted = false;
  Duration session_since{0};  ///< where the peer has restarted: Handshake::session_since()
  std::uint32_t epoch = 0;

  // The reading.
  Position<N> x;
  Velocity<N> v;
  Force<N> f;  ///< master: applied; slave: the force sensor
  bool ideal = false;
  HardwareStatus status = HardwareStatus::ok;
  std::uint32_t buttons = 0;
  bool held = true;
  typename Velocity<N>::Vector ratio = Velocity<N>::Vector::Ones();

  // The result.
  Force<N> command, wanted;
  Position<N> x_d;
  Velocity<N> v_d;
  double dissipated_j = 0.0, undissipated_j = 0.0;
  Mode mode = Mode::idle;
  bool sends = false;
  Report<N> sent;

  void take(const DeviceSample<N>& s) noexcept {
    x = s.x, v = s.v, f = s.applied, status = s.status, buttons = s.buttons, held = s.held, ratio = s.ratio;
  }
  void take(const RobotSample<N>& s) noexcept {
    x = s.x, v = s.v, f = s.f_environment, status = s.status, ideal = s.ideal;
  }
  /// Of a node: MasterNode, RenderNode or SlaveNode.
  template <class Output>
  void take_output(const Output& out) noexcept {
    if constexpr (requires { out.command.x_d; }) {
      command = out.command.f, x_d = out.command.x_d, v_d = out.command.v_d;
    } else {
      command = out.command, wanted = out.wanted, undissipated_j = out.undissipated.si();
    }
    dissipated_j = out.dissipated.si();
    if constexpr (requires { out.mode; }) mode = out.mode;
  }
};

/// Sees the reports that a mailbox receives and sends.
template <int N>
struct ReportTap {
  virtual ~ReportTap() = default;
  virtual void received(const Report<N>& report) noexcept = 0;
  virtual void sent(const Report<N>& report) noexcept = 0;
};

/// A transport of a Mailbox whose reports a tap sees, as the mailbox does.
template <int N, class Transport>
class TappedTransport : public Transport {
 public:
  using Transport::Transport;
  /// Null: none.
  void tap(ReportTap<N>* tap) noexcept { tap_ = tap; }

  template <class Use>
  void poll(Duration now, Use use) noexcept {
    Transport::poll(now, [&](const Report<N>& report) {
      if (tap_ != nullptr) [[unlikely]]
        tap_->received(report);
      use(report);
    });
  }
  template <class R>
  void send(const R& report, Duration now) noexcept {
    if (tap_ != nullptr) [[unlikely]]
      tap_->sent(report);
    Transport::send(report, now);
  }

 private:
  ReportTap<N>* tap_ = nullptr;
};

}  // namespace twoport
