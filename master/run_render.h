#pragma once

#include "master/render_node.h"
#include "master/run.h"

namespace twoport {

/// A virtual environment on the device.
template <int N>
struct RenderMaster : Master<N> {
  RenderMaster(const Scene& s, MountedDevice<N>& device, const std::string& choice, LivePage* live_page)
      : Master<N>{s, device, choice, live_page},
        mounted{device},
        environment{s.environment, s.tool},
        node{s.control, environment},
        initial{s.control.initial_energy + environment.potential(device.truth() ? device.truth()->x : this->first.x)} {}

  [[nodiscard]] Metrics<N> metrics() const {
    return Master<N>::metrics(initial, {.link = false, .robot = false, .robot_energy = false});
  }
  Row<N> row(std::int64_t, double t_s, const DeviceSample<N>& sample,
             const typename RenderNode<N>::Output& out) const noexcept {
    Row<N> row = this->row_of(t_s, sample, out, node.observed() - initial);
    row.touching = environment.holds() || out.wanted.squared_norm() > 0.0;
    return row;
  }
  static void fill(Summary&, bool) {}
  void end_tick(Duration now, Duration late, const DeviceSample<N>& sample,
                const typename RenderNode<N>::Output& out) noexcept {
    if (!this->page) [[likely]]
      return;
    this->page->note_handle(mounted, sample.x);
    this->page->show(now, late, sample, out, node.observed() - initial, static_cast<PeerState<N>*>(nullptr), {},
                     node.limit_counts(), 0);
  }

  [[nodiscard]] bool lets_go() const noexcept { return mounted.lets_go(); }

  MountedDevice<N>& mounted;
  Environment<N> environment;
  RenderNode<N> node;
  Energy initial;
  NoLink link;
  std::unique_ptr<NoGripper> gripper;  ///< null: a scene with a gripper has a link
};

template <int N>
int run_render(const Scene& scene, MountedDevice<N>& device, const LiveArguments& arguments, LivePage* page,
               spdlog::logger& log) {
  RenderMaster<N> side{scene, device, arguments.hardware, page};
  return run_live(side, scene, arguments, log);
}

}  // namespace twoport
