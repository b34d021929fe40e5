#pragma once

#include <dds/dds.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ros2_messages.h"

namespace twoport::test {

using Seven = std::array<double, 7>;  ///< x y z and a quaternion x y z w, or two vectors

inline dds_entity_t made(dds_entity_t entity) {
  if (entity < 0) throw std::runtime_error{dds_strretcode(entity)};
  return entity;
}
/// The quality of service that rclcpp and rclpy have by default: reliable, the last ten.
inline dds_qos_t* qos_of_ros() {
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_INFINITY);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  return qos;
}

/// A node of ROS 2 as DDS sees it.
class Ros2Side {
 public:
  using Names = std::vector<std::string>;
  Ros2Side(const std::string& prefix, std::uint32_t domain, const Names& written = {"pose", "twist", "wrench"},
           const Names& read = {"command", "target_pose", "target_twist"})
      : prefix_{prefix}, participant_{made(dds_create_participant(domain, nullptr, nullptr))} {
    for (const std::string& name : written)
      writers_[name] = made(dds_create_writer(participant_, topic(name), qos_, nullptr));
    for (const std::string& name : read)
      readers_[name] = made(dds_create_reader(participant_, topic(name), qos_, nullptr));
  }
  ~Ros2Side() {
    dds_delete(participant_);
    dds_delete_qos(qos_);
  }
  Ros2Side(const Ros2Side&) = delete;

  /// Of a topic below the prefix.
  void publish(const std::string& name, const Seven& n) {
    char of_base[] = "base";
    const std_msgs_msg_dds__Header_ header{{stamp_s, 0}, of_base};
    const geometry_msgs_msg_dds__PoseStamped_ pose{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}}};
    const geometry_msgs_msg_dds__TwistStamped_ twist{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}}};
    const geometry_msgs_msg_dds__WrenchStamped_ wrench{header, {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}}};
    const void* message = &pose;
    if (is_twist(name)) message = &twist;
    if (!is_twist(name) && !is_pose(name)) message = &wrench;
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
      frame = static_cast<std_msgs_msg_dds__Header_*>(sample)->frame_id;
      if (is_pose(name)) {
        const auto& p = static_cast<geometry_msgs_msg_dds__PoseStamped_*>(sample)->pose;
        n = {p.position.x,    p.position.y,    p.position.z,   p.orientation.x,
             p.orientation.y, p.orientation.z, p.orientation.w};
      } else if (is_twist(name)) {
        const auto& t = static_cast<geometry_msgs_msg_dds__TwistStamped_*>(sample)->twist;
        n = {t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z, 0.0};
      } else {
        const auto& w = static_cast<geometry_msgs_msg_dds__WrenchStamped_*>(sample)->wrench;
        n = {w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z, 0.0};
      }
    }
    return any;
  }
  std::int32_t stamp_s = 1;  ///< of what is published
  std::string frame;         ///< of what was taken last
  [[nodiscard]] dds_entity_t participant() const { return participant_; }
  [[nodiscard]] dds_entity_t reader(const std::string& name) const { return readers_.at(name); }

 private:
  static bool is_pose(const std::string& name) { return name.ends_with("pose") || name.ends_with("_cp"); }
  static bool is_twist(const std::string& name) { return name.ends_with("twist") || name.ends_with("_cv"); }
  dds_entity_t topic(const std::string& name) {
    return made(dds_create_topic(participant_,
                                 is_pose(name)    ? &geometry_msgs_msg_dds__PoseStamped__desc
                                 : is_twist(name) ? &geometry_msgs_msg_dds__TwistStamped__desc
                                                  : &geometry_msgs_msg_dds__WrenchStamped__desc,
                                 ("rt" + prefix_ + "/" + name).c_str(), nullptr, nullptr));
  }

  std::string prefix_;
  dds_qos_t* qos_ = qos_of_ros();
  dds_entity_t participant_;
  std::map<std::string, dds_entity_t> writers_, readers_;
};

/// The same of an arm that is coupled joint by joint.
class JointSide {
 public:
  struct State {
    std::vector<std::string> name;
    std::vector<double> position, velocity, effort;
  };

  JointSide(const std::string& prefix, std::uint32_t domain, const std::string& states = "joint_states",
            const std::string& command = "joint_command")
      : participant_{made(dds_create_participant(domain, nullptr, nullptr))} {
    const auto topic = [&](const std::string& name, const dds_topic_descriptor_t& type) {
      return made(dds_create_topic(participant_, &type, ("rt" + prefix + "/" + name).c_str(), nullptr, nullptr));
    };
    const auto &state = sensor_msgs_msg_dds__JointState__desc, &array = std_msgs_msg_dds__Float64MultiArray__desc;
    writers_["joint_states"] = made(dds_create_writer(participant_, topic(states, state), qos_, nullptr));
    writers_["external_effort"] = made(dds_create_writer(participant_, topic("external_effort", state), qos_, nullptr));
    command_ = made(dds_create_reader(participant_, topic(command, state), qos_, nullptr));
    effort_ = made(dds_create_reader(participant_, topic("joint_effort", array), qos_, nullptr));
  }
  ~JointSide() {
    dds_delete(participant_);
    dds_delete_qos(qos_);
  }
  JointSide(const JointSide&) = delete;

  void publish(const std::string& topic, State s) {
    char frame[] = "base";
    std::vector<char*> names;
    for (std::string& each : s.name) names.push_back(each.data());
    const auto length = static_cast<std::uint32_t>(names.size());
    const auto sequence = [](std::vector<double>& of) {
      const auto n = static_cast<std::uint32_t>(of.size());
      return dds_sequence_double{n, n, of.data(), false};
    };
    const sensor_msgs_msg_dds__JointState_ message{{{1, 2}, frame},
                                                   {length, length, names.data(), false},
                                                   sequence(s.position),
                                                   sequence(s.velocity),
                                                   sequence(s.effort)};
    dds_write(writers_.at(topic), &message);
  }
  /// The newest command that has not been taken; false: none.
  bool take(State& command) {
    return take_all(command_, [&](const void* sample) {
      const auto& m = *static_cast<const sensor_msgs_msg_dds__JointState_*>(sample);
      command = {{m.name._buffer, m.name._buffer + m.name._length}, list(m.position), list(m.velocity), list(m.effort)};
    });
  }
  /// The efforts alone.
  bool take(std::vector<double>& effort) {
    return take_all(effort_, [&](const void* sample) {
      effort = list(static_cast<const std_msgs_msg_dds__Float64MultiArray_*>(sample)->data);
    });
  }

 private:
  static std::vector<double> list(const dds_sequence_double& from) {
    return {from._buffer, from._buffer + from._length};
  }
  template <class Use>
  static bool take_all(dds_entity_t reader, Use use) {
    void* sample = nullptr;
    dds_sample_info_t info;
    bool any = false;
    for (; dds_take(reader, &sample, &info, 1, 1) > 0; dds_return_loan(reader, &sample, 1))
      if (info.valid_data) use(sample), any = true;
    return any;
  }

  dds_qos_t* qos_ = qos_of_ros();
  dds_entity_t participant_, command_, effort_;
  std::map<std::string, dds_entity_t> writers_;
};

}  // namespace twoport::test
