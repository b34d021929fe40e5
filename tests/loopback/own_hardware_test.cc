#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "tests/support/live.h"

// Hardware as people own it, two programs over UDP: a device with fewer motors than axes, a force sensor that drifts.
namespace twoport::test::own_hardware_test {
namespace {

/// Six axes before a wall that touches 30 mm beside the tool: it turns what presses it.
std::string press_beside() {
  return press(6) + "tool { contact_point { position_m: [0, 0.03, 0] } }\n";
}

/// Force along the axes with motors is displayed, within the claim; torque is not, which log and summary say.
TEST(OwnHardware, ADeviceWithThreeMotorsDisplaysTheForceAndSaysWhichTorqueItCannot) {
  for (const std::string method : {"FORCE_PROJECTED", "INTERNAL_MODEL"}) {
    const Pair pair{press_beside()};
    const Words longer{"--set", "duration_s=3", "--set", "control.passivity.method=" + method};
    Process slave = pair.listening_slave("slave", longer);
    Words with_device = longer;
    with_device.insert(with_device.end(), {"--device", TWOPORT_WRIST_PLUGIN});
    Process master = pair.master("master", with_device);
    EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
    slave.wait();
    EXPECT_NE(master.err().find("the device has no motor along the axes 3, 4, 5"), std::string::npos) << master.err();
    const schema::Summary m = pair.summary("master");
    EXPECT_EQ(m.axes_without_motor(), "3, 4, 5");
    EXPECT_GT(m.not_displayed_max_n_m(), 0.01) << method;
    EXPECT_EQ(m.claim().rfind("hand", 0), 0U) << m.claim();
    if (!kept_time({m, pair.summary("slave")})) continue;
    EXPECT_GE(m.hand_min_energy_j(), -m.initial_energy_j() - 1e-4) << method;
    const Trace trace = pair.trace("master");
    EXPECT_GT(trace.peak("master_f_0", 0.0, 3.0), 1.0) << method;
    for (const char* torque : {"master_f_3", "master_f_4", "master_f_5"})
      EXPECT_EQ(trace.peak(torque, 0.0, 3.0), 0.0) << method;
    // The same energy from the trace alone: what the hand has done along the three axes with motors.
    double into_j = 0.0, least_j = 0.0;
    for (std::size_t k = 1; k < trace.rows(); ++k) {
      for (const std::string axis : {"0", "1", "2"})
        into_j += trace["master_f_" + axis][k - 1] * (trace["master_x_" + axis][k] - trace["master_x_" + axis][k - 1]);
      least_j = std::min(least_j, into_j);
    }
    EXPECT_GE(least_j, -m.initial_energy_j() - 1e-4) << method;
  }
}

/// Typed at the slave's terminal, and at the master's, which asks the slave; under a press the slave refuses.
TEST(OwnHardware, AForceSensorIsZeroedFromEitherTerminalAndNotUnderAPress) {
  std::string text = press();
  const std::string sensor = "force_sensor { }";
  ASSERT_NE(text.find(sensor), std::string::npos) << text;
  text.replace(text.find(sensor), sensor.size(), "force_sensor { bias_n: [0.8] }");
  const std::string hold = "hold { duration_s: 0.2 }";
  text.replace(text.find(hold), hold.size(), "hold { duration_s: 8 }");
  const Pair pair{text};
  const Words longer{"--set", "duration_s=14", "--set", "control.passivity.method=INTERNAL_MODEL"};
  Process slave = pair.listening_slave("slave", longer, {.terminal = true});
  Process master = pair.master("master", longer, {.terminal = true});
  EXPECT_TRUE(slave.says("the force sensor reads 0.80 N while nothing is pressed")) << slave.err();
  master.type("z\n");
  EXPECT_TRUE(master.says("the force sensor is zeroed")) << master.err();
  EXPECT_TRUE(slave.says("the force sensor is zeroed: 0.80 N are taken away")) << slave.err();
  slave.type("z\n");
  EXPECT_TRUE(comes_true([&] { return count(slave.err(), "the force sensor is zeroed") == 2; })) << slave.err();
  pair.await("slave", 11.0);
  master.type("z\n");
  EXPECT_TRUE(master.says("the force sensor is not zeroed: the coupling presses with more than 0.3 N")) << master.err();
  slave.type("y\nzz\n");
  EXPECT_EQ(master.wait(), Exit{.status = 0}) << master.err();
  slave.wait();
  const schema::Summary s = pair.summary("slave");
  EXPECT_EQ(s.sensor_zeroed(), 2U);
  EXPECT_EQ(s.sensor_zero_refused(), 1U);
  EXPECT_LT(s.sensor_drift_n(), 0.05);
  const Trace trace = pair.trace("master");
  EXPECT_NEAR(trace["env_f_0"].back(), trace["slave_f_0"].back() * -1.0, 0.3) << "the press itself is felt as it was";
}

}  // namespace
}  // namespace twoport::test::own_hardware_test
