#include "common/link/link_trace.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/link/delay_line.h"

namespace twoport::link_trace_test {
namespace {

constexpr double kLost = std::numeric_limits<double>::quiet_NaN();
const std::string kHeader = std::string{kLinkTraceHeader} + "\n";

std::string error_of(const std::string& text) {
  try {
    static_cast<void>(parse_link_trace(text, "link.csv"));
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

TEST(LinkTrace, ReadsRowsInAnyOrderAndWritesThemBack) {
  const LinkTrace t = parse_link_trace("# of a walk\r\n" + kHeader +
                                           "to_master,9,0.5,\r\n\nto_slave,2,0.001,3.25 # late\nto_slave,1,0,20\n"
                                           " to_master , 10 , 0.501 , 0 \n",
                                       "link.csv");
  ASSERT_EQ(t.to_slave.size(), 2U);
  EXPECT_EQ(t.to_slave[0].sequence, 1U);
  EXPECT_EQ(t.to_slave[0].delay_s, 0.02);
  EXPECT_EQ(t.to_slave[1].sent_s, 0.001);
  ASSERT_EQ(t.to_master.size(), 2U);
  EXPECT_TRUE(t.to_master[0].lost());
  EXPECT_EQ(t.to_master[1].delay_s, 0.0);
  EXPECT_EQ(to_csv(t), kHeader +
                           "to_slave,1,0.0000000,20.0000\nto_slave,2,0.0010000,3.2500\n"
                           "to_master,9,0.5000000,\nto_master,10,0.5010000,0.0000\n");
}

TEST(LinkTrace, IsToldFromOneNumberALine) {
  EXPECT_TRUE(is_link_trace("\n# x\ndirection;sequence\n"));
  EXPECT_FALSE(is_link_trace("12.5\n8\n"));
  EXPECT_FALSE(is_link_trace(""));
}

TEST(LinkTrace, RefusesWithLineValueAndWhatIsAllowed) {
  const std::string first = kHeader + "to_slave,1,0.5,20\n";
  const std::vector<std::pair<std::string, std::string>> cases{
      {"direction,sent_s\n",
       "link.csv:1: \"direction,sent_s\" is not the header; it must be direction,sequence,sent_s,delay_ms, then a row "
       "for each "
       "packet, as twoport-lab doctor --save writes them"},
      {first + "to_slave,2,0.6\n",
       "link.csv:3: \"to_slave,2,0.6\" has 3 fields; a row must be "
       "direction,sequence,sent_s,delay_ms"},
      {first + "to_slave,2,0.6,20,\n",
       "link.csv:3: \"to_slave,2,0.6,20,\" has 5 fields; a row must be "
       "direction,sequence,sent_s,delay_ms"},
      {first + "there,2,0.6,20\n", "link.csv:3: direction is \"there\"; it must be to_slave or to_master"},
      {first + "to_slave,1.5,0.6,20\n", "link.csv:3: sequence is \"1.5\"; it must be a whole number from 0 on"},
      {first + "to_slave,-1,0.6,20\n", "link.csv:3: sequence is \"-1\"; it must be a whole number from 0 on"},
      {first + "to_slave,2,soon,20\n", "link.csv:3: sent_s is \"soon\"; it must be between 0 and 1000000"},
      {first + "to_slave,2,0.6,-3\n",
       "link.csv:3: delay_ms is \"-3\"; it must be between 0 and 1000000, or empty where "
       "the packet was lost"},
      {first + "to_slave,2,0.6,nan\n",
       "link.csv:3: delay_ms is \"nan\"; it must be between 0 and 1000000, or empty where "
       "the packet was lost"},
      {first + "to_master,1,0.5,20\nto_slave,1,0.5,\n",
       "link.csv:4: sequence 1 of to_slave is in line 2 too; each packet must have one row"},
      {first + "to_slave,4,0.6,20\n",
       "link.csv:3: sequence 4 of to_slave follows 1; none may be left out: a lost packet "
       "has a row with an empty delay_ms"},
      {first + "to_slave,2,0.4,20\n",
       "link.csv:3: sent_s of sequence 2 of to_slave is 0.4; it must not be before 0.5, that of sequence 1"},
      {first + "to_master,1,0.5,\n", "link.csv: every packet of to_master is lost; at least one must arrive"}};
  for (const auto& [text, error] : cases) EXPECT_EQ(error_of(text), error);
}

/// What other programs write of a link is refused in one line, however long its own is.
TEST(LinkTrace, RefusesTheFilesOfOtherPrograms) {
  for (const std::string& text :
       {std::string{"PING 192.0.2.1 (192.0.2.1) 56(84) bytes of data.\n[1700000000.000001] 64 bytes from 192.0.2.1: "
                    "icmp_seq=1 ttl=57 time=20.1 ms\n"},
        std::string{"{\n \"version\": {\"irtt\": \"0.9.0\"},\n \"round_trips\": [{\"seqno\": 0}]\n}\n"},
        std::string{"0 16724562312345678901 1 0.00012 16724562312400000000 1 0.00021 255\n"},
        std::string{"0\n1\n1\n4\n"}, "seq;rtt\x1b[31m\x01" + std::string(5000, 'x')}) {
    const std::string error = error_of(text);
    EXPECT_TRUE(error.starts_with("link.csv:1: \"")) << error;
    EXPECT_NE(error.find("is not the header; it must be direction,sequence,sent_s,delay_ms"), error.npos) << error;
    EXPECT_LT(error.size(), 320U) << error;
    EXPECT_TRUE(std::all_of(error.begin(), error.end(), [](char c) { return c >= ' '; })) << error;
  }
}

/// Whatever the bytes: a trace that is read back as it was written, or a sentence with the line.
TEST(LinkTrace, SurvivesAnyChangeOfAFile) {
  std::mt19937 draw{1};
  std::string whole = kHeader;
  for (int i = 1; i <= 9; ++i) {
    const std::string n = std::to_string(i);
    whole += "to_slave," + n + ",0.0" + n + "," + (i % 4 == 0 ? "" : n + ".5") + "\nto_master," + n + "," + n + ",7\n";
  }
  const std::string alphabet = "0123456789,.-#\n\r \te+naifto_slavemaster";
  int read = 0;
  for (int i = 0; i < 20000; ++i) {
    std::string text = whole;
    for (auto changes = draw() % 4; changes > 0; --changes) {
      const std::size_t at = draw() % text.size();
      if (draw() % 3 == 0) {
        text.erase(at, draw() % 12);
      } else {
        text.insert(at, 1, alphabet[draw() % alphabet.size()]);
      }
      if (text.empty()) text = "#";
    }
    try {
      const LinkTrace t = parse_link_trace(text, "link.csv");
      const std::string written = to_csv(t);
      ASSERT_EQ(to_csv(parse_link_trace(written, "again")), written) << text;
      for (const TracedWay* way : {&t.to_slave, &t.to_master})
        if (!way->empty()) {
          EXPECT_FALSE(delays_at(*way, 1000.0).empty());
          EXPECT_GE(figures_of(*way).burst_packets, 1.0);
        }
      ++read;
    } catch (const ConfigError& e) {
      ASSERT_TRUE(std::string{e.what()}.starts_with("link.csv:")) << e.what();
    }
  }
  EXPECT_GT(read, 3000);
  EXPECT_LT(read, 17000);
}

/// A link whose figures are known in closed form: Gilbert's two states, and jitter far above the period.
TracedWay gilbert_link(double p, double r, double jitter_s, std::size_t packets) {
  ImpairmentOptions o;
  o.delay_s = 0.05;
  o.jitter_s = jitter_s;
  o.burst = GilbertElliottOptions{.p = p, .r = r};
  Impairment impairment{o, 7};
  TracedWay way;
  for (std::size_t i = 0; i < packets; ++i) {
    const auto fate = impairment.draw(Duration{0});
    way.push_back({i + 1, 1e-3 * static_cast<double>(i), fate.copies == 0 ? kLost : to_seconds(fate.delay[0]).si()});
  }
  return way;
}

TEST(LinkFigures, ReadBurstsRightOnALinkThatReorders) {
  constexpr double kBurst = 5.17, kLoss = 0.1, r = 1.0 / kBurst;
  for (const double jitter_s : {0.0, 0.02}) {
    const DirectionFigures f = figures_of(gilbert_link(r * kLoss / (1.0 - kLoss), r, jitter_s, 200'000));
    EXPECT_NEAR(f.burst_packets, kBurst, 0.2)
        << jitter_s;  // four standard errors: 5.17 sqrt(1 - r) / sqrt(3900 bursts)
    EXPECT_NEAR(f.loss(), kLoss, 0.01) << jitter_s;
    if (jitter_s > 0.0) {
      EXPECT_GT(f.late, 50'000) << "nearly every packet is overtaken";
    } else {
      EXPECT_EQ(f.late, 0);
    }
  }
}

/// Numbers of the packets in the order in which a delay line hands them over.
std::vector<std::size_t> order_of(const std::vector<double>& delays, std::size_t packets) {
  ImpairmentOptions o;
  o.recorded_delay_s = delays;
  DelayLine<std::size_t> line{o, 1, 1 << 15};
  std::vector<std::size_t> order;
  const auto take = [&](Duration now) {
    while (const std::size_t* out = line.take(now)) order.push_back(*out);
  };
  for (std::size_t k = 0; k < packets; ++k) {
    const Duration now = std::chrono::milliseconds{k};
    take(now);
    line.put(k, now);
  }
  take(std::chrono::hours{1});
  return order;
}

TEST(LinkReplay, GivesEachPacketItsDelayItsLossAndItsPlace) {
  const TracedWay way = gilbert_link(0.02, 0.2, 0.02, 5000);
  const std::vector<double> delays = delays_at(way, 1000.0);
  ASSERT_EQ(delays.size(), way.size());
  std::vector<std::size_t> expected;
  for (std::size_t i = 0; i < way.size(); ++i) {
    EXPECT_EQ(std::isnan(delays[i]), way[i].lost());
    if (way[i].lost()) continue;
    EXPECT_NEAR(delays[i], way[i].delay_s, 1e-9);
    expected.push_back(i);
  }
  std::stable_sort(expected.begin(), expected.end(), [&](std::size_t a, std::size_t b) {
    return way[a].sent_s + way[a].delay_s < way[b].sent_s + way[b].delay_s;
  });
  EXPECT_EQ(order_of(delays, way.size()), expected);
}

TEST(LinkReplay, KeepsTheOrderOfASenderThatWasIrregular) {
  // The third packet was sent 4 ms late, and did not overtake the second; the sixth overtook the fifth.
  const TracedWay way{{1, 0.0, 0.010},     {2, 0.001, 0.015},  {3, 0.006, 0.0105},
                      {4, 0.0061, 0.0105}, {5, 0.0062, 0.012}, {6, 0.0063, 0.0105},
                      {7, 0.0064, 0.0125}, {8, 0.007, 0.0125}, {9, 0.008, 0.0125}};
  EXPECT_EQ(order_of(delays_at(way, 1000.0), 9), (std::vector<std::size_t>{0, 1, 2, 3, 5, 4, 6, 7, 8}));
}

TEST(LinkReplay, FollowsTheTimeOfTheTraceAtAnotherRate) {
  const TracedWay way{{1, 0.0, 0.01}, {2, 0.005, kLost}, {3, 0.010, 0.02}, {4, 0.015, 0.03}};
  const std::vector<double> fast = delays_at(way, 400.0), slow = delays_at(way, 100.0);
  ASSERT_EQ(fast.size(), 8U);
  EXPECT_NEAR(fast[1], 0.01, 1e-12);
  EXPECT_TRUE(std::isnan(fast[2]) && std::isnan(fast[3]));
  EXPECT_NEAR(fast[7], 0.03, 1e-12);
  ASSERT_EQ(slow.size(), 2U);
  EXPECT_NEAR(slow[1], 0.02, 1e-12);
  EXPECT_EQ(delays_at({{1, 0.0, 0.01}}, 400.0), std::vector<double>{0.01});
}

/// Rows of a ping each second: a lost one is a share of the packets, two in a row an outage between them.
TEST(LinkReplay, TakesSparseRowsForSharesAndNotForOutages) {
  TracedWay way;
  for (std::uint64_t i = 0; i < 40; ++i) way.push_back({i, static_cast<double>(i), 0.02});
  way[7].delay_s = way[20].delay_s = way[21].delay_s = way[22].delay_s = kLost;
  const std::vector<double> delays = delays_at(way, 1000.0);
  ASSERT_EQ(delays.size(), 40'000U);
  const auto lost = [&](std::size_t from, std::size_t to) {
    return static_cast<double>(std::count_if(delays.begin() + static_cast<std::ptrdiff_t>(from),
                                             delays.begin() + static_cast<std::ptrdiff_t>(to),
                                             [](double each) { return std::isnan(each); }));
  };
  EXPECT_EQ(lost(20'000, 22'000), 2000);
  EXPECT_NEAR(lost(0, 20'000), 0.05 * 20'000, 3);  // two of forty rows
  EXPECT_NEAR(lost(7'000, 8'000), 50, 2);
  EXPECT_NEAR(lost(22'000, 40'000), 0.05 * 18'000, 3);
  EXPECT_NEAR(delays[7'001], 0.02, 1e-9);
}

/// Of the same link a row each second and each millisecond tell the same silence: none.
TEST(LinkFigures, TakeNoIntervalOfAProbeForSilence) {
  for (const double period_s : {1.0, 1e-3}) {
    TracedWay way;
    for (std::uint64_t i = 0; i < 60; ++i) way.push_back({i, period_s * static_cast<double>(i), 0.02});
    EXPECT_NEAR(figures_of(way).spacing_s, period_s, 1e-12);
    EXPECT_EQ(figures_of(way).longest_silence_s(), 0.0);
    way[30].delay_s = way[31].delay_s = way[32].delay_s = kLost;
    EXPECT_NEAR(figures_of(way).longest_silence_s(), 2.0 * period_s, 1e-9);
  }
}

struct Carried {
  double p50_ms, p99_ms, max_ms, lost_percent;
  int longest_run;
};
Carried statistics_of(const TracedWay& way) {
  const DirectionFigures f = figures_of(way);
  int run = 0, longest = 0;
  for (const TracedPacket& p : way) run = p.lost() ? run + 1 : 0, longest = std::max(longest, run);
  const auto ms = [&](double above_least_s) { return 1e3 * (f.least_s + above_least_s); };
  return {ms(f.jitter_p50_s), ms(f.jitter_p99_s), ms(f.jitter_max_s), 100.0 * f.loss(), longest};
}
/// Of each packet to the slave, with that of the first packet that is sent back after it has arrived.
Carried round_trips_of(const LinkTrace& link) {
  TracedWay way;
  for (const TracedPacket& p : link.to_slave) {
    const auto back = std::lower_bound(link.to_master.begin(), link.to_master.end(), p.sent_s + p.delay_s,
                                       [](const TracedPacket& b, double arrived_s) { return b.sent_s < arrived_s; });
    if (!p.lost() && back != link.to_master.end()) way.push_back({p.sequence, p.sent_s, p.delay_s + back->delay_s});
  }
  return statistics_of(way);
}

/// satellite: 10,000 packets of Starlink; car_*: round trips of 5G runs (tests/scenario/link_traces names both). The others are those of
/// docs/guides/network.md, to what it prints.
TEST(LinkFigures, ShippedLinksCarryTheStatisticsThatTheyAreSaidToHave) {
  const auto shipped = [](const std::string& name) {
    const std::string file = TWOPORT_SCENES "/links/" + name + ".csv";
    return parse_link_trace(read_text(file), file);
  };
  const auto expect = [](const std::string& what, const Carried& is, const Carried& said, double tolerance) {
    SCOPED_TRACE(what);
    EXPECT_NEAR(is.p50_ms, said.p50_ms, tolerance * said.p50_ms);
    EXPECT_NEAR(is.p99_ms, said.p99_ms, tolerance * said.p99_ms);
    EXPECT_NEAR(is.max_ms, said.max_ms, tolerance * said.max_ms);
    EXPECT_NEAR(is.lost_percent, said.lost_percent, 0.005);
    EXPECT_EQ(is.longest_run, said.longest_run);
  };
  const LinkTrace satellite = shipped("satellite");
  expect("satellite up", statistics_of(satellite.to_slave), {19.2, 43.7, 144.0, 0.04, 3}, 0.01);
  expect("satellite down", statistics_of(satellite.to_master), {19.4, 39.5, 90.5, 0.33, 3}, 0.01);
  expect("3.5 GHz", round_trips_of(shipped("car_3500_mhz")), {17.0, 33.0, 282.0, 0.0, 0}, 0.03);
  expect("900 MHz", round_trips_of(shipped("car_900_mhz")), {29.0, 63.0, 282.0, 0.0, 0}, 0.03);
  const std::vector<std::pair<std::string, std::pair<Carried, Carried>>> models{
      {"wifi_roaming", {{3.34, 22.07, 46.24, 8.675, 80}, {3.38, 22.89, 51.36, 8.65, 80}}},
      {"lte", {{22.08, 36.71, 65.0, 0.0, 0}, {12.62, 28.02, 60.0, 0.0, 0}}},
      {"transatlantic", {{41.01, 45.25, 51.08, 0.1, 2}, {41.03, 44.37, 49.24, 0.375, 4}}},
      {"home_uplink_under_load", {{200.41, 260.83, 261.17, 0.35, 2}, {10.35, 12.26, 16.19, 0.0, 0}}}};
  for (const auto& [name, said] : models) {
    const LinkTrace link = shipped(name);
    expect(name + " there", statistics_of(link.to_slave), said.first, 0.005);
    expect(name + " back", statistics_of(link.to_master), said.second, 0.005);
  }
}

TEST(LinkReplay, LosesTheCopiesOfALostPacketToo) {
  ImpairmentOptions o;
  o.recorded_delay_s = {0.003, kLost, 0.001};
  o.duplicate = 1.0;
  Impairment impairment{o, 1};
  for (int turn = 0; turn < 3; ++turn) {
    EXPECT_EQ(impairment.draw(Duration{0}).delay[1], std::chrono::milliseconds{3});
    EXPECT_EQ(impairment.draw(Duration{0}).copies, 0);
    EXPECT_EQ(impairment.draw(Duration{0}).copies, 2);
  }
}

}  // namespace
}  // namespace twoport::link_trace_test
