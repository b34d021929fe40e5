#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "docs/examples/own_hardware/vendor.h"
#include "tests/loopback/ros2_side.h"

// Stands in for a robot behind ROS 2, at 1 kHz: 0.5 kg with 2 N s/m, free in x, y and z, and a wall of 5000 N/m and 20 N s/m from x = 20 mm on.
//
//   ros2_stand_in PREFIX DOMAIN [SECONDS [nan]]    after SECONDS it ends, or sends positions that are no numbers
//   ros2_stand_in PREFIX DOMAIN echo               sends each command's force back as the position, at once
//   ros2_stand_in PREFIX DOMAIN leader|follower    an arm, joint by joint: that of docs/examples/plugin, whose joints are q1, q2 and q3. The
//                                                  hand begins to move when commands come
using namespace twoport::test;
using namespace std::chrono_literals;
using std::chrono::steady_clock;

namespace {

std::atomic<bool> given{false};  ///< a command has come

/// In the thread of DDS that has received it.
void echo(dds_entity_t, void* side) {
  Seven n;
  auto& ros = *static_cast<Ros2Side*>(side);
  if (!ros.take("command", n)) return;
  given = true;
  ros.publish("pose", {n[0], n[1], n[2], 0.0, 0.0, 0.0, 1.0});
}

[[noreturn]] void run_arm(JointSide& ros, bool in_hand) {
  Scara arm{in_hand};
  JointSide::State command;
  int commands = 0;
  auto next = steady_clock::now(), heard = next;
  for (;; std::this_thread::sleep_until(next += 1ms)) {
    const auto now = steady_clock::now();
    if (ros.take(command)) {
      heard = now;
      if (++commands == 100) arm = Scara{in_hand};
    }
    if (now - heard > 100ms) command.effort.assign(3, 0.0);
    if (command.effort.size() == 3) arm.drive(command.effort.data());
    const Scara::Reading r = commands >= 100 ? arm.read() : Scara::Reading{};
    const auto list = [](const double* from) { return std::vector<double>(from, from + 3); };
    ros.publish("joint_states", {{"q1", "q2", "q3"}, list(r.q), list(r.v), list(r.motor)});
    ros.publish("external_effort", {{"q1", "q2", "q3"}, {}, {}, list(r.outside)});
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr
        << "usage: ros2_stand_in PREFIX DOMAIN [SECONDS [nan]] | PREFIX DOMAIN echo | PREFIX DOMAIN leader|follower\n";
    return 2;
  }
  const std::string how = argc > 3 ? argv[3] : "";
  if (how == "leader" || how == "follower") {
    JointSide arm{argv[1], static_cast<std::uint32_t>(std::atoi(argv[2]))};
    run_arm(arm, how == "leader");
  }
  const bool echoes = how == "echo", nan = argc > 4;
  const double seconds = how.empty() || echoes ? 1e9 : std::stod(how);
  Ros2Side ros{argv[1], static_cast<std::uint32_t>(std::atoi(argv[2]))};
  if (echoes) {
    dds_listener_t* listener = dds_create_listener(&ros);
    dds_lset_data_available(listener, echo);
    dds_set_listener(ros.reader("command"), listener);
    dds_delete_listener(listener);
  }
  constexpr double kMass = 0.5, kDamping = 2.0, kWall = 0.02, kStep = 1e-4;
  std::array<double, 3> x{}, v{};
  Seven command{}, contact{};
  const auto begun = steady_clock::now();
  auto next = begun, heard = begun;
  for (;; std::this_thread::sleep_until(next += 1ms)) {
    const auto now = steady_clock::now();
    const bool over = std::chrono::duration<double>(now - begun).count() > seconds;
    if (over && !nan) return 0;
    if (echoes) {
      // Its position comes with the commands.
      if (!given) ros.publish("pose", {0, 0, 0, 0, 0, 0, 1});
    } else {
      if (ros.take("command", command)) {
        given = true;
        heard = now;
      }
      if (given && now - heard > 100ms) command = {};
      for (int k = 0; k < 10; ++k) {
        contact[0] = x[0] > kWall ? std::min(0.0, -5000.0 * (x[0] - kWall) - 20.0 * v[0]) : 0.0;
        for (std::size_t i = 0; i < 3; ++i) {
          v[i] = (v[i] + kStep / kMass * (command[i] + contact[i])) / (1.0 + kStep * kDamping / kMass);
          x[i] += kStep * v[i];
        }
      }
      ros.publish("pose", {over ? std::nan("") : x[0], x[1], x[2], 0.0, 0.0, 0.0, 1.0});
    }
    ros.publish("twist", {v[0], v[1], v[2], 0.0, 0.0, 0.0, 0.0});
    ros.publish("wrench", contact);
  }
}
