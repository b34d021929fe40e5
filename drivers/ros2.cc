#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdlib>
#include <memory>
#include <optional>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "common/arm/parameters.h"
#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "common/scene/scene.h"
#include "drivers/ros2_node.h"

namespace twoport {
namespace {

using ros2::JointNumbers, ros2::JointTopics, ros2::Node, ros2::Numbers, ros2::ToolTopics;

/// PREFIX[,domain=N][,joints=NAME:...]; without a domain that of ROS_DOMAIN_ID, else 0.
struct Choice {
  Choice(const std::string& flag, const std::string& text) : words{flag + " ros2:" + text} {
    const char* of_ros = std::getenv("ROS_DOMAIN_ID");
    std::string whole = text;
    if (text.find(",domain=") == text.npos) {
      whole.insert(std::min(text.find(','), text.size()), std::string{",domain="} + (of_ros && *of_ros ? of_ros : "0"));
      words += of_ros && *of_ros ? std::string{" with ROS_DOMAIN_ID="} + of_ros : "";
    }
    static const std::regex valid{
        "/?((?:[A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*),domain=([0-9]{1,3})(?:,joints=([^,]+))?"};
    std::smatch parts;
    if (whole.size() > 1000 || !std::regex_match(whole, parts, valid) || std::stoi(parts[2]) > 232)
      throw ConfigError{words +
                        ": name the namespace of the topics and a domain from 0 to 232, as in ros2:/arm,domain=1"};
    prefix = "/" + parts[1].str();
    domain = static_cast<dds_domainid_t>(std::stoi(parts[2]));
    std::istringstream all{parts[3].str()};
    for (std::string each; std::getline(all, each, ':');) joints.push_back(each);
  }
  std::string words, prefix;
  dds_domainid_t domain;
  std::vector<std::string> joints;
};

std::unique_ptr<Node<ToolTopics>> opened(const Choice& c, bool robot, bool turns) {
  if (!c.joints.empty()) throw ConfigError{c.words + ": joints are given, but space of the scene is CARTESIAN"};
  return std::make_unique<Node<ToolTopics>>(c.words, c.prefix, c.domain, robot, turns);
}
/// Joints have the names that are given, else those of a URDF.
std::unique_ptr<Node<JointTopics>> opened(const Choice& c, bool robot, const std::optional<ArmSpec>& arm) {
  std::vector<std::string> names = c.joints;
  const std::size_t n = arm ? arm->parameters->joints.size() : 0;
  if (names.empty() && arm)
    for (const ArmJoint& joint : arm->parameters->joints)
      if (joint.name.find(' ') == joint.name.npos) names.push_back(joint.name);
  if (names.size() != n)
    throw ConfigError{
        fmt::format("{}: {} joints are named, but the arm of the scene has {}; name them in its order, as in "
                    "ros2:/arm,joints=shoulder:elbow:wrist, or take a URDF",
                    c.words, names.size(), n)};
  return std::make_unique<Node<JointTopics>>(c.words, c.prefix, c.domain, robot, names);
}

template <class Quantity>
Quantity coordinates(const Numbers& n) {
  return Quantity{typename Quantity::Vector{n.data()}};
}
template <int N>
Position<N> position(const Numbers& n) {
  if constexpr (N == 6)
    return {{n[0], n[1], n[2]}, Eigen::Quaterniond{n[6], n[3], n[4], n[5]}.normalized()};
  else
    return coordinates<Position<N>>(n);
}
template <class Vector>
Numbers numbers(const Vector& v) {
  Numbers n{};
  std::copy_n(v.data(), v.size(), n.begin());
  return n;
}

template <int N>
class Ros2Robot final : public Robot<N> {
 public:
  explicit Ros2Robot(const DriverOptions& o) : node_{opened(Choice{"--robot", o.arguments}, true, N == 6)} {}

  [[nodiscard]] RobotInfo info() const override {
    return {.name = node_->name, .has_force_sensor = node_->wrench.arrived};
  }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    const HardwareStatus status = node_->read(tick.ended);
    return {.x = position<N>(node_->pose.numbers),
            .v = coordinates<Velocity<N>>(node_->twist.numbers),
            .f_environment = -coordinates<Force<N>>(node_->wrench.numbers),
            .status = status};
  }
  void actuate(const RobotCommand<N>& c) noexcept override {
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    if constexpr (N == 6) q = c.x_d.attitude();
    ToolTopics::Command command{numbers(c.f.vec()), numbers(c.x_d.translation()), numbers(c.v_d.vec())};
    std::copy_n(q.coeffs().data(), 4, command.pose.begin() + 3);
    node_->write(command);
  }
  void release() noexcept override { node_->release(); }
  [[nodiscard]] std::string trouble() const override { return node_->trouble(); }

