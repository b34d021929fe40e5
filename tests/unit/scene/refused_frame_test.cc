#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Frame, RefusedScene,
    ::testing::Values(
        Refusal{"duration_s: 1", {}, "dof is missing; it must be 1, 3 or 6"},
        Refusal{"dof: 3", {}, "duration_s is missing; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall, {"dof=2"}, "dof is 2; it must be 1, 3 or 6"},
        Refusal{kStiffWall, {"duration_s=0"}, "duration_s is 0; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall, {"duration_s=1.5e6"}, "duration_s is 1500000; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall,
                {"duration_s=1e6", "rate_hz=1e5"},
                "duration_s is 1000000; it must last at most 4294967295 ticks, and makes 1e+11"},
        Refusal{kStiffWall, {"rate_hz=0"}, "rate_hz is 0; it must be > 0 and at most 100000"},
        Refusal{kStiffWall, {"rate_hz=2e5"}, "rate_hz is 200000; it must be > 0 and at most 100000"},
        Refusal{kStiffWall, {"master_rate_hz=-1"}, "master_rate_hz is -1; it must be > 0 and at most 100000"},
        Refusal{kStiffWall, {"slave_rate_hz=0"}, "slave_rate_hz is 0; it must be > 0 and at most 100000"},
        Refusal{kStiffWall, {"slave_rate_hz=nan"}, "slave_rate_hz is nan; it must be a finite number"},
        Refusal{kStiffWall, {"duration_s=inf"}, "duration_s is inf; it must be a finite number"},
        Refusal{kStiffWall, {"tool={}"}, "tool is given, but applies to dof 6 only; dof is 3"},
        Refusal{kTurning,
                {"tool.contact_point[0].position_m=[1]"},
                "tool.contact_point[0].position_m is [1]; it must hold 3 numbers"},
        Refusal{kTurning,
                {"tool.contact_point[1].position_m=[0,-300,400]"},
                "tool.contact_point[1]: a contact point is 500 m from the wrist; it must be at most 100 m"},
        Refusal{kTurning,
                {"tool={part{peg{radius_m:0.01 end_m:[0,0,1e5] axis:[0,0,1] length_m:0.1} spacing_m:0.01}}"},
                "tool.part[0]: a contact point is 1e+05 m from the wrist; it must be at most 100 m"},
        Refusal{kTurning,
                {"robot.velocity_m_per_s=[0,0,0,3e4,0,-4e4]"},
                "robot.velocity_m_per_s turns by 50 rad in a tick; it must be <= 10"}),
    name_of);

}  // namespace twoport::test
