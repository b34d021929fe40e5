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
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/scalar.h"
#include "common/base/thread.h"
#include "common/hardware/servo.h"
#include "common/hardware/status.h"
#include "drivers/newest.h"
#include "ros2_messages.h"

namespace twoport::ros2 {

inline constexpr int kWatchdogMs = 100;                          // without a command
inline constexpr std::chrono::seconds kDiscovery{5}, kHeard{3};  ///< for topics to come; for commands to be subscribed

/// How a node talks.
struct Talk {
  std::string prefix;
  dds_domainid_t domain = 0;
  std::string frame;  ///< frame_id of poses, twists and wrenches that go out; empty: world
  bool crtk = false;  ///< names of the Collaborative Robotics Toolkit; each command there is a mode, so one goes out
  std::optional<Servo> servo{};  ///< of a robot that obeys positions only: set points are its commands, not forces
  int silence_ms = 100;          ///< without a message that came before: a fault
};

using Type = dds_topic_descriptor_t;

/// What has come of a topic.
class Inbox {
 public:
  Inbox(std::string of, const Type& with, bool must_come, bool crtk)
      : topic{std::move(of)}, type{with}, needed{must_come}, stamped{crtk} {}
  virtual ~Inbox() = default;
  Inbox(const Inbox&) = delete;

  /// Of the control loop. What has come while the program was stopped is not yet here when it goes on.
  void take(Seconds ended) noexcept {
    fresh = newest();
    arrived = arrived || fresh;
    silence = fresh ? Seconds{} : silence + std::min(ended, Seconds{0.02});
  }
  /// In a thread of DDS, one call at a time.
  void read(dds_entity_t reader) noexcept {
    void* sample = nullptr;
    dds_sample_info_t info;
    for (; dds_take(reader, &sample, &info, 1, 1) > 0; dds_return_loan(reader, &sample, 1)) {
      if (!info.valid_data) continue;
      ++came;
      const auto& [s, ns] = static_cast<const std_msgs_msg_dds__Header_*>(sample)->stamp;
      if ((stamped && s == 0 && ns == 0) || !post(sample)) ++dropped;
    }
  }
  [[nodiscard]] std::string none_for(double seconds) const {
    return fmt::format("nothing on {} ({}) for {} s; {} messages had come, of which {} were dropped: {}", topic,
                       type.m_typename, seconds, came.load(), dropped.load(),
                       bad() + (stamped ? ", or the stamp 0, which says that there is no data" : ""));
  }

  const std::string topic;
  const Type& type;
  const bool needed;   ///< without it nothing begins
  const bool stamped;  ///< a stamp of 0 says that there is no data, as CRTK has it
  std::atomic<std::uint64_t> came{0}, dropped{0};
  Seconds silence{};
  bool fresh = false, arrived = false;

