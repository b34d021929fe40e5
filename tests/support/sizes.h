#pragma once

#include <gtest/gtest.h>

#include <string>
#include <type_traits>

namespace twoport::test {

/// For TYPED_TEST_SUITE: one, three and six degrees of freedom, as `TypeParam::value`.
using Sizes =
    ::testing::Types<std::integral_constant<int, 1>, std::integral_constant<int, 3>, std::integral_constant<int, 6>>;

/// Names them "1Dof", "3Dof", "6Dof".
struct SizeName {
  template <class Size>
  static std::string GetName(int) {
    return std::to_string(Size::value) + "Dof";
  }
};

}  // namespace twoport::test
