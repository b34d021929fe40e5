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

/// PREFIX[,OPTION=VALUE...]; without a domain that of ROS_DOMAIN_ID, else 0.
struct Choice {
  Choice(const std::string& flag, const std::string& text) : words{flag + " ros2:" + text} {
    std::istringstream parts{text};
    std::string prefix, domain;
    std::getline(parts, prefix, ',');
    for (std::string each; std::getline(parts, each, ',');) {
      const auto at = each.find('=');
      const std::string option = each.substr(0, at), value = at == each.npos ? "" : each.substr(at + 1);
      if (option == "domain")
        domain = value.empty() ? "none" : value;
      else if (option == "joints")
        read_joints(value);
      else if (option == "names" && value == "crtk")
        talk.crtk = true;
      else if (option == "servo")
        read_servo(value);
      else if (option == "frame" && !value.empty())
        talk.frame = value;
      else if (option == "silence_ms")
        talk.silence_ms = static_cast<int>(number(option, value, 10, 10000));
      else
        throw ConfigError{
            fmt::format("{}: \"{}\"; options are domain=N, joints=NAME:..., names=crtk, servo=RATE_HZ:DELAY_MS:LAG_MS, "
                        "frame=NAME and silence_ms=N",
                        words, each)};
    }
    const char* const of_ros = std::getenv("ROS_DOMAIN_ID");
    if (domain.empty() && of_ros && *of_ros) {
      domain = of_ros;
      words += std::string{" with ROS_DOMAIN_ID="} + of_ros;
    }
    if (domain.empty()) domain = "0";
    static const std::regex valid{"/?((?:[A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*)"}, digits{"[0-9]{1,3}"};
    std::smatch name;
    if (prefix.size() > 1000 || !std::regex_match(prefix, name, valid) || !std::regex_match(domain, digits) ||
        std::stoi(domain) > 232)
      throw ConfigError{words +
                        ": name the namespace of the topics and a domain from 0 to 232, as in ros2:/arm,domain=1"};
    talk.prefix = "/" + name[1].str();
    talk.domain = static_cast<dds_domainid_t>(std::stoi(domain));
  }
  std::string words;
  ros2::Talk talk;
  std::vector<std::string> joints;

 private:
  [[nodiscard]] double number(const std::string& option, const std::string& text, double least, double most) const {
    static const std::regex valid{"[0-9]{1,5}(\\.[0-9]{1,6})?"};
    if (!std::regex_match(text, valid) || std::stod(text) < least || std::stod(text) > most)
      throw ConfigError{fmt::format("{}: {} \"{}\" is no number from {:g} to {:g}", words, option, text, least, most)};
    return std::stod(text);
  }
  void read_joints(const std::string& value) {
    std::istringstream all{value};
    for (std::string each; std::getline(all, each, ':');) joints.push_back(each);
  }
  void read_servo(const std::string& value) {
    std::istringstream all{value};
    std::string rate, delay, lag;
    std::getline(std::getline(std::getline(all, rate, ':'), delay, ':'), lag);
    talk.servo = Servo{Seconds{1.0 / number("servo's rate in Hz", rate, 10, 10000)},
                       Seconds{1e-3 * number("servo's delay in ms", delay, 0, 1000)},
                       Seconds{1e-3 * number("servo's lag in ms", lag, 0, 1000)}};
  }
};

Choice of_device(const DriverOptions& o) {
  Choice c{"--device", o.arguments};
  if (c.talk.servo)
    throw ConfigError{c.words + ": servo is of a robot that obeys positions only; a device displays forces"};
  return c;
}
std::unique_ptr<Node<ToolTopics>> opened(const Choice& c, bool robot, bool turns) {
  if (!c.joints.empty()) throw ConfigError{c.words + ": joints are given, but space of the scene is CARTESIAN"};
  return std::make_unique<Node<ToolTopics>>(c.words, c.talk, robot, turns);
}
/// Joints have the names that are given, else those of a URDF.
std::unique_ptr<Node<JointTopics>> opened(const Choice& c, bool robot, const std::optional<ArmSpec>& arm) {
  if (c.talk.servo || !c.talk.frame.empty())
    throw ConfigError{c.words + ": " + (c.talk.servo ? "servo" : "frame") +
                      " is of a tool, but space of the scene is JOINTS, whose robots follow efforts"};
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
  return std::make_unique<Node<JointTopics>>(c.words, c.talk, robot, names);
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
  explicit Ros2Robot(const DriverOptions& o) : Ros2Robot{Choice{"--robot", o.arguments}} {}

  [[nodiscard]] RobotInfo info() const override {
    return {.name = node_->name, .has_force_sensor = node_->wrench.arrived, .servo = servo_};
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
  explicit Ros2Robot(const Choice& c) : servo_{c.talk.servo}, node_{opened(c, true, N == 6)} {}

  std::optional<Servo> servo_;
  std::unique_ptr<Node<ToolTopics>> node_;
};

template <int N>
class Ros2Device final : public Device<N> {
 public:
  explicit Ros2Device(const DriverOptions& o) : node_{opened(of_device(o), false, N == 6)} {}

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
      : node_{opened(of_device(o), false, o.scene.device ? o.scene.device->arm : std::nullopt)} {}

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
  all.devices.add<Ros2Device>("ros2",
                              "ros2:PREFIX[,domain=N][,joints=NAME:...][,names=crtk][,frame=NAME][,silence_ms=N], a "
                              "device behind topics of ROS 2");
  all.robots.add<Ros2Robot>("ros2",
                            "ros2:PREFIX[,domain=N][,joints=NAME:...][,names=crtk][,servo=HZ:MS:MS][,frame=NAME][,"
                            "silence_ms=N], a robot behind topics of ROS 2");
}

}  // namespace twoport