 private:
  std::unique_ptr<Node<ToolTopics>> node_;
};

template <int N>
class Ros2Device final : public Device<N> {
 public:
  explicit Ros2Device(const DriverOptions& o) : node_{opened(Choice{"--device", o.arguments}, false, N == 6)} {}

  [[nodiscard]] DeviceInfo info() const override { return {.name = node_->name}; }
  DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept override {
    const HardwareStatus status = node_->read(tick.ended);
    return {position<N>(node_->pose.numbers), coordinates<Velocity<N>>(node_->twist.numbers), applied_, status};
  }
  void actuate(const Force<N>& f) noexcept override {
    applied_ = f;
    node_->write({.wrench = numbers((-f).vec())});
  }
  void release() noexcept override {
    applied_ = Force<N>{};
    node_->release();
  }
  [[nodiscard]] std::string trouble() const override { return node_->trouble(); }

 private:
  std::unique_ptr<Node<ToolTopics>> node_;
  Force<N> applied_;
};

template <class Quantity>
Quantity of_joints(const JointNumbers::Each& n) {
  return Quantity{typename Quantity::Vector{n.data()}};
}
JointNumbers::Each each(const Force<kJointPort>::Vector& v) {
  JointNumbers::Each n;
  std::copy_n(v.data(), n.size(), n.begin());
  return n;
}

template <>
class Ros2Robot<kJointPort> final : public Robot<kJointPort> {
 public:
  static constexpr bool kDrivesJoints = true;
  explicit Ros2Robot(const DriverOptions& o)
      : node_{opened(Choice{"--robot", o.arguments}, true, o.scene.robot ? o.scene.robot->arm : std::nullopt)} {}

  [[nodiscard]] RobotInfo info() const override {
    return {.name = node_->name, .has_force_sensor = node_->external.arrived};
  }
  RobotSample<kJointPort> sense(const Tick<SlaveClock>& tick) noexcept override {
    const HardwareStatus status = node_->read(tick.ended);
    return {.x = of_joints<Position<kJointPort>>(node_->states.numbers.position),
            .v = of_joints<Velocity<kJointPort>>(node_->states.numbers.velocity),
            .f_environment = -of_joints<Force<kJointPort>>(node_->external.numbers.effort),
            .status = status};
  }
  void actuate(const RobotCommand<kJointPort>& c) noexcept override {
    node_->write({.position = each(c.x_d.translation()), .velocity = each(c.v_d.vec()), .effort = each(c.f.vec())});
  }
  void release() noexcept override { node_->release(); }
  [[nodiscard]] std::string trouble() const override { return node_->trouble(); }

 private:
  std::unique_ptr<Node<JointTopics>> node_;
};

template <>
class Ros2Device<kJointPort> final : public Device<kJointPort> {
 public:
  static constexpr bool kDrivesJoints = true;
  explicit Ros2Device(const DriverOptions& o)
      : node_{opened(Choice{"--device", o.arguments}, false, o.scene.device ? o.scene.device->arm : std::nullopt)} {}

  [[nodiscard]] DeviceInfo info() const override { return {.name = node_->name}; }
  DeviceSample<kJointPort> sense(const Tick<MasterClock>& tick) noexcept override {
    const HardwareStatus status = node_->read(tick.ended);
    return {of_joints<Position<kJointPort>>(node_->states.numbers.position),
            of_joints<Velocity<kJointPort>>(node_->states.numbers.velocity), applied_, status};
  }
  void actuate(const Force<kJointPort>& f) noexcept override {
    applied_ = f;
    node_->write({.position = {}, .velocity = {}, .effort = each((-f).vec())});
  }
  void release() noexcept override {
    applied_ = Force<kJointPort>{};
    node_->release();
  }
  [[nodiscard]] std::string trouble() const override { return node_->trouble(); }

 private:
  std::unique_ptr<Node<JointTopics>> node_;
  Force<kJointPort> applied_;
};

}  // namespace

void add_ros2(Registry& all) {
  all.devices.add<Ros2Device>("ros2", "ros2:PREFIX[,domain=N][,joints=NAME:...], a device behind topics of ROS 2");
  all.robots.add<Ros2Robot>("ros2", "ros2:PREFIX[,domain=N][,joints=NAME:...], a robot behind topics of ROS 2");
}

}  // namespace twoport
