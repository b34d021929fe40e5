#include "drivers/inverse3.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>

#include "common/base/check.h"
#include "common/scene/scene.h"
#include "drivers/drivers.h"
#include "tests/support/inverse3_service.h"

namespace twoport::inverse3_test {
namespace {

using test::Inverse3Service;
using Answers = Inverse3Service::Answers;
using std::chrono::milliseconds;

constexpr Seconds kPeriod{1e-3};
const std::string kMessage =
    R"({"session_id":7,"inverse3":[{"device_id":"049D","config":{"type":"inverse3"},"state":{"cursor_position":{"x":0.01,"y":-0.12,"z":1.5e-1},)"
    R"("cursor_velocity":{"x":0,"y":0.5,"z":-2}},"status":{"calibrated":true}},{"device_id":"04A0","state":{"cursor_position":{"x":1,"y":2,"z":3},)"
    R"("cursor_velocity":{"x":4,"y":5,"z":6}}}],"wireless_verse_grip":[]})";

std::string with(const std::string& before, const std::string& after) {
  std::string message = kMessage;
  return message.replace(message.find(before), before.size(), after);
}

TEST(Inverse3, ReadsTheMessagesOfTheDocuments) {
  const auto first = read_inverse3(kMessage, "");
  ASSERT_TRUE(first);
  EXPECT_EQ(first->id, "049D");
  EXPECT_EQ(first->x_m, Eigen::Vector3d(0.01, -0.12, 0.15));
  EXPECT_EQ(first->v_m_per_s, Eigen::Vector3d(0.0, 0.5, -2.0));
  const auto other = read_inverse3(kMessage, "04A0");
  ASSERT_TRUE(other);
  EXPECT_EQ(other->v_m_per_s, Eigen::Vector3d(4.0, 5.0, 6.0));
}

TEST(Inverse3, DropsWhatIsNoReading) {
  EXPECT_FALSE(read_inverse3(kMessage, "049E"));
  for (const char* message :
       {"", "{", "[]", "null", "7", R"({"inverse3":[]})", R"({"inverse3":7})", R"({"inverse3":[7]})"})
    EXPECT_FALSE(read_inverse3(message, "")) << message;
  for (const char* number :
       {"NaN", "\"NaN\"", "inf", "\"-inf\"", "1e999", "1e300", "-101", "null", "{}", "\"\"", "\"0.01 \"", "0x1"})
    EXPECT_FALSE(read_inverse3(with("0.01", number), "")) << number;
  EXPECT_FALSE(read_inverse3(with("\"y\":-0.12,", ""), ""));
  EXPECT_FALSE(read_inverse3(with("cursor_velocity", "velocity"), ""));
  EXPECT_FALSE(read_inverse3(with("\"calibrated\":true", "\"calibrated\":false"), ""));
  for (const char* id : {"", "049 D", "049\\n", "049\\u001b[2J"})
    EXPECT_EQ(read_inverse3(with("049D", id), "")->id, "04A0") << "the name goes to the log: " << id;
  EXPECT_FALSE(read_inverse3(std::string(60'000, '['), "")) << "it would take the stack of a thread";
}

// Half of them are damaged messages.
TEST(Inverse3, OfRandomBytesReadsFiniteNumbersOrNothing) {
  std::mt19937 random{5};
  int read = 0;
  for (int k = 0; k < 20'000; ++k) {
    std::string message = k % 2 == 0 ? kMessage : std::string(random() % 200, ' ');
    for (std::size_t n = k % 2 == 0 ? 1 + random() % 3 : message.size(); n > 0; --n)
      message[random() % message.size()] = static_cast<char>(random());
    if (k % 4 == 0) message.resize(random() % message.size());
    if (const auto state = read_inverse3(message, "")) {
      ++read;
      ASSERT_TRUE(state->x_m.allFinite() && state->v_m_per_s.allFinite()) << message;
      ASSERT_LE(state->x_m.cwiseAbs().maxCoeff(), 100.0) << message;
    }
  }
  EXPECT_GT(read, 100) << "bytes in words that nobody reads do no harm";
}

TEST(Inverse3, SendsTheCommandsOfTheDocuments) {
  EXPECT_EQ(
      inverse3_command("049D", {0.0, -1.25, 1.5}, true),
      R"({"session":{"configure":{"profile":{"name":"twoport"}}},"inverse3":[{"device_id":"049D","commands":)"
      R"({"set_cursor_force":{"vector":{"x":0.000000,"y":-1.250000,"z":1.500000},"values":{"x":0.000000,"y":-1.250000,"z":1.500000}}}}]})");
  EXPECT_EQ(inverse3_command("a\"b", {0.0, 0.0, 0.0}, false).find(R"({"inverse3":[{"device_id":"a\"b",)"), 0u);
}

/// The driver, one tick a millisecond.
struct Rig {
  explicit Rig(const std::string& choice) : device{all_drivers().devices.open<3>(choice, scene, kPeriod)} {}
  /// Ticks until `holds`, for 3 s at most.
  bool until(const std::function<bool()>& holds) {
    for (int k = 0; k < 3000; ++k) {
      s = device->sense({Instant<MasterClock>{tick_time(k, 1.0 / kPeriod.si())}, kPeriod});
      if (holds()) return true;
      if (acts) device->actuate(Force<3>{f});
      std::this_thread::sleep_for(milliseconds{1});
    }
    return false;
  }
  const Scene scene{};
  std::unique_ptr<Device<3>> device;
  DeviceSample<3> s;
  Eigen::Vector3d f = Eigen::Vector3d::Zero();
  bool acts = true;
};

TEST(Inverse3, PassesMotionAndForceWithinItsLimit) {
  auto service = std::make_unique<Inverse3Service>();
  auto rig = std::make_unique<Rig>(service->choice());
  EXPECT_EQ(rig->device->info().name, "Haply Inverse3 049D at 127.0.0.1:" + std::to_string(service->port()));
  EXPECT_TRUE(rig->until([&] { return rig->s.status == HardwareStatus::ok; }));
  EXPECT_EQ(rig->s.x.translation(), Eigen::Vector3d(0.0, -0.12, 0.15));
  rig->f = {0.0, 3.0, -1.0};
  EXPECT_TRUE(rig->until([&] { return service->push_n(1) == -3.0 && service->push_n(2) == 1.0; }));
  EXPECT_TRUE(rig->until([&] { return rig->s.applied.vec() == rig->f; })) << "booked when it has been answered";
  service->aim_m = 0.04;
  EXPECT_TRUE(rig->until([&] { return rig->s.v[0] > 0.05; }));
  EXPECT_TRUE(rig->until([&] { return std::abs(rig->s.x.translation()[0] - 0.04) < 1e-4; }));
  rig->f = {30.0, 40.0, 0.0};
  EXPECT_TRUE(rig->until([&] { return service->push_n(0) == -3.0 && service->push_n(1) == -4.0; }));
  EXPECT_TRUE(rig->until([&] { return (rig->s.applied.vec() - Eigen::Vector3d{3.0, 4.0, 0.0}).norm() < 1e-12; }));
  rig->f[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(rig->until([&] { return service->push_n(0) == 0.0 && service->push_n(1) == 0.0; }));
  rig->f = {0.0, 2.0, 0.0};
  EXPECT_TRUE(rig->until([&] { return service->push_n(1) == -2.0; }));
  rig.reset();
  EXPECT_EQ(service->told_n, 0.0) << "the last command of a program that ends";
}

TEST(Inverse3, LetsGoWhenItIsReleasedAndWhenNoCommandComes) {
  Inverse3Service service;
  Rig rig{service.choice()};
  rig.f = {0.0, 2.0, 0.0};
  EXPECT_TRUE(rig.until([&] { return service.push_n(1) == -2.0; }));
  rig.acts = false;
  rig.device->release();
  EXPECT_TRUE(rig.until([&] { return service.push_n(1) == 0.0; }));
  rig.acts = true;
  EXPECT_TRUE(rig.until([&] { return service.push_n(1) == -2.0; }));
  const long before = service.commands;
  rig.acts = false;
  EXPECT_TRUE(rig.until([&] { return service.push_n(1) == 0.0; }));
  EXPECT_GT(service.commands - before, 10) << "it was told so";
  EXPECT_EQ(rig.s.status, HardwareStatus::ok);
}

TEST(Inverse3, OfAServiceThatSaysMoreThanItIsAskedTheNewestCounts) {
  Inverse3Service service;
  Rig rig{service.choice()};
  service.answers = Answers::twice;
  EXPECT_TRUE(rig.until([&] { return service.commands > 500; }));
  service.aim_m = 0.2;
  // A reading from a queue of the others would be seconds old; one that is 0.1 s old is 0.01 m behind.
  EXPECT_TRUE(rig.until([&] {
    const double x_m = service.x_m;
    return x_m > 0.1 && x_m < 0.19 && std::abs(rig.s.x.translation()[0] - x_m) < 0.01;
  }));
}

// Position and velocity stay away; the force on the hand ends; and both come back.
void expect_release_and_return(Rig& rig, const std::function<void()>& fail, const std::function<void()>& mend,
                               const std::function<double()>& push) {
  rig.f = {0.0, 2.0, 0.0};
  ASSERT_TRUE(rig.until([&] { return push() == -2.0 && rig.s.applied[1] == 2.0; }));
  fail();
  int silent = 0;
  EXPECT_TRUE(rig.until([&] { return (silent = rig.s.status == HardwareStatus::stale ? silent + 1 : 0) > 250; }));
  EXPECT_EQ(rig.s.applied[1], 0.0);
  EXPECT_EQ(push(), 0.0);
  EXPECT_TRUE(all_finite(rig.s.x, rig.s.v));
  mend();
  EXPECT_TRUE(rig.until([&] { return rig.s.status == HardwareStatus::ok && push() == -2.0; }));
}

TEST(Inverse3, OfAServiceThatSaysNothingUsableIsReleasedUntilItDoes) {
  Inverse3Service service;
  Rig rig{service.choice()};
  for (const Answers how : {Answers::nothing, Answers::garbage, Answers::infinity, Answers::uncalibrated}) {
    SCOPED_TRACE(static_cast<int>(how));
    expect_release_and_return(
        rig, [&] { service.answers = how; }, [&] { service.answers = Answers::well; },
        [&] { return service.push_n(1); });
  }
}

TEST(Inverse3, OfAServiceThatDiesIsReleasedUntilItIsBack) {
  auto service = std::make_unique<Inverse3Service>();
  const std::uint16_t port = service->port();
  Rig rig{service->choice()};
  expect_release_and_return(
      rig, [&] { service.reset(); }, [&] { service = std::make_unique<Inverse3Service>(port); },
      [&] { return service ? service->push_n(1) : 0.0; });
}

TEST(Inverse3, IsRefusedInWords) {
  const auto words = [](const std::string& choice) -> std::string {
    try {
      Rig{choice};
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "";
  };
  for (const char* arguments : {"localhost", ":10001", "localhost:", "localhost:x", "localhost:65536"})
    EXPECT_NE(words(std::string{"inverse3:"} + arguments).find("ADDRESS:PORT of the service, as localhost:10001"),
              std::string::npos)
        << arguments;
  std::string choice;
  {
    const Inverse3Service service{0, false};
    choice = service.choice();
    EXPECT_EQ(words(choice), "--device " + choice + ": no calibrated Inverse3 is there; connect one and calibrate it");
  }
  EXPECT_EQ(words(choice),
            "--device " + choice +
                ": the Haply Inverse Service does not answer (Connection refused); start it, or give its ADDRESS:PORT");
  const Scene scene{};
  EXPECT_THROW(static_cast<void>(all_drivers().devices.open<6>(choice, scene, kPeriod)), ConfigError);
}

}  // namespace
}  // namespace twoport::inverse3_test
