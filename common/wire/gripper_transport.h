#pragma once

#include "common/base/time.h"
#include "common/link/report.h"
#include "common/wire/link_transport.h"

namespace twoport {

/// The transport for the gripper's Mailbox: its reports travel in the packets of the main coupling's LinkTransport, with the same
/// numbers and stamps. In every tick collect and post the main coupling's mail first.
template <int N>
class GripperTransport {
 public:
  /// `link` must outlive this.
  explicit GripperTransport(LinkTransport<N>& link) : link_{&link} { link.carry_gripper(); }

  template <class F>
  void poll(Duration, F&& f) noexcept {
    link_->poll_gripper(f);
  }
  void send(const Report<1>& report, Duration now) noexcept { link_->send_gripper(report, now); }
  /// The session is the main coupling's; call when that begins.
  [[nodiscard]] static bool take_new_session() noexcept { return true; }

 private:
  LinkTransport<N>* link_;
};

}  // namespace twoport
