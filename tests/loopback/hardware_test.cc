#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "master/program.h"
#include "slave/program.h"
#include "tests/support/live.h"

// The programs with other drivers than the simulated ones, called as functions; and the drivers by name.
namespace twoport::test::hardware_test {
namespace {

/// What a driver was asked, one letter a call: i info, s sense, a actuate, S start, r release.
struct Calls {
  std::string order;
  std::vector<double> energies_j;  ///< of the model's true port, at each reading
};
Calls calls;

/// The simulated device, whose arguments change what it says: "blind" (no truth), "fault=K", "stale=K" (at its Kth
/// reading, the first being 0), "loose=K" (nobody holds it from then on).
class Odd final : public Device<1> {
 public:
  explicit Odd(const DriverOptions& o)
      : model_{all_drivers().devices.open<1>("sim", o.scene, o.period)}, blind_{o.arguments == "blind"} {
    const std::size_t equals = o.arguments.find('=');
    if (equals == std::string::npos) return;
    loose_ = o.arguments.starts_with("loose");
    status_ = loose_                             ? HardwareStatus::ok
              : o.arguments.starts_with("fault") ? HardwareStatus::fault
                                                 : HardwareStatus::stale;
    odd_at_ = std::stoi(o.arguments.substr(equals + 1));
  }
  [[nodiscard]] DeviceInfo info() const override {
    calls.order += 'i';
    DeviceInfo info = model_->info();
    info.name = "odd device";
    return info;
  }
  DeviceSample<1> sense(const Tick<MasterClock>& tick) noexcept override {
    calls.order += 's';
    DeviceSample<1> sample = model_->sense(tick);
    calls.energies_j.push_back(model_->truth()->port_energy.si());
    if (readings_++ == odd_at_) sample.status = status_;
    sample.held = !loose_ || readings_ <= odd_at_;
    return sample;
  }
  void actuate(const Force<1>& f) noexcept override {
    calls.order += 'a';
    model_->actuate(f);
  }
  void start() noexcept override {
    calls.order += 'S';
    model_->start();
  }
  void release() noexcept override {
    calls.order += 'r';
    model_->release();
  }
  [[nodiscard]] const DeviceTruth<1>* truth() const noexcept override { return blind_ ? nullptr : model_->truth(); }

 private:
  std::unique_ptr<Device<1>> model_;
  bool blind_, loose_ = false;
  int readings_ = 0, odd_at_ = -1;
  HardwareStatus status_ = HardwareStatus::ok;
};

/// A robot without a force sensor.
class Numb final : public Robot<1> {
 public:
  explicit Numb(const DriverOptions&) {}
  [[nodiscard]] RobotInfo info() const override { return {.name = "numb robot", .has_force_sensor = false}; }
  RobotSample<1> sense(const Tick<SlaveClock>&) noexcept override { return {}; }
  void actuate(const RobotCommand<1>&) noexcept override {}
  void release() noexcept override {}
};

int run(int (*program)(int, char**, const Registry&), Words words) {
  Registry drivers = all_drivers();
  drivers.devices.add<Odd>("odd", "the simulated device, with a fault");
  drivers.robots.add<Numb>("numb", "no force sensor");
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  calls = {};
  calls.order.reserve(100000);
  calls.energies_j.reserve(100000);
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  return program(static_cast<int>(arguments.size()), arguments.data(), drivers);
}
struct Said {
  std::string out = testing::internal::GetCapturedStdout(), err = testing::internal::GetCapturedStderr();
};

struct Rendered {
  Folder folder;
  std::string scene = folder.write("scene.textproto", press(1, "RENDER"));
  int run(const std::string& device, const Words& more = {}) const {
    Words words{"twoport-master", "--scene",      scene,      "--set", "duration_s=0.5", "--no-realtime", "--no-spin",
                "--out",          folder / "out", "--device", device};
    words.insert(words.end(), more.begin(), more.end());
    return hardware_test::run(master_program, words);
  }
};

TEST(Hardware, IsAskedInOrderAndReleasedLast) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd"), 0);
  const Said said;
  EXPECT_NE(said.err.find("hardware: odd device"), std::string::npos) << said.err;
  // Read once before the loop; the scene starts; then a reading and a command each tick; released once, at the end.
  const std::string order = calls.order;
  ASSERT_GT(order.size(), 100u);
  EXPECT_EQ(order.find('S'), order.rfind('S'));
  EXPECT_EQ(order.find('r'), order.size() - 1);
  std::string ticks = order.substr(0, order.size() - 1);
  std::erase(ticks, 'i');
  EXPECT_EQ(ticks.substr(0, 4), "sSsa");
  for (std::size_t i = 2; i + 1 < ticks.size(); i += 2) ASSERT_EQ(ticks.substr(i, 2), "sa") << "call " << i;
}

TEST(Hardware, WithoutATruthIsBookedAsTheModelBooksIt) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd:blind", {"--set", "duration_s=1"}), 0);
  const Said said;
  const Trace trace{rendered.folder / "out/trace.csv"};
  const std::vector<double>& booked = trace["master_energy_j"];
  // The first reading comes before the first tick. Nine digits are written.
  ASSERT_EQ(booked.size() + 1, calls.energies_j.size());
  double largest = 0.0;
  for (std::size_t i = 0; i < booked.size(); ++i) {
    EXPECT_NEAR(booked[i], calls.energies_j[i + 1], 1e-9) << "tick " << i;
    largest = std::max(largest, std::abs(booked[i]));
  }
  EXPECT_GT(largest, 1e-4) << "nothing was put in: the scene says nothing";
  EXPECT_GT(trace.peak("master_f_0", 0.0, 1.0), 0.0);
}

