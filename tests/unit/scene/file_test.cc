#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "tests/support/folder.h"
#include "tests/unit/scene/scenes.h"

namespace twoport::test::file_test {
namespace {

TEST(SceneFile, IsReadWithItsRecordedDelaysBesideIt) {
  const Folder folder;
  folder.write("lab.textproto", std::string{kStiffWall} + "description: \"from a file\"");
  folder.write("delays.txt", "# one way, ms\n12.5\n\n  8 # a quick one\r\n0");
  const Scene s = load_scene(folder / "lab.textproto", Overrides{"to_slave.trace_file=\"delays.txt\""});
  EXPECT_EQ(s.description, "from a file");
  EXPECT_EQ(s.to_slave.recorded_delay_s, (std::vector<double>{0.0125, 0.008, 0.0}));
  EXPECT_TRUE(s.to_master.recorded_delay_s.empty());
}

// The median, which a few late packets do not move; with a playout buffer the least delay and the buffer's.
TEST(SceneFile, TheRoundTripOfRecordedDelaysIsThatOfNearlyEveryPacket) {
  const Folder folder;
  folder.write("lab.textproto", kStiffWall);
  folder.write("delays.txt", "10\n11\n12\n13\n900");
  const auto round_trip_s = [&](const std::string& playout) {
    const Overrides o{"to_slave={ trace_file: \"delays.txt\" " + playout + " }", "to_master.delay_ms=5"};
    return load_scene(folder / "lab.textproto", o).control.known.round_trip.si();
  };
  EXPECT_NEAR(round_trip_s(""), 0.017, 1e-12);
  EXPECT_NEAR(round_trip_s("playout_ms: 20"), 0.035, 1e-12);
}

TEST(SceneFile, ALinkIsReadWithTheRowsOfEachDirection) {
  const Folder folder;
  folder.write("lab.textproto", kStiffWall);
  folder.write("link.csv",
               "direction,sequence,sent_s,delay_ms\nto_slave,1,0,12.5\nto_slave,2,0.0005,\nto_master,1,0,8\n");
  const Overrides both{"to_slave.trace_file=\"link.csv\"", "to_master.trace_file=\"link.csv\""};
  const Scene s = load_scene(folder / "lab.textproto", both);
  ASSERT_EQ(s.to_slave.recorded_delay_s.size(), 2U);
  EXPECT_EQ(s.to_slave.recorded_delay_s[0], 0.0125);
  EXPECT_TRUE(std::isnan(s.to_slave.recorded_delay_s[1]));
  EXPECT_EQ(s.to_master.recorded_delay_s, std::vector<double>{0.008});
  EXPECT_NEAR(s.control.known.round_trip.si(), 0.0205, 1e-12);  // of the packets that arrive
  folder.write("link.csv", "direction,sequence,sent_s,delay_ms\nto_slave,1,0,12.5\n");
  const auto error = [&] {
    try {
      static_cast<void>(load_scene(folder / "lab.textproto", both));
      return std::string{};
    } catch (const ConfigError& e) {
      return std::string{e.what()};
    }
  };
  EXPECT_TRUE(says(error(), {"to_master.trace_file: ", "link.csv has no row of to_master"}));
  folder.write("link.csv", "direction,sequence,sent_s,delay_ms\nto_slave,1,0,x\n");
  EXPECT_TRUE(says(error(), {"to_slave.trace_file: ", "link.csv:2: delay_ms is \"x\"", "between 0 and 1000000"}));
}

TEST(SceneFile, AWrongRecordedDelayIsNamedWithItsLine) {
  const Folder folder;
  folder.write("lab.textproto", kStiffWall);
  const auto error = [&](const std::string& delays) -> std::string {
    folder.write("delays.txt", delays);
    try {
      static_cast<void>(load_scene(folder / "lab.textproto", Overrides{"to_master.trace_file=\"delays.txt\""}));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_TRUE(says(error("1\n# two\nthree\n"), {"to_master.trace_file", "delays.txt:3: \"three\"", "between 0 and"}));
  EXPECT_TRUE(says(error("1\n-2\n"), {"delays.txt:2: \"-2\""}));
  EXPECT_TRUE(says(error("nan\n"), {"delays.txt:1: \"nan\""}));
  EXPECT_TRUE(says(error("inf\n"), {"delays.txt:1: \"inf\""}));
  EXPECT_TRUE(says(error("1 2\n"), {"delays.txt:1: \"1 2\""}));
  EXPECT_TRUE(says(error("# nothing\n"), {"delays.txt holds no delay"}));
  EXPECT_TRUE(
      says(error("PING 192.0.2.1 56(84) bytes\n"), {"delays.txt:1: \"PING 192", "direction,sequence,sent_s,delay_ms"}));
  // Times of deliveries, as mahimahi has them, are no delays; a ramp of delays is.
  std::string times, ramp;
  for (int i = 0; i < 200; ++i) times += std::to_string(12 * i) + "\n", ramp += std::to_string(i) + "\n";
  EXPECT_TRUE(
      says(error(times), {"to_master.trace_file: ", "delays.txt: 200 whole numbers that never fall", "mahimahi"}));
  EXPECT_EQ(error(ramp), "");
}

TEST(SceneFile, OneThatIsNotThereIsNamedWithTheReason) {
  const Folder folder;
  const auto error = [](const std::string& path) -> std::string {
    try {
      static_cast<void>(load_scene(path));
      return "";
    } catch (const ConfigError& e) {
      return e.what();
    }
  };
  EXPECT_TRUE(says(error(folder / "none.textproto"), {"none.textproto: cannot be read: No such file or directory"}));
  EXPECT_TRUE(says(error(folder / ""), {"cannot be read: Is a directory"}));
}

TEST(SceneFile, AnErrorInItIsNamedWithItsPath) {
  const Folder folder;
  folder.write("bad.textproto", "dof: 3\nduration: 1\n");
  try {
    static_cast<void>(load_scene(folder / "bad.textproto"));
    FAIL() << "it was read";
  } catch (const ConfigError& e) {
    EXPECT_TRUE(std::string{e.what()}.starts_with(folder / "bad.textproto" + ":2:1: ")) << e.what();
  }
}

}  // namespace
}  // namespace twoport::test::file_test
