#include "common/platform/recorder.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <sstream>
#include <string>

namespace twoport::recorder_test {
namespace {

/// What is logged of a link that changes between two modes in every tick for `seconds`.
std::string log_of_flicker(double seconds) {
  std::ostringstream text;
  spdlog::logger log{"slave", std::make_shared<spdlog::sinks::ostream_sink_mt>(text)};
  log.set_pattern("%v");
  Recorder<1> recorder{{.metrics = Metrics<1>{{.rate_hz = 100.0,
                                               .duration_s = seconds,
                                               .quiet_from_s = std::numeric_limits<double>::infinity(),
                                               .link = true,
                                               .of_master = false},
                                              1.0,
                                              {.stability = false, .hand = false}},
                        .trace = nullptr,
                        .recording = nullptr,
                        .stream = nullptr,
                        .duration_s = seconds,
                        .side = Side::slave,
                        .trace_every = 1,
                        .configurations = {},
                        .log = log,
                        .shows_progress = false}};
  TickView view;
  view.sessions = 1;
  Row<1> row;
  for (int k = 0; k < static_cast<int>(100.0 * seconds); ++k) {
    row.t_s = 0.01 * k;
    row.mode = k % 2 == 0 ? Mode::coupled : Mode::let_go;
    recorder.push(row, view);
  }
  recorder.finish();
  return text.str();
}

TEST(Log, ShowsControlCharactersOfNamesAsText) {
  testing::internal::CaptureStderr();
  make_log("slave").info("hardware: {}", "\033]0;title\007");
  EXPECT_NE(testing::internal::GetCapturedStderr().find("slave info: hardware: \\x1b]0;title\\x07\n"),
            std::string::npos);
}

TEST(Recorder, ALinkThatFlickersDoesNotFillTheLog) {
  const std::string text = log_of_flicker(25.0);
  // 50 lines in each of three spans of 10 s, and what each leaves out.
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3 * 51) << text;
  EXPECT_EQ(text.rfind("0.000 s: paired with the master\n0.010 s: released: nobody holds the handle\n", 0), 0U) << text;
  EXPECT_NE(text.find("10.000 s: 950 more changes in the last 10 s, which are not listed\n"), std::string::npos)
      << text;
  EXPECT_NE(text.find("24.990 s: 450 more changes in the last 5 s, which are not listed\n"), std::string::npos) << text;
}

TEST(Recorder, AFewChangesAreAllSaid) {
  const std::string text = log_of_flicker(0.2);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 20) << text;
}

}  // namespace
}  // namespace twoport::recorder_test
