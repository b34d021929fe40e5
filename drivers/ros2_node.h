#pragma once

#include <dds/dds.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <thread>

#include "common/base/check.h"
#include "common/base/scalar.h"
#include "common/base/thread.h"
#include "common/hardware/status.h"
#include "drivers/newest.h"
#include "ros2_messages.h"

namespace twoport::ros2 {

inline constexpr int kWatchdogMs = 100;  // without a message, or without a command
inline constexpr std::chrono::seconds kDiscovery{5};

/// Of a message of geometry_msgs, in the order of its definition: x y z and a quaternion x y z w, or two vectors.
using Numbers = std::array<double, 7>;
struct Message {
  std_msgs_msg_dds__Header_ header;
  Numbers numbers;
};
static_assert(offsetof(geometry_msgs_msg_dds__PoseStamped_, pose) == offsetof(Message, numbers) &&
              offsetof(geometry_msgs_msg_dds__TwistStamped_, twist) == offsetof(Message, numbers) &&
              offsetof(geometry_msgs_msg_dds__WrenchStamped_, wrench) == offsetof(Message, numbers));
using Type = dds_topic_descriptor_t;
inline const Type &kPose = geometry_msgs_msg_dds__PoseStamped__desc,
                  &kTwist = geometry_msgs_msg_dds__TwistStamped__desc,
                  &kWrench = geometry_msgs_msg_dds__WrenchStamped__desc;

/// What has come of a topic.
struct Inbox {
  /// Of the control loop. What has come while the program was stopped is not yet here when it goes on.
  void take(Seconds ended) noexcept {
    fresh = mail.take(numbers);
    arrived = arrived || fresh;
    silence = fresh ? Seconds{} : silence + std::min(ended, Seconds{0.02});
  }
  /// In a thread of DDS, one call at a time.
  void read(dds_entity_t reader) noexcept {
    void* sample = nullptr;
    dds_sample_info_t info;
    for (; dds_take(reader, &sample, &info, 1, 1) > 0; dds_return_loan(reader, &sample, 1)) {
      if (!info.valid_data) continue;
      Numbers n{};
      std::memcpy(n.data(), static_cast<const std::byte*>(sample) + offsetof(Message, numbers),
                  type.m_size - offsetof(Message, numbers));
      const double squared = n[3] * n[3] + n[4] * n[4] + n[5] * n[5] + n[6] * n[6];
      const bool finite = std::all_of(n.begin(), n.end(), [](double x) { return std::isfinite(x); });
      ++came;
      if (finite && (!turns || std::abs(squared - 1.0) < 0.01))
        mail.put(n);
      else
        ++dropped;
    }
  }
  [[nodiscard]] std::string none_for(double seconds) const {
    return fmt::format(
        "nothing on {} ({}) for {} s; {} messages had come, of which {} were dropped: numbers that are not finite, or "
        "a quaternion that is no rotation",
        topic, type.m_typename, seconds, came.load(), dropped.load());
  }

  std::string topic;
  const Type& type;
  bool turns = false;  ///< has a quaternion that must be a rotation
  Newest<Numbers> mail{};
  std::atomic<std::uint64_t> came{0}, dropped{0};
  Numbers numbers{};
  Seconds silence{};
  bool fresh = false, arrived = false;
};

inline dds_entity_t made(dds_entity_t entity) {
  if (entity < 0)
    throw ConfigError{fmt::format("ros2: {} of Cyclone DDS, whose reason stands above; is CYCLONEDDS_URI right?",
                                  dds_strretcode(entity))};
  return entity;
}
/// A reader into `inbox`, or a writer. A best-effort reader hears all writers of ROS, a reliable writer is heard by all readers.
inline dds_entity_t open_topic(dds_entity_t in, const std::string& topic, const Type& type, Inbox* inbox = nullptr) {
  const std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)> qos{dds_create_qos(), dds_delete_qos};
  const dds_data_representation_id_t cdr = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &cdr);
  dds_qset_reliability(qos.get(), inbox ? DDS_RELIABILITY_BEST_EFFORT : DDS_RELIABILITY_RELIABLE, 0);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  const dds_entity_t of = made(dds_create_topic(in, &type, ("rt" + topic).c_str(), nullptr, nullptr));
  if (!inbox) return made(dds_create_writer(in, of, qos.get(), nullptr));
  dds_listener_t* const listener = dds_create_listener(inbox);
  dds_lset_data_available(listener, [](dds_entity_t from, void* to) { static_cast<Inbox*>(to)->read(from); });
  const dds_entity_t reader = dds_create_reader(in, of, qos.get(), listener);
  dds_delete_listener(listener);
  return made(reader);
}

