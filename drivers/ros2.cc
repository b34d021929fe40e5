#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdlib>
#include <memory>
#include <regex>
#include <string>

#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "drivers/ros2_node.h"

namespace twoport {
namespace {

using ros2::Node, ros2::Numbers;

/// PREFIX[,domain=N]; without a domain that of ROS_DOMAIN_ID, else 0.
std::unique_ptr<Node> opened(const std::string& flag, const std::string& text, bool robot, bool turns) {
  const char* of_ros = std::getenv("ROS_DOMAIN_ID");
  std::string choice = flag + " ros2:" + text, whole = text;
  if (text.find(',') == text.npos) {
    whole += std::string{",domain="} + (of_ros && *of_ros ? of_ros : "0");
    choice += of_ros && *of_ros ? std::string{" with ROS_DOMAIN_ID="} + of_ros : "";
  }
  static const std::regex valid{"/?((?:[A-Za-z_][A-Za-z0-9_]*/)*[A-Za-z_][A-Za-z0-9_]*),domain=([0-9]{1,3})"};
  std::smatch parts;
  if (whole.size() > 200 || !std::regex_match(whole, parts, valid) || std::stoi(parts[2]) > 232)
    throw ConfigError{choice +
                      ": name the namespace of the topics and a domain from 0 to 232, as in ros2:/arm,domain=1"};
  return std::make_unique<Node>(choice, fmt::format("/{}", parts[1].str()),
                                static_cast<dds_domainid_t>(std::stoi(parts[2])), robot, turns);
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
  explicit Ros2Robot(const DriverOptions& o) : node_{opened("--robot", o.arguments, true, N == 6)} {}

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
    Node::Command command{numbers(c.f.vec()), numbers(c.x_d.translation()), numbers(c.v_d.vec())};
    std::copy_n(q.coeffs().data(), 4, command.pose.begin() + 3);
    node_->write(command);
  }
  void release() noexcept override { node_->release(); }
  [[nodiscard]] std::string trouble() const override { return node_->trouble(); }

 private:
  std::unique_ptr<Node> node_;
};

template <int N>
class Ros2Device final : public Device<N> {
 public:
  explicit Ros2Device(const DriverOptions& o) : node_{opened("--device", o.arguments, false, N == 6)} {}

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
  std::unique_ptr<Node> node_;
  Force<N> applied_;
};

}  // namespace

void add_ros2(Registry& all) {
  all.devices.add<Ros2Device>("ros2", "ros2:PREFIX[,domain=N], a device behind topics of ROS 2");
  all.robots.add<Ros2Robot>("ros2", "ros2:PREFIX[,domain=N], a robot behind topics of ROS 2");
}

}  // namespace twoport
