#include "common/scene/find.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "common/base/check.h"
#include "common/base/text.h"
#include "tests/support/process.h"

namespace twoport::find_test {
namespace {

using Words = std::vector<std::string>;

TEST(NearestNames, HoldWhatWasTypedThenAreIt) {
  const Words names{"held_spring", "demo", "desk", "assembly"};
  EXPECT_EQ(nearest_names("demp", names, 2), (Words{"demo", "desk"}));
  EXPECT_EQ(nearest_names("spring", names, 1), Words{"held_spring"});
  EXPECT_EQ(nearest_names("x", {}, 3), Words{});
}

TEST(SceneName, IsTheFileWhereThereIsOneElseTheSceneOfThatName) {
  const test::Folder folder;
  const std::string own = folder.write("demo", "dof: 1");
  EXPECT_EQ(scene_file(own), own);
  EXPECT_TRUE(std::filesystem::equivalent(scene_file("demo"), TWOPORT_SCENES "/demo.textproto"));
  EXPECT_TRUE(std::filesystem::equivalent(scene_file("edge/deadband"), TWOPORT_SCENES "/edge/deadband.textproto"));
  EXPECT_TRUE(std::filesystem::equivalent(project_folder("scenes/edge"), TWOPORT_SCENES "/edge"));
}

TEST(SceneName, IsLookedForAboveALibraryToo) {
  const test::Folder folder;
  std::filesystem::create_directories(folder / "share/twoport/scenes");
  std::filesystem::create_directories(folder / "lib/python/twoport");
  const std::string own = folder.write("share/twoport/scenes/of_this_test.textproto", "dof: 1");
  EXPECT_THROW(static_cast<void>(scene_file("of_this_test")), ConfigError);
  look_above(folder / "lib/python/twoport");
  EXPECT_EQ(scene_file("of_this_test"), own);
  EXPECT_TRUE(std::filesystem::equivalent(scene_file("demo"), TWOPORT_SCENES "/demo.textproto"));
}

TEST(SceneName, SaysWhichNamesAreNear) {
  try {
    static_cast<void>(scene_file("demp"));
    ADD_FAILURE() << "was found";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}.find("demp: no such file, and no scene of this name; did you mean demo"), 0U)
        << e.what();
  }
  // Paths are complained of where they are read.
  EXPECT_EQ(scene_file("nowhere/demp"), "nowhere/demp");
  EXPECT_EQ(scene_file("demp.textproto"), "demp.textproto");
}

}  // namespace
}  // namespace twoport::find_test