/// Topics of ROS 2 below a prefix: pose, twist and a robot's wrench come; command goes, and target_pose and target_twist to a robot.
class Node {
 public:
  struct Command {
    Numbers wrench{}, pose{}, twist{};
  };
  /// Waits for pose and twist, and as long for a robot's wrench. Throws ConfigError, which `choice` begins. `turns`: the attitude is used.
  Node(const std::string& choice, const std::string& prefix, dds_domainid_t domain, bool robot, bool turns)
      : Node{prefix, domain, turns} {
    participant_ = made(dds_create_participant(domain, nullptr, nullptr));
    command_ = open_topic(participant_, prefix + "/command", kWrench);
    for (Inbox* each : {&pose, &twist, &wrench})
      if (robot || each != &wrench) open_topic(participant_, each->topic, each->type, each);
    if (robot) {
      target_pose_ = open_topic(participant_, prefix + "/target_pose", kPose);
      target_twist_ = open_topic(participant_, prefix + "/target_twist", kTwist);
    }
    using std::chrono::steady_clock;
    const auto until = steady_clock::now() + kDiscovery;
    for (; steady_clock::now() < until; std::this_thread::sleep_for(std::chrono::milliseconds{5})) {
      read({});
      if (pose.arrived && twist.arrived && (wrench.arrived || !robot)) break;
    }
    for (const Inbox* needed : {&pose, &twist})
      if (!needed->arrived) throw ConfigError{choice + ": " + needed->none_for(kDiscovery.count())};
    thread_ = std::thread{[this] { run(); }};
  }
  ~Node() {
    going_ = false;
    release();
    if (thread_.joinable()) thread_.join();
    dds_delete(participant_);  // and what was made in it
    close(wake_);
  }
  Node(const Node&) = delete;

  HardwareStatus read(Seconds ended) noexcept {
    for (Inbox* each : {&pose, &twist, &wrench}) {
      each->take(ended);
      if (each->arrived && each->silence.si() > 1e-3 * kWatchdogMs && !silent_) silent_ = each;
    }
    return silent_ ? HardwareStatus::fault : pose.fresh ? HardwareStatus::ok : HardwareStatus::stale;
  }
  [[nodiscard]] std::string trouble() const { return silent_ ? silent_->none_for(1e-3 * kWatchdogMs) : ""; }
  void write(const Command& command) noexcept {
    mail_.put(command);
    released_ = false;
    eventfd_write(wake_, 1);
  }
  void release() noexcept {
    released_ = true;
    eventfd_write(wake_, 1);
  }

  const std::string name;
  Inbox pose, twist, wrench;

 private:
  Node(const std::string& prefix, dds_domainid_t domain, bool turns)
      : name{fmt::format("ROS 2 topics of {}, domain {}", prefix, domain)},
        pose{prefix + "/pose", kPose, turns},
        twist{prefix + "/twist", kTwist},
        wrench{prefix + "/wrench", kWrench} {}

  void run() noexcept {
    take_ordinary_priority();
    Command command;
    while (going_) {
      pollfd woken{wake_, POLLIN, 0};
      const bool late = poll(&woken, 1, kWatchdogMs) == 0;
      eventfd_t times;
      eventfd_read(wake_, &times);
      mail_.take(command);
      const bool lets_go = late || released_;
      publish(command_, lets_go ? Numbers{} : command.wrench);
      if (target_twist_) publish(target_twist_, lets_go ? Numbers{} : command.twist);
      if (target_pose_ && !lets_go) publish(target_pose_, command.pose);
    }
    publish(command_, {});
  }
  static void publish(dds_entity_t writer, const Numbers& numbers) noexcept {
    const auto [s, ns] = std::lldiv(dds_time(), DDS_NSECS_IN_SEC);
    char frame[] = "world";
    const Message message{{{static_cast<std::int32_t>(s), static_cast<std::uint32_t>(ns)}, frame}, numbers};
    dds_write(writer, &message);
  }

  const Inbox* silent_ = nullptr;
  Newest<Command> mail_;
  std::atomic<bool> released_{true}, going_{true};
  const int wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  dds_entity_t participant_ = 0, command_ = 0, target_pose_ = 0, target_twist_ = 0;  ///< 0: there is none
  std::thread thread_;
};

}  // namespace twoport::ros2
