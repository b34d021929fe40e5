#include "common/base/print_error.h"

#include <gtest/gtest.h>

#include <string>
#include <string_view>

namespace twoport::print_error_test {
namespace {

TEST(PrintError, ShowsControlCharactersOfItsArgumentsAsText) {
  testing::internal::CaptureStderr();
  print_error("{}: \033[K{} {} {}\n", std::string{"a\033]0;title\007b"},
              "tab\t \u00e4 \xc2\x9b"
              "1m",
              7, std::string_view{"\x7f\xc2"});
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "a\\x1b]0;title\\x07b: \033[Ktab\t \u00e4 \\x9b1m 7 \\x7f\xc2\n");
}

}  // namespace
}  // namespace twoport::print_error_test