 private:
  /// Takes what a message says; false: it is dropped.
  virtual bool post(const void* message) noexcept = 0;
  /// Is there anything that the loop has not had?
  virtual bool newest() noexcept = 0;
  /// What is dropped, in words.
  [[nodiscard]] virtual std::string bad() const = 0;
};

inline bool all_finite(const auto& numbers) noexcept {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

/// Of a message of geometry_msgs, in the order of its definition: x y z and a quaternion x y z w, or two vectors.
using Numbers = std::array<double, 7>;
struct Message {
  std_msgs_msg_dds__Header_ header;
  Numbers numbers;
};
static_assert(offsetof(geometry_msgs_msg_dds__PoseStamped_, pose) == offsetof(Message, numbers) &&
              offsetof(geometry_msgs_msg_dds__TwistStamped_, twist) == offsetof(Message, numbers) &&
              offsetof(geometry_msgs_msg_dds__WrenchStamped_, wrench) == offsetof(Message, numbers));
inline const Type &kPose = geometry_msgs_msg_dds__PoseStamped__desc,
                  &kTwist = geometry_msgs_msg_dds__TwistStamped__desc,
                  &kWrench = geometry_msgs_msg_dds__WrenchStamped__desc,
                  &kJointState = sensor_msgs_msg_dds__JointState__desc,
                  &kArray = std_msgs_msg_dds__Float64MultiArray__desc;

/// `turns`: has a quaternion that must be a rotation.
class GeometryInbox final : public Inbox {
 public:
  GeometryInbox(const std::string& of, const Type& with, bool must_come, bool crtk, bool turns = false)
      : Inbox{of, with, must_come, crtk}, turns_{turns} {}
  Numbers numbers{};

 private:
  bool post(const void* message) noexcept override {
    Numbers n{};
    std::memcpy(n.data(), static_cast<const std::byte*>(message) + offsetof(Message, numbers),
                type.m_size - offsetof(Message, numbers));
    const double squared = n[3] * n[3] + n[4] * n[4] + n[5] * n[5] + n[6] * n[6];
    if (!all_finite(n) || (turns_ && !(std::abs(squared - 1.0) < 0.01))) return false;
    mail_.put(n);
    return true;
  }
  bool newest() noexcept override { return mail_.take(numbers); }
  [[nodiscard]] std::string bad() const override {
    return "numbers that are not finite, or a quaternion that is no rotation";
  }

  bool turns_;
  Newest<Numbers> mail_{};
};

/// Of an arm; zero from the last joint on.
struct JointNumbers {
  using Each = std::array<double, 8>;
  Each position{}, velocity{}, effort{};
};
/// Of joints by their names, which may stand in any order and beside others. `moves`: position and velocity count, else effort.
class JointInbox final : public Inbox {
 public:
  JointInbox(const std::string& of, bool must_come, bool crtk, const std::vector<std::string>& names, bool moves)
      : Inbox{of, kJointState, must_come, crtk}, names_{names}, moves_{moves} {}
  JointNumbers numbers{};

 private:
  using State = sensor_msgs_msg_dds__JointState_;

  bool post(const void* message) noexcept override {
    const auto& m = *static_cast<const State*>(message);
    JointNumbers n;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      std::uint32_t at = 0;
      while (at < m.name._length && names_[i] != m.name._buffer[at]) ++at;
      const auto has = [&](const dds_sequence_double& from, double& to) {
        if (at >= std::min(m.name._length, from._length) || !std::isfinite(from._buffer[at])) return false;
        to = from._buffer[at];
        return true;
      };
      if (moves_ ? !has(m.position, n.position[i]) || !has(m.velocity, n.velocity[i]) : !has(m.effort, n.effort[i]))
        return false;
    }
    mail_.put(n);
    return true;
  }
  bool newest() noexcept override { return mail_.take(numbers); }
  [[nodiscard]] std::string bad() const override {
    return fmt::format("without a finite {} of {}", moves_ ? "position and velocity" : "effort",
                       fmt::join(names_, ", "));
  }

  std::vector<std::string> names_;
  bool moves_;
  Newest<JointNumbers> mail_{};
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

/// The topic of a writer to which nobody subscribes; else empty.
inline std::string unheard(dds_entity_t writer) {
  if (dds_get_matched_subscriptions(writer, nullptr, 0) != 0) return {};
  std::array<char, 1200> name{};
  dds_get_name(dds_get_topic(writer), name.data(), name.size());
  return name.data() + std::string_view{"rt"}.size();
}

inline std_msgs_msg_dds__Header_ header_now(char* frame) noexcept {
  const auto [s, ns] = std::lldiv(dds_time(), DDS_NSECS_IN_SEC);
  return {{static_cast<std::int32_t>(s), static_cast<std::uint32_t>(ns)}, frame};
}

/// pose, twist and a robot's wrench come; command goes, and target_pose and target_twist to a robot. By CRTK measured_cp, measured_cv and
/// measured_cf come and servo_cf or servo_cp goes. `turns`: the attitude is used.
class ToolTopics {
 public:
  struct Command {
    Numbers wrench{}, pose{}, twist{};
  };
  ToolTopics(const Talk& talk, bool robot, bool turns)
      : pose{talk.prefix + (talk.crtk ? "/measured_cp" : "/pose"), kPose, true, talk.crtk, turns},
        twist{talk.prefix + (talk.crtk ? "/measured_cv" : "/twist"), kTwist, true, talk.crtk},
        wrench{talk.prefix + (talk.crtk ? "/measured_cf" : "/wrench"), kWrench, false, talk.crtk},
        inboxes{&pose, &twist},
        follows_positions_{talk.servo.has_value()},
        frame_{talk.frame.empty() ? "world" : talk.frame} {
    if (robot) inboxes.push_back(&wrench);
  }
  GeometryInbox pose, twist, wrench;

 protected:
  void open_writers(dds_entity_t in, const Talk& talk) {
    const bool robot = inboxes.back() == &wrench;
    if (talk.crtk) {
      (follows_positions_ ? target_pose_ : command_) = open_topic(
          in, talk.prefix + (follows_positions_ ? "/servo_cp" : "/servo_cf"), follows_positions_ ? kPose : kWrench);
      return;
    }
    command_ = open_topic(in, talk.prefix + "/command", kWrench);
    if (!robot) return;
    target_pose_ = open_topic(in, talk.prefix + "/target_pose", kPose);
    target_twist_ = open_topic(in, talk.prefix + "/target_twist", kTwist);
  }
  /// The topic that moves the hardware where nobody subscribes to it; else empty.
  [[nodiscard]] std::string unheard() const { return ros2::unheard(follows_positions_ ? target_pose_ : command_); }
  void publish(const Command& command, bool lets_go) noexcept {
    if (command_) write(command_, lets_go ? Numbers{} : command.wrench);
    if (target_twist_) write(target_twist_, lets_go ? Numbers{} : command.twist);
    if (target_pose_ && !lets_go) write(target_pose_, command.pose);
  }
  std::vector<Inbox*> inboxes;  ///< a command answers the first one

 private:
  void write(dds_entity_t writer, const Numbers& numbers) noexcept {
    const Message message{header_now(frame_.data()), numbers};
    dds_write(writer, &message);
  }
  bool follows_positions_;
  std::string frame_;
  dds_entity_t command_ = 0, target_pose_ = 0, target_twist_ = 0;  ///< 0: there is none
};

/// joint_states and a robot's external_effort come; joint_command goes, and its efforts alone as joint_effort. By CRTK measured_js comes in
/// place of joint_states, and servo_jf goes, which has efforts alone.
class JointTopics {
 public:
  using Command = JointNumbers;
  JointTopics(const Talk& talk, bool robot, const std::vector<std::string>& names)
      : states{talk.prefix + (talk.crtk ? "/measured_js" : "/joint_states"), true, talk.crtk, names, true},
        external{talk.prefix + "/external_effort", false, talk.crtk, names, false},
        inboxes{&states},
        set_point_goes_{robot && !talk.crtk},
        names_{names} {
    for (std::string& each : names_) pointers_.push_back(each.data());
    if (robot) inboxes.push_back(&external);
  }
  JointInbox states, external;

 protected:
  void open_writers(dds_entity_t in, const Talk& talk) {
    command_ = open_topic(in, talk.prefix + (talk.crtk ? "/servo_jf" : "/joint_command"), kJointState);
    if (!talk.crtk) effort_ = open_topic(in, talk.prefix + "/joint_effort", kArray);
  }
  [[nodiscard]] std::string unheard() const {
    return effort_ && ros2::unheard(effort_).empty() ? "" : ros2::unheard(command_);
  }
  /// A set point goes to a robot that is not let go.
  void publish(Command command, bool lets_go) noexcept {
    char frame[] = "";
    const auto n = static_cast<std::uint32_t>(names_.size());
    if (lets_go) command = {};
    const auto sequence = [](JointNumbers::Each& of, std::uint32_t length) {
      return dds_sequence_double{length, length, of.data(), false};
    };
    const std::uint32_t moves = set_point_goes_ && !lets_go ? n : 0;
    const sensor_msgs_msg_dds__JointState_ state{header_now(frame),
                                                 {n, n, pointers_.data(), false},
                                                 sequence(command.position, moves),
                                                 sequence(command.velocity, moves),
                                                 sequence(command.effort, n)};
    const std_msgs_msg_dds__Float64MultiArray_ efforts{{}, sequence(command.effort, n)};
    dds_write(command_, &state);
    if (effort_) dds_write(effort_, &efforts);
  }
  std::vector<Inbox*> inboxes;

 private:
  bool set_point_goes_;
  std::vector<std::string> names_;
  std::vector<char*> pointers_;
  dds_entity_t command_ = 0, effort_ = 0;  ///< 0: there is none
};

/// Topics of ROS 2 below a prefix, of tool or joints, and the thread that publishes.
template <class Topics>
class Node : public Topics {
 public:
  using typename Topics::Command;
  /// Waits for the topics. Throws ConfigError, which `choice` begins.
  template <class... Of>
  Node(const std::string& choice, const Talk& talk, const Of&... of) : Node{Begun{}, talk, of...} {
    participant_ = made(dds_create_participant(talk.domain, nullptr, nullptr));
    Topics::open_writers(participant_, talk);
    for (Inbox* each : inboxes) open_topic(participant_, each->topic, each->type, each);
    using std::chrono::steady_clock;
    const auto until = steady_clock::now() + kDiscovery;
    for (; steady_clock::now() < until; std::this_thread::sleep_for(std::chrono::milliseconds{5})) {
      read({});
      if (std::all_of(inboxes.begin(), inboxes.end(), [](const Inbox* each) { return each->arrived; })) break;
    }
    for (const Inbox* each : inboxes)
      if (each->needed && !each->arrived) throw ConfigError{choice + ": " + each->none_for(kDiscovery.count())};
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
    for (Inbox* each : inboxes) {
      each->take(ended);
      if (each->arrived && each->silence.si() > silence_s_ && !silent_) silent_ = each;
    }
    return silent_ ? HardwareStatus::fault : inboxes.front()->fresh ? HardwareStatus::ok : HardwareStatus::stale;
  }
  [[nodiscard]] std::string trouble() const { return silent_ ? silent_->none_for(silence_s_) : ""; }
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

 private:
  using Topics::inboxes;

  /// What it delegates to is whole, so that the destructor runs where it throws.
  struct Begun {};
  template <class... Of>
  Node(Begun, const Talk& talk, const Of&... of)
      : Topics{talk, of...},
        name{fmt::format("ROS 2 topics of {}, domain {}", talk.prefix, talk.domain)},
        silence_s_{1e-3 * talk.silence_ms} {}

  void run() noexcept {
    take_ordinary_priority();
    Command command;
    using std::chrono::steady_clock;
    bool looked = false;
    for (const auto begun = steady_clock::now(); going_;) {
      if (!looked && steady_clock::now() - begun > kHeard) {
        looked = true;
        if (const std::string topic = Topics::unheard(); !topic.empty())
          std::fprintf(stderr, "warning: nobody subscribes to %s: no command gets to the hardware; map its topic\n",
                       topic.c_str());
      }
      pollfd woken{wake_, POLLIN, 0};
      const bool late = poll(&woken, 1, kWatchdogMs) == 0;
      eventfd_t times;
      eventfd_read(wake_, &times);
      mail_.take(command);
      Topics::publish(command, late || released_);
    }
    Topics::publish({}, true);
  }

  const double silence_s_;
  const Inbox* silent_ = nullptr;
  Newest<Command> mail_;
  std::atomic<bool> released_{true}, going_{true};
  const int wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  dds_entity_t participant_ = 0;
  std::thread thread_;
};

}  // namespace twoport::ros2
