#define TWOPORT_EACH_DOF(X, ...) X(1, __VA_ARGS__) X(3, __VA_ARGS__)
#include "common/base/built_for.h"

#include <gtest/gtest.h>

#include <string>

namespace twoport::built_for_test {
namespace {

TEST(BuiltFor, RunsTheSizesOfTheFileAndRefusesOthersInWords) {
  const auto size = [](int dof) { return for_dof(dof, []<int N>() { return N; }); };
  EXPECT_EQ(size(1), 1);
  EXPECT_EQ(size(3), 3);
  try {
    size(6);
    FAIL() << "6 is not built";
  } catch (const ConfigError& e) {
    EXPECT_EQ(std::string{e.what()}, "dof is 6, which this program is not built for; scripts/build builds it for all");
  }
}

}  // namespace
}  // namespace twoport::built_for_test
