#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "tests/support/inverse3_service.h"
#include "tests/support/live.h"

// A Haply Inverse3 at the master, of a stand-in for its service.
namespace twoport::test::inverse3_test {
namespace {

constexpr const char* kSilent = "readings of the hardware are not finite, or too old";

TEST(Inverse3Live, FeelsAWallBeyondALinkAndIsLetGoWhenItsServiceDies) {
  auto service = std::make_unique<Inverse3Service>();
  const Pair pair{press(3)};
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=6"});
  Process master = pair.master("master", {"--device", service->choice(), "--set", "duration_s=5"});
  pair.await("master", 0.3);
  const long before = service->commands;
  service->aim_m = 0.03;  // the wall begins at 20 mm
  pair.await("master", 2.5);
  // Of 4400; with readings that are rarer than ticks the passivity layer mutes the force.
  const bool keeps_up = service->commands - before > 3000 && count(master.err(), kSilent) == 0;
  const double push = service->most_push_n;
  service.reset();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_NE(master.err().find("hardware: Haply Inverse3 049D at 127.0.0.1:"), std::string::npos) << master.err();
  EXPECT_EQ(count(master.err(), kSilent), 1) << master.err();
  const Trace trace = pair.trace("master");
  if (!keeps_up) GTEST_SKIP() << "not judged: the machine was too busy for the stand-in and the driver's thread";
  EXPECT_GT(push, 1.0);
  EXPECT_GT(trace.peak("env_f_0", 0.3, 2.5), 1.0);
  EXPECT_GT(trace.peak("master_f_0", 0.3, 2.5), 1.0);
  EXPECT_EQ(trace.peak("master_f_0", 4.2, 5.0), 0.0);
  EXPECT_EQ(pair.summary("master").mode(), "let_go");
  expect_sound({pair.summary("master"), pair.summary("slave")});
}

}  // namespace
}  // namespace twoport::test::inverse3_test
