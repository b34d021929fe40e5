#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>

#include "common/record/summary.h"
#include "common/scene/hints.h"
#include "common/scene/load.h"
#include "lab/run.h"

namespace twoport::scenes_test {
namespace {

std::vector<std::string> scene_files() {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{TWOPORT_SCENES})
    if (entry.path().extension() == ".textproto") files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  return files;
}

class Scenario : public testing::TestWithParam<std::string> {};

TEST_P(Scenario, MeetsItsExpectations) {
  const Scene scene = load_scene(GetParam());
  EXPECT_TRUE(scene.expect.stable || !scene.expect.at_least.empty() || !scene.expect.at_most.empty() ||
              !scene.expect.of_method.empty())
      << "expects nothing";
  for (const std::string& sentence : violations(scene.expect, lab::run(scene))) ADD_FAILURE() << sentence;
  for (const MethodVerdict& each : scene.expect.of_method) {
    const Scene with_method = load_scene(GetParam(), std::vector{"control.passivity.method=" + each.method});
    const ExpectSpec its_verdict{.stable = {}, .at_least = {}, .at_most = {}, .of_method = scene.expect.of_method};
    for (const std::string& sentence : violations(its_verdict, lab::run(with_method))) ADD_FAILURE() << sentence;
  }
}

TEST_P(Scenario, GivesNoWarning) {
  // Their environment is there to put energy in, with every method, which is said.
  const std::size_t said = GetParam().ends_with("edge/moving_environment.textproto") ||
                           GetParam().ends_with("edge/let_go_in_contact.textproto") ||
                           GetParam().ends_with("/pushed_tool.textproto");
  const std::vector<std::string> all = hints(load_scene(GetParam()));
  EXPECT_EQ(all.size(), said) << fmt::format("{}", fmt::join(all, "; "));
}

INSTANTIATE_TEST_SUITE_P(Scenes, Scenario, testing::ValuesIn(scene_files()), [](const auto& each) {
  std::string name = std::filesystem::relative(each.param, TWOPORT_SCENES).replace_extension().string();
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
});

}  // namespace
}  // namespace twoport::scenes_test
