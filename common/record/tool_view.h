#pragma once

#include "common/coupling/joint_tool.h"
#include "common/record/row.h"
#include "common/scene/scene.h"

namespace twoport {

/// A row as figures of forces and positions see it: of handle and tool. For ports of joints those are the tools of the two arms
/// (JointTool); energies are the ports'.
template <int N>
class ToolView {
 public:
  static constexpr int kSize = N;
  ToolView() = default;
  explicit ToolView(const Scene&) {}
  const Row<N>& operator()(const Row<N>& row) const noexcept { return row; }
};

template <>
class ToolView<kJointPort> {
 public:
  static constexpr int kSize = 3;
  explicit ToolView(const Scene& scene)
      : leader_{scene.control.leader, scene.control.joint_scale},
        follower_{scene.control.follower, scene.control.joint_scale} {}

  Row<3> operator()(const Row<kJointPort>& r) const noexcept {
    const JointTool::At leader = leader_.at(r.master_x), follower = follower_.at(r.slave_x);
    return {.t_s = r.t_s,
            .master_x = leader.position(),
            .master_v = Velocity<3>{leader.moved(r.master_v.vec())},
            .master_f = leader.force(r.master_f),
            .master_f_wanted = leader.force(r.master_f_wanted),
            .slave_x = follower.position(),
            .slave_v = Velocity<3>{follower.moved(r.slave_v.vec())},
            .slave_f = follower.force(r.slave_f),
            .env_f = follower.force(r.env_f),
            .position_error = Displacement<3>{follower.moved(r.position_error.vec())},
            .master_energy_j = r.master_energy_j,
            .slave_energy_j = r.slave_energy_j,
            .observed_energy_j = r.observed_energy_j,
            .undissipated_j = r.undissipated_j,
            .dissipated_j = r.dissipated_j,
            .mode = r.mode,
            .figures = r.figures,
            .reference = leader.force(r.reference),
            .coupling_energy_j = r.coupling_energy_j,
            .ahead = Displacement<3>{follower.moved(r.ahead.vec())},
            .touching = r.touching,
            .coupled = r.coupled,
            .following = r.following};
  }

 private:
  JointTool leader_, follower_;
};

}  // namespace twoport
