#pragma once

#include <dds/dds.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>

#include "ros2_messages.h"

namespace twoport::test {

using Seven = std::array<double, 7>;  ///< x y z and a quaternion x y z w, or two vectors

/// A node of ROS 2 as DDS sees it, with the quality of service that rclcpp and rclpy have by default: reliable, the last ten.
class Ros2Side {
 public:
  Ros2Side(const std::string& prefix, std::uint32_t domain)
      : prefix_{prefix}, participant_{made(dds_create_participant(domain, nullptr, nullptr))} {
    for (const char* name : {"pose", "twist", "wrench"})
      writers_[name] = made(dds_create_writer(participant_, topic(name), qos_, nullptr));
    for (const char* name : {"command", "target_pose", "target_twist"})
      readers_[name] = made(dds_create_reader(participant_, topic(name), qos_, nullptr));
  }
  ~Ros2Side() {
    dds_delete(participant_);
    dds_delete_qos(qos_);
  }
  Ros2Side(const Ros2Side&) = delete;

  /// Of a topic below the prefix.
  void publish(const std::string& name, const Seven& n) {
    char frame[] = "base";
    const std_msgs_msg_dds__Header_ header{{1, 2}, frame};
    const geometry_msgs_msg_dds__PoseStamped_ pose{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}}};
    const geometry_msgs_msg_dds__TwistStamped_ twist{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}}};
    const geometry_msgs_msg_dds__WrenchStamped_ wrench{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}}};
    const void* message = &pose;
    if (name == "twist") message = &twist;
    if (name == "wrench") message = &wrench;
    dds_write(writers_.at(name), message);
  }
  /// The newest message that has not been taken; false: none.
  bool take(const std::string& name, Seven& n) {
    void* sample = nullptr;
    dds_sample_info_t info;
    bool any = false;
    for (; dds_take(readers_.at(name), &sample, &info, 1, 1) > 0; dds_return_loan(readers_.at(name), &sample, 1)) {
      if (!info.valid_data) continue;
      any = true;
      if (name == "target_pose") {
        const auto& p = static_cast<geometry_msgs_msg_dds__PoseStamped_*>(sample)->pose;
        n = {p.position.x,    p.position.y,    p.position.z,   p.orientation.x,
             p.orientation.y, p.orientation.z, p.orientation.w};
      } else if (name == "target_twist") {
        const auto& t = static_cast<geometry_msgs_msg_dds__TwistStamped_*>(sample)->twist;
        n = {t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z, 0.0};
      } else {
        const auto& w = static_cast<geometry_msgs_msg_dds__WrenchStamped_*>(sample)->wrench;
        n = {w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z, 0.0};
      }
    }
    return any;
  }
  [[nodiscard]] dds_entity_t participant() const { return participant_; }
  [[nodiscard]] dds_entity_t reader(const std::string& name) const { return readers_.at(name); }

 private:
  static dds_entity_t made(dds_entity_t entity) {
    if (entity < 0) throw std::runtime_error{dds_strretcode(entity)};
    return entity;
  }
  static dds_qos_t* of_ros() {
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_INFINITY);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
    return qos;
  }
  dds_entity_t topic(const std::string& name) {
    const bool pose = name.ends_with("pose"), twist = name.ends_with("twist");
    return made(dds_create_topic(participant_,
                                 pose    ? &geometry_msgs_msg_dds__PoseStamped__desc
                                 : twist ? &geometry_msgs_msg_dds__TwistStamped__desc
                                         : &geometry_msgs_msg_dds__WrenchStamped__desc,
                                 ("rt" + prefix_ + "/" + name).c_str(), nullptr, nullptr));
  }

  std::string prefix_;
  dds_qos_t* qos_ = of_ros();
  dds_entity_t participant_;
  std::map<std::string, dds_entity_t> writers_, readers_;
};

}  // namespace twoport::test
