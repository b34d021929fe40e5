#include "common/platform/foxglove_server.h"

#include <gtest/gtest.h>

#include <string>

#include "common/base/check.h"

namespace twoport::foxglove_server_test {
namespace {

TEST(FoxgloveServer, NoPageOfAnotherSiteMayListen) {
  for (const char* origin : {"", "file://", "https://app.foxglove.dev", "http://localhost:8080", "http://localhost",
                             "http://127.0.0.1:3000", "http://[::1]:3000", "http://192.168.7.2"})
    EXPECT_TRUE(may_listen(origin)) << origin;
  for (const char* origin :
       {"null", "https://elsewhere.example", "http://elsewhere.example", "http://localhost.elsewhere.example",
        "http://localhost:elsewhere", "http://localhost:65536", "http://127.0.0.1.elsewhere.example",
        "https://app.foxglove.dev.elsewhere.example", "http://", "localhost"})
    EXPECT_FALSE(may_listen(origin)) << origin;
}

TEST(FoxgloveServer, NamesTheAddressThatItCannotBind) {
  const FoxgloveServer first{"127.0.0.1:0", "test"};
  const std::string taken = first.url().substr(std::string{"ws://"}.size());
  try {
    const FoxgloveServer second{taken, "test"};
    FAIL() << taken;
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("--foxglove " + taken), std::string::npos) << e.what();
    EXPECT_NE(std::string{e.what()}.find("port 0"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace twoport::foxglove_server_test
