#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/thread.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "drivers/dynamixel_protocol.h"
#include "tests/support/dynamixel_servos.h"
#include "tests/support/folder.h"

namespace twoport::dynamixel_test {
namespace {

using namespace dynamixel;
using test::DynamixelServos, test::PlacedLoad, test::TouchingArm;
using Axes = DynamixelServos::Axes;
using Hex = std::vector<std::uint8_t>;
constexpr double kPi = std::numbers::pi;

Hex hex(const Message& m) {
  const Packet packet{m};
  return {packet.bytes().begin(), packet.bytes().end()};
}
std::optional<Message> only(const Hex& bytes) {
  PacketReader reader;
  reader.add(bytes);
  const auto m = reader.next();
  return reader.next() ? std::nullopt : m;
}

// The examples of the protocol's document.
TEST(DynamixelPacket, HasTheBytesOfTheDocument) {
  EXPECT_EQ(hex({.id = 1, .instruction = Instruction::ping}),
            (Hex{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x03, 0x00, 0x01, 0x19, 0x4E}));
  EXPECT_EQ(hex(Message{.id = 1, .instruction = Instruction::read}.add(132, 2).add(4, 2)),
            (Hex{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x07, 0x00, 0x02, 0x84, 0x00, 0x04, 0x00, 0x1D, 0x15}));
  const auto status = only({0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x08, 0x00, 0x55, 0x00, 0xA6, 0x00, 0x00, 0x00, 0x8C, 0xC0});
  ASSERT_TRUE(status);
  EXPECT_EQ(status->id, 1);
  EXPECT_EQ(status->instruction, Instruction::status);
  EXPECT_EQ(status->at(0, 1), 0u);
  EXPECT_EQ(status->at(1, 4), 166u);
}

TEST(DynamixelPacket, StuffsWhatLooksLikeAHeader) {
  const Message m = Message{.id = 1, .instruction = Instruction::write}
                        .add(102, 2)
                        .add(0x00FDFFFF, 4)
                        .add(0xFDFFFFFD, 4)
                        .add(0xFDFD, 2);
  const Hex bytes = hex(m);
  EXPECT_EQ(bytes.size(), 7u + 1u + 12u + 2u + 2u);
  EXPECT_EQ(bytes[5], 1 + 12 + 2 + 2) << "the length has them too";
  const Hex from_address{bytes.begin() + 10, bytes.begin() + 16};
  EXPECT_EQ(from_address, (Hex{0xFF, 0xFF, 0xFD, 0xFD, 0x00, 0xFD}));
  const auto read = only(bytes);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->size, m.size);
  EXPECT_EQ(read->parameters, m.parameters);
}

TEST(DynamixelPacket, IsReadFromPiecesAndBehindGarbageAndNotWhenDamaged) {
  const Hex bytes = hex(Message{.id = 7}.add(0, 1).add(0x12345678, 4));
  PacketReader reader;
  reader.add(Hex{0x00, 0xFF, 0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x02});  // a header whose length is none
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    EXPECT_FALSE(reader.next());
    reader.add({&bytes[i], 1});
  }
  const auto m = reader.next();
  ASSERT_TRUE(m);
  EXPECT_EQ(m->at(1, 4), 0x12345678u);
  for (std::size_t i = 0; i < bytes.size(); ++i)
    for (int bit = 0; bit < 8; ++bit) {
      Hex damaged = bytes;
      damaged[i] = static_cast<std::uint8_t>(damaged[i] ^ 1 << bit);
      EXPECT_FALSE(only(damaged)) << "byte " << i << " bit " << bit;
    }
}

TEST(DynamixelPacket, OfRandomMessagesComesBackAndRandomBytesDoNoHarm) {
  std::mt19937 random{5};
  const auto byte = [&] {
    return static_cast<std::uint8_t>(random() % 3 == 0 ? 0xFF : random() % 3 == 0 ? 0xFD : random() % 256);
  };
  PacketReader reader;
  for (int k = 0; k < 20'000; ++k) {
    Message m{.id = static_cast<std::uint8_t>(random() % 253)};
    for (std::size_t n = random() % 60; n > 0; --n) m.add(byte(), 1);
    const auto back = only(hex(m));
    ASSERT_TRUE(back);
    ASSERT_EQ(back->parameters, m.parameters);
    Hex noise(random() % 300);
    for (auto& each : noise) each = static_cast<std::uint8_t>(byte());
    reader.add(noise);
    while (reader.next()) {
    }
  }
}