TEST(Hardware, InAMountIsBookedAsTheModelBooksIt) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd:blind", {"--set", "duration_s=1", "--set", "device_mount.scale=2", "--set",
                                       "device_mount.position_m=[-0.01]"}),
            0);
  const Said said;
  const Trace trace{rendered.folder / "out/trace.csv"};
  const std::vector<double>&booked = trace["master_energy_j"], &x = trace["master_x_0"];
  ASSERT_EQ(booked.size() + 1, calls.energies_j.size());
  double largest = 0.0;
  for (std::size_t i = 0; i < booked.size(); ++i) {
    EXPECT_NEAR(booked[i], calls.energies_j[i + 1], 1e-9) << "tick " << i;
    largest = std::max(largest, std::abs(booked[i]));
  }
  EXPECT_GT(largest, 1e-4) << "nothing was put in: the scene says nothing";
  EXPECT_NEAR(x.front(), -0.01, 1e-6);
  EXPECT_GT(trace.peak("master_x_0", 0.0, 1.0), 0.02) << "the wall begins there";
}

TEST(Hardware, ThatReportsAFaultIsReleasedAndTheRunEndsInWords) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd:fault=100"), 1);
  const Said said;
  EXPECT_NE(said.err.find("twoport-master: hardware fault 0."), std::string::npos) << said.err;
  EXPECT_EQ(std::count(calls.order.begin(), calls.order.end(), 's'), 101);
  EXPECT_EQ(calls.order.find('r'), calls.order.size() - 1);
  const schema::Summary s = summary_in(rendered.folder / "out");
  EXPECT_FALSE(s.stable());
  EXPECT_NE(s.verdict().find("hardware fault"), std::string::npos) << s.verdict();
  EXPECT_EQ(Trace{rendered.folder / "out/trace.csv"}.rows(), s.steps());
}

TEST(Hardware, ThatReportsAFaultAtOnceIsNotRun) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd:fault=0"), 1);
  const Said said;
  EXPECT_NE(said.err.find("odd:fault=0: hardware fault at the first reading"), std::string::npos) << said.err;
  EXPECT_EQ(calls.order.find('a'), std::string::npos) << calls.order;
  EXPECT_EQ(std::count(calls.order.begin(), calls.order.end(), 'r'), 1) << calls.order;
}

