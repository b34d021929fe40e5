#include <cctype>
#include <fstream>
#include <string>
#include <vector>

#include "tests/unit/scene/scenes.h"

// Scenes that must not read (refusals.txt): the error names the place, the value and what is allowed.
namespace twoport::test::refusals_test {
namespace {

struct Refusal {
  std::string scene;
  Overrides overrides;
  std::string place, value;
  std::vector<std::string> allowed;
};

std::vector<std::string> split(const std::string& text, const std::string& by) {
  std::vector<std::string> parts;
  for (std::size_t at = 0, end = 0; end != text.npos && at <= text.size(); at = end + by.size()) {
    end = text.find(by, at);
    if (end != at && at < text.size()) parts.push_back(text.substr(at, end - at));
  }
  return parts;
}
std::vector<Refusal> refusals() {
  std::vector<Refusal> all;
  std::ifstream file{TWOPORT_SOURCE "/tests/unit/scene/refusals.txt"};
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line.starts_with('#')) continue;
    std::vector<std::string> column;
    for (std::size_t at = 0, end = 0; end != line.npos; at = end + 3)
      end = line.find(" | ", at), column.push_back(line.substr(at, end - at));
    column.resize(5);
    all.push_back({column[0], split(column[1], " && "), column[2], column[3], split(column[4], ", ")});
  }
  return all;
}
const char* scene_named(const std::string& name) {
  return name == "wall"      ? kStiffWall
         : name == "spring"  ? kHeldSpring
         : name == "turning" ? kTurning
         : name == "gripper" ? kGripper
                             : name.c_str();
}

/// Where `text` has `words` and no more of a word or number at either end.
std::size_t find_whole(const std::string& text, const std::string& words) {
  const auto part = [&](std::size_t at) {
    return at < text.size() && (std::isalnum(static_cast<unsigned char>(text[at])) != 0 || text[at] == '_');
  };
  std::size_t at = text.find(words);
  while (at != text.npos &&
         ((part(at) && at > 0 && part(at - 1)) || (part(at + words.size() - 1) && part(at + words.size()))))
    at = text.find(words, at + 1);
  return at;
}

/// "environment_0_wall_friction_is_minus_1": the name of a case.
std::string name_of(const ::testing::TestParamInfo<Refusal>& refusal) {
  std::string all, name;
  for (const std::string& each : refusal.param.overrides) all += each + ' ';
  if (all.empty()) all = refusal.param.scene;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool sign = all[i] == '-' && i + 1 < all.size() && std::isdigit(static_cast<unsigned char>(all[i + 1])) != 0;
    if (std::isalnum(static_cast<unsigned char>(all[i])) != 0)
      name += all[i];
    else if (sign)
      name += name.ends_with('_') ? "minus_" : "_minus_";
    else if (!name.ends_with('_'))
      name += '_';
  }
  return std::to_string(refusal.index) + "_" + name.substr(0, name.find_last_not_of('_') + 1);
}

class RefusedScene : public ::testing::TestWithParam<Refusal> {};

TEST_P(RefusedScene, NamesPlaceValueAndWhatIsAllowed) {
  const Refusal& r = GetParam();
  const std::string error = error_of(scene_named(r.scene), r.overrides), place = "scenes/x.textproto: " + r.place;
  ASSERT_EQ(find_whole(error, place), 0u) << error;
  const std::string after = error.substr(place.size());
  const std::size_t value = find_whole(after, r.value);
  ASSERT_NE(value, after.npos) << error << " does not say " << r.value;
  ASSERT_FALSE(r.allowed.empty());
  for (const std::string& each : r.allowed)
    EXPECT_NE(find_whole(after.substr(value + r.value.size()), each), after.npos) << error << " does not say " << each;
}

INSTANTIATE_TEST_SUITE_P(Table, RefusedScene, ::testing::ValuesIn(refusals()), name_of);

}  // namespace
}  // namespace twoport::test::refusals_test