std::string example(const std::string& name) {
  return std::string{TWOPORT_EXAMPLES} + "/dynamixel/" + name;
}
Scene scene_of_example(const std::vector<std::string>& overrides = {}) {
  return load_scene(example("scene.textproto"), overrides, SceneFor::live);
}
const std::string kServos = ",servos=" + example("servos.textproto");
std::vector<ServoMount> mounts() {
  return load_servos(example("servos.textproto"), 6);
}

/// The driver, whose loop is that of a test: 400 ticks a second.
template <template <int> class Side>
struct Rig {
  explicit Rig(const std::string& port, Scene of = scene_of_example()) : scene{std::move(of)} {
    const Seconds period{1.0 / 400.0};
    if constexpr (std::is_same_v<Side<kJointPort>, Device<kJointPort>>)
      side = all_drivers().devices.open<kJointPort>("dynamixel:" + port, scene, period);
    else
      side = all_drivers().robots.open<kJointPort>("dynamixel:" + port, scene, period);
  }
  /// Ticks until `holds`, for `seconds` at most.
  bool until(const std::function<bool()>& holds, double seconds = 5.0) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>{seconds};
    while (std::chrono::steady_clock::now() < end) {
      s = side->sense({});
      fresh += s.status == HardwareStatus::ok ? 1 : 0;
      if (holds()) return true;
      if (acts) side->actuate(command());
      std::this_thread::sleep_for(std::chrono::microseconds{2500});
    }
    return false;
  }
  void pass(double seconds) {
    until([] { return false; }, seconds);
  }
  auto command() const {
    if constexpr (std::is_same_v<Side<kJointPort>, Device<kJointPort>>)
      return Force<kJointPort>{f};
    else
      return RobotCommand<kJointPort>{Force<kJointPort>{f}, {}, {}};
  }
  Scene scene;
  std::unique_ptr<Side<kJointPort>> side;
  decltype(std::declval<Side<kJointPort>&>().sense({})) s;
  Axes f = Axes::Zero();
  bool acts = true;
  int fresh = 0;
};
using Leader = Rig<Device>;
using Follower = Rig<Robot>;

void place(PlacedLoad& load, const std::vector<double>& q) {
  for (std::size_t i = 0; i < q.size(); ++i) load.at[i] = q[i];
}
const std::vector<double> kReady{0.0, -0.5, 1.9, -0.6, 0.0, 0.0};
/// Servos that stand at the ready position, and their driver.
template <class Side>
struct Ready {
  Ready() {
    place(load, kReady);
    servos.start();
    rig = std::make_unique<Side>(servos.port() + kServos);
  }
  PlacedLoad load;
  DynamixelServos servos{mounts(), load};
  std::unique_ptr<Side> rig;
};

/// Of the arm's weight [N m].
Axes weight(const Scene& scene, const std::vector<double>& q) {
  const ArmModel model{*scene.device->arm->parameters};
  Axes g = Axes::Zero();
  g.head(6) = model.gravity_torque(model.pose(joint_vector(q)), {0.0, 0.0, -9.81});
  return g;
}