// The scene presses the wall under FORCE_PROJECTED, and its hand pushes on: what the robot feels ends by its own rule.
TEST(Hardware, ThatNobodyHoldsLetsTheRobotGo) {
  Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=4"});
  EXPECT_EQ(
      run(master_program, {"twoport-master", "--scene", pair.scene, "--peer", pair.address(), "--set", "duration_s=3.2",
                           "--no-spin", "--out", pair.at("master"), "--device", "odd:loose=1500"}),
      0);
  const Said said;
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(count(said.err, "s: released: nobody holds the handle"), 1) << said.err;
  EXPECT_EQ(count(slave.err(), "s: released: nobody holds the handle"), 1) << slave.err();
  // Let go after 1.5 s; control.release_after_s is 1 s, and the way 10 ms. 0.3 s for what a busy machine is late.
  const Trace trace = pair.trace("slave");
  EXPECT_GT(trace.peak("slave_f_0", 1.0, 2.4), 1.0) << "it pressed";
  if (kept_time({pair.summary("master"), pair.summary("slave")})) {
    EXPECT_EQ(trace.peak("slave_f_0", 2.85, 3.1), 0.0);
    EXPECT_LT(trace.peak("env_f_0", 2.95, 3.1), 0.5) << "and leaves the wall";
  }
  EXPECT_EQ(summary_in(pair.at("master")).mode(), "let_go");
}

TEST(Hardware, WithNothingNewIsCountedAndSaid) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("odd:stale=50"), 0);
  EXPECT_NE(Said{}.err.find("no new reading in 1 ticks"), std::string::npos);
}

TEST(Hardware, WithoutAForceSensorIsRefusedWhereItsForceWouldComeBack) {
  const Folder folder;
  const std::string scene = folder.write("scene.textproto", press(1, "POSITION_MEASURED_FORCE"));
  EXPECT_EQ(run(slave_program, {"twoport-slave", "--scene", scene, "--robot", "numb"}), 2);
  {
    const Said said;
    EXPECT_NE(said.err.find("POSITION_MEASURED_FORCE, but the robot \"numb\" has no force sensor"), std::string::npos)
        << said.err;
  }
  const std::string model = folder.write("model.textproto", press(1, "POSITION_FORCE"));
  for (const std::string method : {"INTERNAL_MODEL", "MODEL_MEDIATED", "FOUR_CHANNEL"}) {
    EXPECT_EQ(run(slave_program, {"twoport-slave", "--scene", model, "--robot", "numb", "--set",
                                  "control.passivity.method=" + method}),
              2);
    const Said said;
    EXPECT_NE(said.err.find(method + ", but the robot \"numb\" has no force sensor"), std::string::npos) << said.err;
  }
}

TEST(Drivers, AreKnownByName) {
  const Rendered rendered;
  EXPECT_EQ(run(master_program, {"twoport-master", "--list-devices"}), 0);
  const Said said;
  EXPECT_EQ(said.out.find("sim\t"), 0u) << said.out;
  EXPECT_NE(said.out.find("\nodd\tthe simulated device, with a fault\n"), std::string::npos) << said.out;
  EXPECT_NE(said.out.find("\nPATH.so[:ARGS]\ta driver of your own"), std::string::npos) << said.out;
  EXPECT_EQ(said.err, "");

  EXPECT_EQ(run(slave_program, {"twoport-slave", "--list-devices"}), 0);
  EXPECT_NE(Said{}.out.find("\nnumb\tno force sensor\n"), std::string::npos);
}

TEST(Drivers, ThatAreNoneOrOfAnotherSizeAreRefusedInOneSentence) {
  const Rendered rendered;
  EXPECT_EQ(rendered.run("magic"), 2);
  {
    const Said said;
    EXPECT_EQ(said.err.find("twoport-master: --device magic: no driver has this name; it must be one of sim, page,"),
              0u)
        << said.err;
    EXPECT_NE(said.err.find(" odd, or PATH.so\n"), std::string::npos) << said.err;
  }
  EXPECT_EQ(rendered.run("sim:7"), 2);
  EXPECT_EQ(Said{}.err, "twoport-master: --device sim:7: sim takes no arguments; the scene describes the model\n");
  const Folder folder;
  const std::string three = folder.write("scene.textproto", press(3, "RENDER"));
  EXPECT_EQ(run(master_program, {"twoport-master", "--scene", three, "--device", "odd"}), 2);
  EXPECT_EQ(Said{}.err, "twoport-master: --device odd: drives dof 1, but dof of the scene is 3\n");
}

}  // namespace
}  // namespace twoport::test::hardware_test
