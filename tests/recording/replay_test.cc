#include "lab/study/replay.h"

#include <gtest/gtest.h>

#include <bit>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/record/trace_channel.h"
#include "common/recording/hand.h"
#include "common/recording/recording.h"
#include "common/scene/load.h"
#include "lab/engine/recording.h"
#include "lab/run.h"
#include "proto/recording.pb.h"
#include "tests/recording/rewrite.h"
#include "tests/support/folder.h"

// A run in virtual time, recorded and replayed.
namespace twoport::test::replay_test {
namespace {

struct Recorded {
  Folder folder;
  std::string path = folder / "run.mcap", csv = folder / "trace.csv";
  Summary summary;

  Recorded(const std::string& scene, std::vector<std::string> overrides) {
    const Scene read = load_scene(scene, overrides);
    WholeFile trace{csv};
    const lab::RecordingOptions record{path, scene, read_whole(scene), std::move(overrides)};
    summary = lab::run(read, {.trace = &trace, .verdict = lab::VerdictFrom::plain, .record = &record});
    trace.commit();
  }
  lab::Replayed replayed() const {
    RecordingReader reader{path};
    return lab::replay(reader);
  }
};

std::string scene(const std::string& name) {
  return std::string{TWOPORT_SCENES} + "/" + name + ".textproto";
}

void expect_identical(const lab::Replayed& all, std::size_t sides) {
  ASSERT_EQ(all.sides.size(), sides);
  EXPECT_FALSE(all.torn);
  for (const lab::ReplayedSide& each : all.sides) {
    EXPECT_EQ(each.difference, "") << each.side;
    EXPECT_GT(each.ticks, 100u) << each.side;
  }
}

// ---- every kind of run replays to the bit

struct Case {
  const char* scene;
  std::vector<std::string> overrides;
  std::size_t sides = 2;
};
class Replay : public testing::TestWithParam<Case> {};

TEST_P(Replay, IsIdenticalToTheBit) {
  std::vector<std::string> overrides = GetParam().overrides;
  overrides.emplace_back("duration_s=2.5");
  const Recorded run{scene(GetParam().scene), overrides};
  expect_identical(run.replayed(), GetParam().sides);
}

INSTANTIATE_TEST_SUITE_P(Runs, Replay,
                         testing::Values(Case{"demo", {}}, Case{"demo", {"control.passivity.method=FORCE_PROJECTED"}},
                                         Case{"demo", {"control.passivity.method=NONE"}},
                                         Case{"demo", {"control.passivity.method=WAVE_VARIABLES"}},
                                         Case{"demo", {"control.passivity.method=ENERGY_TANK"}},
                                         Case{"demo", {"control.passivity.method=MODEL_MEDIATED"}},
                                         Case{"one_axis_wall", {}}, Case{"six_dof_plate", {}}, Case{"ideal_robot", {}},
                                         Case{"two_rates", {}}, Case{"switching", {}},
                                         Case{"reorder_and_duplicate", {}}, Case{"blackout_in_contact", {}},
                                         Case{"edge/deadband", {}}, Case{"edge/playout", {}},
                                         Case{"edge/clock_skew", {}}, Case{"gripper_50ms", {}, 4},
                                         Case{"render_sphere", {}, 1}, Case{"six_dof_render", {}, 1}),
                         [](const auto& each) {
                           std::string name = each.param.scene;
                           for (const std::string& o : each.param.overrides) name += "_" + o.substr(o.find('=') + 1);
                           for (char& c : name)
                             if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
                           return name;
                         });

// The recorded loop is compiled apart; its results are those of the other one.
TEST(Recording, ChangesNoResult) {
  for (const char* name : {"demo", "six_dof_plate", "render_sphere"}) {
    const Recorded run{scene(name), {"duration_s=2"}};
    const Folder folder;
    WholeFile trace{folder / "trace.csv"};
    lab::run(load_scene(scene(name), std::vector<std::string>{"duration_s=2"}),
             {.trace = &trace, .verdict = lab::VerdictFrom::plain});
    trace.commit();
    EXPECT_EQ(bytes_of(run.csv), bytes_of(folder / "trace.csv")) << name;
  }
}

TEST(Recording, ExportsTheTraceByteForByte) {
  for (const char* name : {"one_axis_wall", "demo", "six_dof_plate", "render_sphere"}) {
    const Recorded run{scene(name), {"duration_s=1"}};
    RecordingReader reader{run.path};
    std::ofstream{run.folder / "exported-gripper.csv"} << "of another recording";
    const std::vector<ExportedTrace> written = export_trace(reader, run.folder / "exported.csv");
    ASSERT_EQ(written.size(), 1u);
    EXPECT_FALSE(std::filesystem::exists(run.folder / "exported-gripper.csv"));
    EXPECT_EQ(read_whole(run.folder / "exported-gripper.csv~"), "of another recording");
    EXPECT_GT(written[0].rows, 500u);
    EXPECT_EQ(bytes_of(run.folder / "exported.csv"), bytes_of(run.csv)) << name;
  }
}

TEST(Recording, ExportsTheTraceOfAGripperBesideItByteForByte) {
  const std::vector<std::string> overrides{"duration_s=1"};
  const Folder folder;
  const Scene read = load_scene(scene("gripper_50ms"), overrides);
  WholeFile trace{folder / "trace.csv"}, of_gripper{folder / "trace-gripper.csv"};
  const lab::RecordingOptions record{folder / "run.mcap", scene("gripper_50ms"), read_whole(scene("gripper_50ms")),
                                     overrides};
  lab::run(read,
           {.trace = &trace, .verdict = lab::VerdictFrom::plain, .gripper_trace = &of_gripper, .record = &record});
  trace.commit();
  of_gripper.commit();
  RecordingReader reader{folder / "run.mcap"};
  const std::vector<ExportedTrace> written = export_trace(reader, folder / "again.csv");
  ASSERT_EQ(written.size(), 2u);
  EXPECT_EQ(written[1].path, folder / "again-gripper.csv");
  EXPECT_EQ(written[0].rows, written[1].rows);
  EXPECT_EQ(bytes_of(folder / "again.csv"), bytes_of(folder / "trace.csv"));
  EXPECT_EQ(bytes_of(folder / "again-gripper.csv"), bytes_of(folder / "trace-gripper.csv"));
}

// ---- a bit that is not as recorded is found

/// Changes message `index` of `topic` and returns what the replay says of that side.
std::string difference_after(const Recorded& run, const std::string& topic, std::size_t index,
                             const std::function<void(schema::RecordedTick&)>& change) {
  Messages m = read_messages(run.path);
  std::size_t seen = 0;
  for (Messages::Each& each : m.all) {
    if (each.topic != topic || seen++ != index) continue;
    schema::RecordedTick tick;
    EXPECT_TRUE(tick.ParseFromString(each.data));
    change(tick);
    each.data = tick.SerializeAsString();
  }
  EXPECT_GT(seen, index);
  const std::string path = run.folder / "changed.mcap";
  write_messages(path, m);
  RecordingReader reader{path};
  const lab::Replayed all = lab::replay(reader);
  EXPECT_FALSE(all.identical());
  for (const lab::ReplayedSide& each : all.sides)
    if ("/" + each.side + "/tick" == topic) return each.difference;
  return "no such side";
}

double with_last_bit_flipped(double value) {
  return std::bit_cast<double>(std::bit_cast<std::uint64_t>(value) ^ 1U);
}

struct Flipped {
  const char *name, *topic;
  std::function<void(schema::RecordedTick&)> change;
};

TEST(Recording, OneBitOfAnInputOrAResultIsFound) {
  const Recorded run{scene("demo"), {"duration_s=2.5", "control.passivity.method=FORCE_PROJECTED"}};
  const auto flip = [](auto* field) { field->Set(0, with_last_bit_flipped(field->Get(0))); };
  const std::vector<Flipped> all = {
      {"x", "/master/tick", [&](auto& t) { flip(t.mutable_x()); }},
      {"v", "/master/tick", [&](auto& t) { flip(t.mutable_v()); }},
      {"command", "/master/tick", [&](auto& t) { flip(t.mutable_command()); }},
      {"wanted", "/master/tick", [&](auto& t) { flip(t.mutable_wanted()); }},
      {"received force", "/master/tick", [&](auto& t) { flip(t.mutable_received(0)->mutable_f()); }},
      // A low bit would be a gap and a repetition, which change no result.
      {"received sequence", "/master/tick",
       [](auto& t) { t.mutable_received(0)->set_sequence(t.received(0).sequence() ^ std::uint64_t{1} << 40U); }},
      {"sent", "/master/tick",
       [](auto& t) { t.mutable_sent()->set_energy_in_j(with_last_bit_flipped(t.sent().energy_in_j())); }},
      {"now", "/master/tick", [](auto& t) { t.set_now_ns(t.now_ns() ^ 1); }},
      {"mode", "/master/tick", [](auto& t) { t.set_mode(t.mode() ^ 1U); }},
      {"x", "/slave/tick", [&](auto& t) { flip(t.mutable_x()); }},
      {"f_environment", "/slave/tick", [&](auto& t) { flip(t.mutable_f_environment()); }},
      {"x_d", "/slave/tick", [&](auto& t) { flip(t.mutable_x_d()); }},
      {"received x", "/slave/tick", [&](auto& t) { flip(t.mutable_received(0)->mutable_x()); }},
  };
  for (const Flipped& each : all) {
    const std::string difference = difference_after(run, each.topic, 2000, each.change);
    ASSERT_NE(difference, "") << each.topic << " " << each.name;
    // At once, or where the number first counts.
    ASSERT_EQ(difference.find("tick "), 0u) << each.topic << " " << each.name << ": " << difference;
    const std::uint64_t tick = std::stoull(difference.substr(std::string{"tick "}.size()));
    EXPECT_GE(tick, 2000u) << difference;
    EXPECT_LE(tick, 2200u) << difference;
  }
  EXPECT_EQ(difference_after(run, "/master/tick", 2000, [&](auto& t) { flip(t.mutable_command()); })
                .find("tick 2000 at 1.000000 s: command[0] is "),
            0u);
}

TEST(Recording, OneBitOfAGripperIsFound) {
  const Recorded run{scene("gripper_50ms"), {"duration_s=1.5"}};
  for (const char* topic : {"/master/gripper/tick", "/slave/gripper/tick"}) {
    const std::string difference = difference_after(
        run, topic, 1000, [](schema::RecordedTick& t) { t.mutable_x()->Set(0, with_last_bit_flipped(t.x(0))); });
    EXPECT_EQ(difference.find("tick 1"), 0u) << topic << ": " << difference;
  }
}

TEST(Recording, AnotherSceneIsFound) {
  const Recorded run{scene("demo"), {"duration_s=2.5"}};
  Messages m = read_messages(run.path);
  for (Messages::Each& each : m.all) {
    if (each.topic != "/master/header") continue;
    schema::RecordingHeader header;
    ASSERT_TRUE(header.ParseFromString(each.data));
    header.add_override("control.virtual_coupling.stiffness_n_per_m=1001");
    each.data = header.SerializeAsString();
  }
  write_messages(run.folder / "changed.mcap", m);
  RecordingReader reader{run.folder / "changed.mcap"};
  const lab::Replayed all = lab::replay(reader);
  ASSERT_EQ(all.sides.size(), 2u);
  EXPECT_NE(all.sides[0].difference, "");  // master
  EXPECT_EQ(all.sides[1].difference, "");
}

TEST(Recording, MissingTicksAreSaid) {
  const Recorded run{scene("demo"), {"duration_s=1"}};
  Messages m = read_messages(run.path);
  std::size_t seen = 0;
  std::erase_if(m.all,
                [&](const Messages::Each& each) { return each.topic == "/slave/tick" && ++seen > 100 && seen <= 103; });
  write_messages(run.folder / "changed.mcap", m);
  RecordingReader reader{run.folder / "changed.mcap"};
  const lab::Replayed all = lab::replay(reader);
  EXPECT_EQ(all.sides.at(1).ticks, 100u);
  EXPECT_EQ(all.sides.at(1).difference, "ticks 100 to 102 are missing; nothing can be replayed from there on");
}

TEST(Recording, OfARobotAloneIsRefused) {
  EXPECT_THROW(Recorded(scene("chart/box_on_plane"), {"duration_s=0.1"}), ConfigError);
}

// ---- a recorded hand

TEST(Recording, TheHandOfARecordingIsThePathInTheLaboratory) {
  const Recorded run{scene("demo"), {"duration_s=3"}};
  // Imposed, so that the handle is where the recorded one was, tick by tick; in six digits of the way in numbers.
  const std::string text = R"(dof: 3 duration_s: 2.5 rate_hz: 2000
operator { recording: "run.mcap" }
control { passivity { method: FORCE_PROJECTED } }
to_slave { delay_ms: 20 } to_master { delay_ms: 20 }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
environment { wall { normal: [-1, 0, 0] offset_m: -0.02 stiffness_n_per_m: 2000 } }
)";
  const std::string with_recording = run.folder.write("again.textproto", text);
  const Recorded again{with_recording, {}};
  expect_identical(again.replayed(), 2);
  const RecordedHand first = read_recorded_hand(run.path), second = read_recorded_hand(again.path);
  ASSERT_EQ(second.dof, 3);
  ASSERT_EQ(second.t_s.size(), 5000u);
  double largest = 0.0;
  for (std::size_t i = 0; i < second.x.size(); ++i) {
    // Times are sums of periods: at most a rounding beside the recorded sample.
    EXPECT_NEAR(second.x[i], first.x[i], 1e-12);
    largest = std::max(largest, std::abs(second.x[i]));
  }
  EXPECT_GT(largest, 0.01);
}

// As for the arm: imposed, so that the opening is the recorded one, tick by tick.
TEST(Recording, TheGripperOfARecordingIsThePathOfOne) {
  const Recorded run{scene("gripper_50ms"), {"duration_s=2"}};
  const Recorded again{scene("gripper_50ms"),
                       {"duration_s=1.5", "operator.recording=\"" + run.path + "\"",
                        "gripper.operator={recording: \"" + run.path + "\"}"}};
  expect_identical(again.replayed(), 4);
  for (const bool of_gripper : {false, true}) {
    const RecordedHand first = read_recorded_hand(run.path, of_gripper),
                       second = read_recorded_hand(again.path, of_gripper);
    EXPECT_EQ(second.dof, of_gripper ? 1 : 3);
    if (!of_gripper) continue;  // a hand holds the arm, and leads it to about the recorded path
    ASSERT_GT(second.x.size(), 1000u);
    double least = 1.0, largest = 0.0;
    for (std::size_t i = 0; i < second.x.size(); ++i) {
      EXPECT_NEAR(second.x[i], first.x[i], 1e-12);
      least = std::min(least, second.x[i]), largest = std::max(largest, second.x[i]);
    }
    EXPECT_GT(largest - least, 0.005);
  }
}

TEST(Recording, OfAnotherSizeOrNoneIsRefusedAsAHand) {
  const Recorded run{scene("one_axis_wall"), {"duration_s=0.5"}};
  const auto refused = [&](const std::string& file) {
    try {
      parse_scene("dof: 3 duration_s: 1 operator { recording: \"" + file + "\" }", run.folder / "s.textproto");
    } catch (const ConfigError& e) {
      return std::string{e.what()};
    }
    return std::string{"accepted"};
  };
  EXPECT_NE(refused("run.mcap").find("operator.recording is \"run.mcap\"; it must be of dof 3, and is of 1"),
            std::string::npos)
      << refused("run.mcap");
  const std::string no_gripper = [&] {
    try {
      load_scene(scene("gripper_50ms"), std::vector<std::string>{"gripper.operator={recording: \"" + run.path + "\"}"});
    } catch (const ConfigError& e) {
      return std::string{e.what()};
    }
    return std::string{"accepted"};
  }();
  EXPECT_NE(no_gripper.find("gripper.operator.recording: " + run.path + ": it has no gripper"), std::string::npos)
      << no_gripper;
  EXPECT_NE(refused("none.mcap").find("none.mcap: it is not there"), std::string::npos) << refused("none.mcap");
  EXPECT_NE(refused("trace.csv").find("trace.csv: it is no MCAP file"), std::string::npos) << refused("trace.csv");
}

}  // namespace
}  // namespace twoport::test::replay_test