TEST(Dynamixel, PassesMotionAndTorqueWithinTheServosLimit) {
  PlacedLoad load;
  place(load, kReady);
  DynamixelServos servos{mounts(), load};
  servos.put(4, kCurrentLimit, 300);
  servos.start();
  Leader rig{servos.port() + kServos};
  const DeviceInfo info = rig.side->info();
  EXPECT_NE(info.name.find("6 Dynamixel servos XL330-M288 at " + servos.port()), std::string::npos) << info.name;
  EXPECT_NEAR(info.limits.joints.effort[0], 1.75 * 0.354, 1e-12);
  EXPECT_NEAR(info.limits.joints.effort[4], 0.3 * 0.354, 1e-12);
  EXPECT_TRUE(std::isinf(info.limits.joints.effort[6]));
  EXPECT_TRUE(rig.until([&] { return servos.on && rig.fresh > 10; }));
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(rig.s.x.translation()[i], kReady[static_cast<std::size_t>(i)], 1e-3) << i;
  EXPECT_EQ(rig.s.v.vec().norm(), 0.0);
  // The axes without weight: 5 turns against its joint.
  rig.f << 0.1, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0;
  EXPECT_TRUE(rig.until([&] { return servos.current[0] == -282 && servos.current[4] == 141; }))
      << servos.current[0] << ' ' << servos.current[4];
  EXPECT_TRUE(rig.until([&] { return std::abs(rig.s.applied.vec()[0] - 282 * 0.354e-3) < 1e-9; }))
      << "in whole steps of the current";
  EXPECT_TRUE(rig.until([&] { return std::abs(rig.s.applied.vec()[4] - 141 * 0.354e-3) < 1e-9; }));
  rig.f[4] = 0.5;
  EXPECT_TRUE(rig.until([&] { return servos.current[4] == 300; }));
  EXPECT_TRUE(rig.until([&] { return std::abs(rig.s.applied.vec()[4] - 300 * 0.354e-3) < 1e-9; }))
      << "what is beyond the limit is not booked";
  rig.f[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(rig.until([&] { return servos.current[0] == 0 && servos.current[4] == 0; }));
  place(load, {0.3, -0.5, 1.9, -0.6, -0.2, 0.0});
  EXPECT_TRUE(rig.until([&] { return rig.s.v.vec()[0] > 0.5 && rig.s.v.vec()[4] < -0.3; }));
  EXPECT_TRUE(rig.until([&] {
    return std::abs(rig.s.x.translation()[0] - 0.3) < 1e-3 && std::abs(rig.s.x.translation()[4] + 0.2) < 1e-3;
  }));
  rig.side.reset();
  for (int i = 0; i < 200 && servos.on; ++i) std::this_thread::sleep_for(std::chrono::milliseconds{5});
  EXPECT_FALSE(servos.on) << "the motors of a program that has ended";
}

/// Motors push an arm that does not move.
TEST(Dynamixel, ObservesWhatTouchesAFollower) {
  Ready<Follower> ready;
  Follower& rig = *ready.rig;
  EXPECT_TRUE(rig.side->info().has_force_sensor);
  rig.pass(0.2);
  EXPECT_NEAR(rig.s.f_environment.vec().norm(), 0.0, 1e-3);
  rig.f << 0.1, 0.0, 0.0, 0.0, -0.05, 0.0, 0.0, 0.0;
  rig.pass(0.3);
  EXPECT_NEAR(rig.s.f_environment.vec()[0], 0.1, 3e-3) << "of the robot on the environment";
  EXPECT_NEAR(rig.s.f_environment.vec()[4], -0.05, 3e-3);
  EXPECT_NEAR(rig.s.f_environment.vec()[2], 0.0, 1e-3) << "its weight is none";
}

TEST(Dynamixel, CountsTurnsOfServosThatDoNot) {
  PlacedLoad load;
  place(load, {3.0 - kPi, -0.5, 1.9, -0.6, 0.0, 2.9});
  auto odd = mounts();
  odd[5].zero_rad = -2.5;  // its reading passes from 0 to 4095
  DynamixelServos servos{odd, load};
  servos.counts_turns = false;
  servos.start();
  test::Folder folder;
  std::string file;
  for (const ServoMount& m : odd)
    file += "servo { id: " + std::to_string(m.id) + (m.reversed ? " reversed: true" : "") +
            " zero_rad: " + std::to_string(m.zero_rad) + " }\n";
  write_whole(folder / "servos.textproto", file);
  Follower rig{servos.port() + ",servos=" + (folder / "servos.textproto")};
  for (double q = 2.9; q > -2.9; q -= 0.02) {
    load.at[5] = q;
    ASSERT_TRUE(rig.until([&] { return std::abs(rig.s.x.translation()[5] - q) < 2e-3; }))
        << q << ", read " << rig.s.x.translation()[5];
  }
}

TEST(Dynamixel, CarriesTheWeightAndMostOfTheFriction) {
  Ready<Leader> ready;
  DynamixelServos& servos = ready.servos;
  Leader& rig = *ready.rig;
  rig.side->release();
  const Axes g = weight(rig.scene, kReady);
  rig.acts = false;
  const auto carries = [&] {
    bool all = true;
    for (std::size_t i = 0; i < 6; ++i) {
      const double sign = mounts()[i].reversed ? -1.0 : 1.0;
      all = all && std::abs(sign * servos.current[i] * 0.354e-3 - g[static_cast<Eigen::Index>(i)]) < 1e-3;
    }
    return all;
  };
  EXPECT_TRUE(rig.until(carries)) << "released, and without commands";
  EXPECT_LT(std::abs(servos.current[2]), 600);
  EXPECT_NEAR(rig.s.applied.vec().norm(), 0.0, 1e-3) << "neither is booked";
  // 0.03 N m of the URDF.
  for (int k = 0; k < 400 && servos.current[0] < 55; ++k) {
    ready.load.at[0] = ready.load.at[0] + 0.001;
    rig.pass(0.003);
  }
  EXPECT_NEAR(servos.current[0] * 0.354e-3, 0.7 * 0.03, 2e-3);
  EXPECT_NEAR(rig.s.applied.vec()[0], 0.0, 1e-3);
}

/// By its servos a follower that hangs in the air stays where it is, and falls without them.
TEST(Dynamixel, HoldsAnArmWithoutFriction) {
  const Scene scene = scene_of_example({"robot.arm.joint_coulomb_friction_n_m=[0,0,0,0,0,0]"});
  TouchingArm arm{scene};
  DynamixelServos servos{mounts(), arm};
  servos.start();
  auto rig = std::make_unique<Follower>(servos.port() + kServos, scene);
  rig->pass(DynamixelServos::kHeld + 0.8);
  const Axes settled = rig->s.x.translation();
  rig->pass(1.0);
  // In whole steps of the current a rest of 0.2 mN m remains, which its damping brakes.
  EXPECT_LT((rig->s.x.translation() - settled).norm(), 0.05);
  rig.reset();
  const auto falls = [&] { return (arm.q() - settled).norm() > 0.2; };
  for (int k = 0; k < 100 && !falls(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds{100});
  EXPECT_TRUE(falls());
}

/// True as soon as it is in one of ten trials: a stand-in that is late is one that does not answer.
bool once_of_ten(const std::function<bool(Ready<Leader>&)>& holds) {
  for (int trial = 0; trial < 10; ++trial)
    if (Ready<Leader> ready; holds(ready)) return true;
  return false;
}

TEST(Dynamixel, GoesOnThroughDamagedAndHalfPacketsAndEchoes) {
  struct Way {
    const char* name;
    std::function<void(DynamixelServos&)> set;
  };
  const std::vector<Way> ways{{"every 20th answer damaged", [](DynamixelServos& s) { s.damages_every = 20; }},
                              {"halves", [](DynamixelServos& s) { s.halves = true; }},
                              {"garbage before each answer", [](DynamixelServos& s) { s.noisy = true; }},
                              {"echoes", [](DynamixelServos& s) { s.echoes = true; }}};
  for (const Way& way : ways)
    EXPECT_TRUE(once_of_ten([&](Ready<Leader>& r) {
      way.set(r.servos);
      r.rig->fresh = 0;
      r.rig->pass(0.3);
      return r.rig->s.status != HardwareStatus::fault && r.rig->fresh > 20 &&
             std::abs(r.rig->s.x.translation()[2] - 1.9) < 1e-3;
    })) << way.name;
}

/// Within 10 ms of the last answer of a servo all others have no current.
TEST(Dynamixel, OfAnUnpluggedServoReleasesAllWithin10ms) {
  EXPECT_TRUE(once_of_ten([](Ready<Leader>& r) {
    r.rig->f[0] = -0.1;
    r.rig->until([&] { return r.servos.current[0] > 200 || r.rig->s.status == HardwareStatus::fault; });
    r.servos.unplugged = 4;
    EXPECT_TRUE(r.rig->until([&] { return r.servos.released_s >= 0.0; }));
    EXPECT_TRUE(r.rig->until([&] { return r.rig->s.status == HardwareStatus::fault && !r.servos.on; }));
    r.rig->pass(0.05);
    EXPECT_EQ(r.servos.current[0], 0) << "for good, whatever is commanded";
    std::printf("released after %.1f ms\n", 1e3 * r.servos.released_s);
    return r.servos.released_s > 0.004 && r.servos.released_s < 0.010 &&
           r.rig->side->trouble() == "servo 4 does not answer; all are released";
  }));
}

/// Mode, torque and watchdog are written to each with an answer.
TEST(Dynamixel, IsOnAndWatchedThoughAPacketIsLost) {
  for (const Item& item : {kTorqueEnable, kBusWatchdog}) {
    PlacedLoad load;
    place(load, kReady);
    DynamixelServos servos{mounts(), load};
    servos.lost = item.address;
    servos.start();
    Leader rig{servos.port() + kServos + ",silence_ms=100"};
    EXPECT_EQ(servos.lost, 0);
    EXPECT_TRUE(servos.on && servos.watched) << item.address;
  }
}

TEST(Dynamixel, OfAServoThatRestartsReleasesAll) {
  Ready<Follower> ready;
  DynamixelServos& servos = ready.servos;
  Follower& rig = *ready.rig;
  rig.f[0] = 0.1;
  ASSERT_TRUE(rig.until([&] { return servos.current[0] > 200; }));
  servos.restarted = 5;
  ASSERT_TRUE(rig.until([&] { return rig.s.status == HardwareStatus::fault; }, 0.5));
  EXPECT_EQ(rig.side->trouble(),
            "servo 5 has switched its torque off: it has restarted, or its supply is too weak; all are released");
  EXPECT_TRUE(rig.until([&] { return servos.current[0] == 0 && !servos.on; }));
}

TEST(Dynamixel, OfAHotServoAndAnErrorOfItsHardwareReleasesAll) {
  for (const bool hot : {true, false}) {
    Ready<Follower> ready;
    DynamixelServos& servos = ready.servos;
    Follower& rig = *ready.rig;
    rig.f[0] = 0.1;
    ASSERT_TRUE(rig.until([&] { return servos.current[0] > 200; }));
    (hot ? servos.hot : servos.broken) = 3;
    ASSERT_TRUE(rig.until([&] { return rig.s.status == HardwareStatus::fault; }));
    EXPECT_EQ(rig.side->trouble(), hot ? "servo 3 is at 66 deg C, and it stops by itself at 70; all are released"
                                       : "servo 3 reports overload; all are released");
    EXPECT_TRUE(rig.until([&] { return servos.current[0] == 0 && !servos.on; }));
  }
}

TEST(Dynamixel, WithoutCommandsOfTheControlPushesNoMore) {
  Ready<Leader> ready;
  DynamixelServos& servos = ready.servos;
  Leader& rig = *ready.rig;
  rig.f[0] = -0.1;
  ASSERT_TRUE(rig.until([&] { return servos.current[0] > 200; }));
  std::this_thread::sleep_for(std::chrono::milliseconds{300});
  EXPECT_EQ(servos.current[0], 0);
  EXPECT_TRUE(servos.on);
}

TEST(Dynamixel, TakesMicrosecondsOfAControlStep) {
  Ready<Leader> ready;
  Leader& rig = *ready.rig;
  std::chrono::nanoseconds taken{};
  constexpr int kTicks = 400;
  for (int k = 0; k < kTicks; ++k) {
    const auto begun = ThreadClock::now();
    rig.s = rig.side->sense({});
    rig.side->actuate(Force<kJointPort>{rig.f});
    taken += ThreadClock::now() - begun;
    std::this_thread::sleep_for(std::chrono::microseconds{2500});
  }
  const double us = 1e-3 * static_cast<double>(taken.count()) / kTicks;
  std::printf("sense() and actuate(): %.1f us\n", us);
  EXPECT_LT(us, 100.0);
}

TEST(Dynamixel, RefusesWhatItCannotDrive) {
  PlacedLoad load;
  place(load, kReady);
  auto with = [&](const std::function<void(DynamixelServos&)>& change, std::vector<ServoMount> of = mounts()) {
    auto servos = std::make_unique<DynamixelServos>(std::move(of), load);
    change(*servos);
    servos->start();
    return servos;
  };
  const auto refused = [&](const std::string& arguments, const std::string& words) {
    try {
      Leader rig{arguments};
      ADD_FAILURE() << arguments << " is taken";
    } catch (const ConfigError& e) {
      EXPECT_NE(std::string{e.what()}.find("--device dynamixel:" + arguments + ": " + words), std::string::npos)
          << e.what();
    }
  };
  refused("",
          "ARGS is PORT[,baud=N][,servos=FILE][,silence_ms=N], as in dynamixel:/dev/ttyUSB0,servos=leader.textproto");
  refused("/dev/null,baud=9600", "baud must be 57600, 115200, 1000000, 2000000, 3000000 or 4000000");
  refused("/dev/null", "it is no serial port");
  refused("/no/port", "the port cannot be opened (No such file or directory)");
  for (const std::string ms : {"0", "201", "500"})
    refused("/dev/null,silence_ms=" + ms,
            "silence_ms is " + ms +
                "; it must be from 1 to 200: a servo that restarts is silent for longer, and comes "
                "back without torque");
  for (const Item& item : {kTorqueEnable, kBusWatchdog}) {
    const auto servos = with([&](DynamixelServos& s) { s.refused = item.address; });
    refused(servos->port() + kServos, "servo 3 does not take " + std::string{item.address == 64 ? "1" : "5"} +
                                          " at address " + std::to_string(item.address));
    for (int i = 0; i < 200 && servos->on; ++i) std::this_thread::sleep_for(std::chrono::milliseconds{5});
    EXPECT_FALSE(servos->on);
  }
  auto of = mounts();
  of[3].id = 14;
  {
    const auto servos = with([](DynamixelServos&) {}, of);
    refused(servos->port() + kServos, "no servo 4 answers at 1000000 baud; is it powered, has it this id and rate?");
  }
  {
    const auto servos = with([](DynamixelServos& s) { s.put(1, {0, 2}, 1060); });
    refused(servos->port() + kServos, "servo 2 is of model 1060; it must be one with current control: XM430-W350, ");
  }
  {
    const auto servos = with([](DynamixelServos& s) { s.put(5, kHardwareError, 0x24); });
    refused(servos->port() + kServos, "servo 6 reports overheating and overload; switch its power off and on");
  }
  {
    place(load, {0.0, -0.5, -2.9, -0.6, 0.0, 0.0});
    const auto servos = with([](DynamixelServos&) {});
    refused(servos->port() + kServos, "joint 3 is at -2.9");
    place(load, kReady);
  }
}

TEST(Dynamixel, ReadsAFileOfServos) {
  test::Folder folder;
  const auto refused = [&](const std::string& text, const std::string& words) {
    write_whole(folder / "servos.textproto", text);
    try {
      load_servos(folder / "servos.textproto", 2);
      ADD_FAILURE() << text << " is taken";
    } catch (const ConfigError& e) {
      EXPECT_NE(std::string{e.what()}.find(words), std::string::npos) << e.what();
    }
  };
  refused("servo { id: 1 }", "servo is given 1 times; the arm has 2 joints, in whose order they stand");
  refused("servo { id: 1 } servo { id: 1 }",
          "servo[1].id is 1; it must be another one: two servos of a bus with one id answer at once");
  refused("servo { id: 1 } servo { id: 253 }", "servo[1].id is 253; it must be between 0 and 252");
  refused("servo { id: 1 } servo { }", "servo[1].id");
  refused("servo { id: 1 } servo { id: 2 torque_per_current_n_m_per_a: 0 }",
          "torque_per_current_n_m_per_a is 0; it must be > 0");
  refused("servo { id: 1 } servo { id: 2 zero: 1 }", "zero");
  write_whole(folder / "servos.textproto",
              "servo { id: 3 reversed: true } servo { id: 2 zero_rad: 1.5 torque_per_current_n_m_per_a: 0.4 }");
  const auto servos = load_servos(folder / "servos.textproto", 2);
  ASSERT_EQ(servos.size(), 2u);
  EXPECT_EQ(servos[0].id, 3);
  EXPECT_TRUE(servos[0].reversed);
  EXPECT_EQ(servos[0].zero_rad, kPi);
  EXPECT_EQ(servos[1].zero_rad, 1.5);
  EXPECT_EQ(servos[1].torque_per_current_n_m_per_a, 0.4);
}

}  // namespace
}  // namespace twoport::dynamixel_test
