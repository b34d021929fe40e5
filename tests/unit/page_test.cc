#include <gtest/gtest.h>

#include <cmath>

#include "common/page/channel.h"
#include "common/platform/web_server.h"

namespace twoport::page_test {
namespace {

TEST(Http, OnlyLiteralHostsOfThisPort) {
  for (const char* good : {"127.0.0.1:45080", "localhost:45080", "LOCALHOST:45080", "[::1]:45080", "192.168.1.7:45080"})
    EXPECT_TRUE(is_literal_host(good, 45080)) << good;
  for (const char* bad : {"", "evil.example:45080", "127.0.0.1", "127.0.0.1:80", "localhost:450800",
                          "127.0.0.1.evil:45080", "1.2.3:45080", "1.2.3.256:45080", "[evil]:45080",
                          "[::1%; script-src *]:45080", "[127.0.0.1]:45080", "localhost:", "127.0.0.1:45080x"})
    EXPECT_FALSE(is_literal_host(bad, 45080)) << bad;
  EXPECT_TRUE(is_literal_host("127.0.0.1", 80));
}

TEST(Http, AnotherSitesOriginIsNotOwn) {
  EXPECT_TRUE(is_own_origin("localhost:45080", "http://localhost:45080"));
  for (const char* bad : {"", "null", "http://evil.example", "https://localhost:45080", "http://localhost:450801"})
    EXPECT_FALSE(is_own_origin("localhost:45080", bad)) << bad;
  EXPECT_FALSE(is_own_origin("", "http://"));
}

TEST(PageCommand, IsClampedToItsLimits) {
  const auto target = parse_page_command("target 9 -9 0.01 0 0 -4");
  ASSERT_TRUE(target);
  EXPECT_EQ(target->kind, PageCommand::Kind::target);
  EXPECT_EQ(target->number, (std::array<double, 6>{kPageReach, -kPageReach, 0.01, 0, 0, -kPageTurn}));
  EXPECT_EQ(parse_page_command("grip 1e9")->number[0], kPageGripMost);
  EXPECT_EQ(parse_page_command("grip -1")->number[0], kPageGripLeast);
  EXPECT_EQ(parse_page_command("opening 0.04")->kind, PageCommand::Kind::opening);
  EXPECT_EQ(parse_page_command("opening 0.04")->number[0], 0.04);
  EXPECT_EQ(parse_page_command("opening -1")->number[0], 0.0);
  EXPECT_EQ(parse_page_command("opening 9")->number[0], kPageReach);
  const auto network = parse_page_command("network to_master 1e6 50.5 1");
  ASSERT_TRUE(network);
  EXPECT_EQ(network->which, 1);
  EXPECT_EQ(network->number[0], kPageDelayMs);
  EXPECT_EQ(network->number[2], kPageLoss);
  EXPECT_EQ(parse_page_command("release")->kind, PageCommand::Kind::release);
  EXPECT_EQ(parse_page_command("method 3")->which, 3);
  EXPECT_EQ(parse_page_command("zero")->kind, PageCommand::Kind::zero);
  EXPECT_EQ(parse_page_command("take")->kind, PageCommand::Kind::take);
  EXPECT_EQ(parse_page_command("restart")->kind, PageCommand::Kind::restart);
  const auto surface = parse_page_command("surface 2 2e6 -1");
  ASSERT_TRUE(surface);
  EXPECT_EQ(surface->kind, PageCommand::Kind::surface);
  EXPECT_EQ(surface->which, 2);
  EXPECT_EQ(surface->number[0], 2e6) << "the slave judges";
  EXPECT_EQ(surface->number[1], 0.0);
  EXPECT_EQ(parse_page_command("surface 0 3 9")->number[1], 9.0);
  EXPECT_FALSE(parse_page_command("surface 4 1 0"));
  EXPECT_FALSE(parse_page_command("surface -1 1 0"));
  EXPECT_FALSE(parse_page_command("surface -0.5 1 0"));
  EXPECT_FALSE(parse_page_command("method -1"));
  EXPECT_EQ(parse_page_command("clutch 1")->kind, PageCommand::Kind::clutch);
  EXPECT_EQ(parse_page_command("clutch 1")->which, 1);
  EXPECT_EQ(parse_page_command("rehome")->kind, PageCommand::Kind::rehome);
  EXPECT_EQ(parse_page_command("lock 63")->which, 63);
  const auto scale = parse_page_command("scale 0 9");
  ASSERT_TRUE(scale);
  EXPECT_EQ(scale->number[0], kPageScaleLeast);
  EXPECT_EQ(scale->number[1], 1.0);
}

TEST(PageCommand, RefusesAnythingElse) {
  for (const char* bad : {"",
                          "x",
                          "target",
                          "target 0 0 0 0 0",
                          "target 0 0 0 0 0 0 0",
                          "target nan 0 0 0 0 0",
                          "target inf 0 0 0 0 0",
                          "target 0,1 0 0 0 0 0",
                          "target  0 0 0 0 0 0",
                          "grip",
                          "grip 1 1",
                          "opening",
                          "opening nan",
                          "opening 0 0",
                          "network up 1 1 0",
                          "network to_slave 1 1",
                          "release now",
                          "method 1.5",
                          "method x",
                          "clutch",
                          "clutch 2",
                          "clutch -1",
                          "rehome 1",
                          "lock 64",
                          "lock 0.5",
                          "scale 1",
                          "scale nan 1",
                          "surface 0 1",
                          "surface 0.5 1 0",
                          "surface 0 nan 0",
                          "surface 0 1 0 0"})
    EXPECT_FALSE(parse_page_command(bad)) << bad;
}

TEST(PageSample, FieldsCoverTheWholeSample) {
  PageSample sample;
  std::size_t numbers = 0;
  for_each_page_field(
      sample, [&](const char*, std::size_t size, const double*) { numbers += size; }, true);
  EXPECT_EQ(numbers * sizeof(double), sizeof(PageSample));
}

}  // namespace
}  // namespace twoport::page_test
