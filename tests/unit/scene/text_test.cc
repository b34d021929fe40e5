#include <gtest/gtest.h>

#include "tests/unit/scene/scenes.h"

namespace twoport::test::text_test {
namespace {

TEST(SceneText, AMisspeltFieldIsNamedWithItsPlaceAndWhatThereIs) {
  const std::string e = error_of("dof: 3\nduration_s: 1\ncontrol {\n  pasivity { }\n}\n");
  EXPECT_TRUE(says(e, {"scenes/x.textproto:4:3: ", "Control has no field \"pasivity\"", "architecture", "passivity"}));
  EXPECT_TRUE(says(error_of("durration_s: 4"), {"scenes/x.textproto:1:1: ", "Scene has no field \"durration_s\""}));
}

TEST(SceneText, AnUnknownChoiceIsNamedWithItsPlaceAndTheAllowedOnes) {
  EXPECT_TRUE(says(error_of("dof: 3\ncontrol { passivity { method: PROJECTED } }"),
                   {"scenes/x.textproto:2:31: ", "method is PROJECTED", "NONE, CLASSIC, FORCE_PROJECTED"}));
}

TEST(SceneText, AWrongTypeHasAPlace) {
  EXPECT_TRUE(says(error_of("dof: 3.5"), {"scenes/x.textproto:1:6: ", "integer", "3.5"}));
  EXPECT_TRUE(says(error_of("\n\n\tdof: x"), {"scenes/x.textproto:3:7: ", "integer", "x"}));
  EXPECT_TRUE(says(error_of("expect {\n stable: maybe }"), {"scenes/x.textproto:2:10: ", "maybe", "true or false"}));
  EXPECT_TRUE(
      says(error_of("device { mass_kg: heavy }"), {"scenes/x.textproto:1:19: ", "a number is expected", "heavy"}));
}

TEST(SceneText, TheSameFieldTwiceHasAPlace) {
  EXPECT_TRUE(says(error_of("dof: 3 # three\ndof: 1"), {"scenes/x.textproto:2:1: ", "dof is given twice"}));
  EXPECT_TRUE(says(error_of("environment { wall { } sphere { } }"),
                   {"scenes/x.textproto:1:24: ", "sphere and wall are both given"}));
}

TEST(SceneText, OfTwoErrorsTheFirstIsTold) {
  EXPECT_TRUE(says(error_of("dof: 3\nseed: 09\nduration_s: 1\nrate: 5"), {"scenes/x.textproto:2:8: ", "octal"}));
}

TEST(SceneText, ATextThatStopsShortHasAPlace) {
  EXPECT_TRUE(
      says(error_of("control {\n passivity {"),
           {"scenes/x.textproto:2:13: ", "the text ends within control.passivity (opened at 2:2); a } is missing"}));
}

TEST(SceneText, ABlockThatIsNotClosedIsNamedWhereTheNextBlockIsNoFieldOfIt) {
  EXPECT_TRUE(says(
      error_of("dof: 3 # {\noperator {\n hand { mass_kg: 1 }\ndevice { mass_kg: 1 }\n"),
      {"x.textproto:4:1: Operator has no field \"device\"", "; perhaps the } of operator (opened at 2:1) is missing"}));
  EXPECT_TRUE(says(error_of("name: \"a { b\" control {\n passivity {\n method: NONE\n engage_s: 1 } }"),
                   {"x.textproto:4:2: ", "perhaps the } of control.passivity (opened at 2:2) is missing"}));
  EXPECT_EQ(error_of("operator { devise { } }").find("perhaps"), std::string::npos) << "no block has such a field";
}

TEST(SceneText, AClosingBraceTooManyHasAPlace) {
  EXPECT_TRUE(says(error_of("dof: 3 }\ndevice { }"), {"scenes/x.textproto:1:8: ", "this } closes no block"}));
}

TEST(SceneText, ADecimalCommaIsNamed) {
  EXPECT_TRUE(says(error_of("dof: 3\nduration_s: 1,5"),
                   {"scenes/x.textproto:2:13: ", "1,5 is not a number", "decimal point", "1.5"}));
  EXPECT_TRUE(says(error_of("device { mass_kg: -0,09 }"), {"scenes/x.textproto:1:19: ", "-0.09"}));
  // Commas part numbers of a list, and fields.
  EXPECT_TRUE(says(error_of(kStiffWall, {"device.position_m=[0,5]"}), {"[0, 5]; it must hold 3 numbers"}));
  EXPECT_EQ(error_of("dof: 3, duration_s: 1, device { mass_kg: 1 }"), "");
}

}  // namespace
}  // namespace twoport::test::text_test
