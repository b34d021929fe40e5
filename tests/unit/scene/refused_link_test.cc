#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Link, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"to_slave.delay_ms=-1"}, "to_slave.delay_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall, {"to_slave.jitter_ms=-1"}, "to_slave.jitter_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall, {"to_master.loss=1.5"}, "to_master.loss is 1.5; it must be between 0 and 1"},
        Refusal{kStiffWall, {"to_master.duplicate=-0.1"}, "to_master.duplicate is -0.1; it must be between 0 and 1"},
        Refusal{kStiffWall, {"to_master.reorder=2"}, "to_master.reorder is 2; it must be between 0 and 1"},
        Refusal{
            kStiffWall, {"to_master.reorder_ms=-2"}, "to_master.reorder_ms is -2; it must be between 0 and 1000000"},
        Refusal{kStiffWall, {"to_slave.burst={r: 1}"}, "to_slave.burst.p is missing; it must be between 0 and 1"},
        Refusal{kStiffWall, {"to_slave.burst={p: 1}"}, "to_slave.burst.r is missing; it must be between 0 and 1"},
        Refusal{kStiffWall, {"to_slave.burst={p: 2 r: 1}"}, "to_slave.burst.p is 2; it must be between 0 and 1"},
        Refusal{kStiffWall, {"to_slave.burst={p: 1 r: 2}"}, "to_slave.burst.r is 2; it must be between 0 and 1"},
        Refusal{kStiffWall,
                {"to_slave.burst={p: 1 r: 1 loss_good: 2}"},
                "to_slave.burst.loss_good is 2; it must be between 0 and 1"},
        Refusal{kStiffWall,
                {"to_slave.burst={p: 1 r: 1 loss_bad: 2}"},
                "to_slave.burst.loss_bad is 2; it must be between 0 and 1"},
        Refusal{kStiffWall,
                {"to_slave.blackout={start_s: -1 duration_s: 1}"},
                "to_slave.blackout[0].start_s is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"to_slave.blackout={start_s: 1 duration_s: 0}"},
                "to_slave.blackout[0].duration_s is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"to_slave.blackout[0].start_s=1"},
                "to_slave.blackout[0].duration_s is missing; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"to_slave.blackout[0].duration_s=1"},
                "to_slave.blackout[0].start_s is missing; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"to_slave.delay_step[0].delay_ms=1"},
                "to_slave.delay_step[0].at_s is missing; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"to_slave.delay_step={at_s: 1}"},
                "to_slave.delay_step[0].delay_ms is missing; it must be between 0 and 1000000"},
        Refusal{kStiffWall,
                {"to_slave.delay_step=[{at_s: 2 delay_ms: 1}, {at_s: 2 delay_ms: 2}]"},
                "to_slave.delay_step[1].at_s is 2; it must be later than that of the step before"},
        Refusal{
            kStiffWall, {"to_master.playout_ms=-1"}, "to_master.playout_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall,
                {"to_master.deadband={force_n: 1}"},
                "to_master.deadband.ratio is missing; it must be between 0 and 1"},
        Refusal{
            kStiffWall, {"to_master.deadband={ratio: 2}"}, "to_master.deadband.ratio is 2; it must be between 0 and 1"},
        Refusal{kStiffWall,
                {"to_master.deadband={ratio: 0.1 silence_ms: 51}"},
                "to_master.deadband.silence_ms is 51; it must be <= 50, half of control.hold_after_s: "
                "else one lost packet is a silent link"},
        Refusal{kStiffWall,
                {"to_slave.deadband={ratio: 0.1 silence_ms: 11}", "control.hold_after_s=0.02"},
                "to_slave.deadband.silence_ms is 11; it must be <= 10, half of control.hold_after_s: "
                "else one lost packet is a silent link"},
        Refusal{
            kStiffWall,
            {"to_slave.playout_ms=1001"},
            "to_slave.playout_ms is 1001; it must be <= 1000, control.release_after_s: what waits hides that the link "
            "is silent"},
        Refusal{kStiffWall,
                {"to_slave.playout_ms=2049", "control.release_after_s=10"},
                "to_slave.playout_ms is 2049; it must be <= 2048: the buffer has room for 4096 packets"},
        Refusal{
            kStiffWall, {"slave_clock.offset_ms=-1"}, "slave_clock.offset_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall,
                {"slave_clock.drift_ppm=1e6"},
                "slave_clock.drift_ppm is 1000000; it must be between -100000 and 100000"},
        Refusal{kStiffWall,
                {"to_slave.trace_file=nowhere.txt"},
                "to_slave.trace_file: scenes/nowhere.txt: cannot be read: No such file or directory"}),
    name_of);

}  // namespace twoport::test
