#include <gtest/gtest.h>

// Status 77, for ctest: every test was skipped. Without any test that is an error.
int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  const int result = RUN_ALL_TESTS();
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  if (result != 0 || testing::GTEST_FLAG(list_tests)) return result;
  if (all.test_to_run_count() == 0) return 1;
  return all.successful_test_count() == 0 ? 77 : 0;
}
