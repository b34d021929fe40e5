#pragma once

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_ASIO_DISABLE_FENCED_BLOCK
#include <pthread.h>
#include <sched.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/vector.h"
#include "common/scene/arm.h"
#include "tests/support/ur_script.h"

namespace twoport::test {

/// How a controller of Universal Robots is, and what it refuses.
struct UrOptions {
  std::array<std::uint32_t, 3> version{5, 22, 0};
  bool speaks_version_2 = true, starts = true, takes_programs = true;
  std::string refused{}, by = "NOT_FOUND";  ///< a field of a recipe, and in place of its type
  std::string warns{};                      ///< before it answers with a recipe of outputs or starts
  int robot_mode = 7, safety_mode = 1;
  double wall_m = 0.02;  ///< from the tool, along x
  double wall_n_per_m = 3000.0;
  std::uint16_t port = 0;  ///< of RTDE; 0: one that is free
};

/// Stands in for the controller of a UR5e: RTDE of protocol version 2 at one port ("Real-Time Data Exchange Guide"), programs in URScript two
/// ports below ("Primary and Secondary Interfaces"), 500 cycles a second. servoj follows with a lag of 30 ms, direct_torque moves the arm
/// without gravity; the sensor has a bias of 5 N along y until it is zeroed.
class UrController {
 public:
  explicit UrController(const std::string& arms, const UrOptions& options = {})
      : options_{options}, arm_{load_arm(arms + "/ur5e.textproto")} {
    robot_mode = options.robot_mode;
    safety_mode = options.safety_mode;
    const auto loopback = boost::asio::ip::address_v4::loopback();
    for (bool bound = false; !bound;) {
      rtde_.emplace(context_, Tcp::endpoint{loopback, options.port});
      boost::system::error_code error;
      const auto below = static_cast<std::uint16_t>(rtde_->local_endpoint().port() - 2);
      programs_.emplace(context_, Tcp::v4());
      programs_->set_option(Tcp::acceptor::reuse_address{true}, error);
      programs_->bind({loopback, below}, error);
      if (!error) programs_->listen(4, error);
      bound = !error;
      if (error && options.port != 0) throw std::runtime_error{"port " + std::to_string(below) + " is taken"};
    }
    rtde_->non_blocking(true);
    programs_->non_blocking(true);
    q_ << 0.3, -1.8, 1.9, -1.6708, -1.5708, 0.2;
    target_ = q_;
    look();
    wall_x_m_ = pose_.tool.x() + options.wall_m;
    tool_x_m = pose_.tool.x();
    thread_ = std::thread{[this] { serve(); }};
  }
  ~UrController() {
    going_ = false;
    thread_.join();
  }
  UrController(const UrController&) = delete;
  UrController& operator=(const UrController&) = delete;

  [[nodiscard]] std::uint16_t port() const { return rtde_->local_endpoint().port(); }
  [[nodiscard]] std::string choice() const { return "ur:127.0.0.1:" + std::to_string(port()); }
  /// What came before the first set point, RTDE's bytes; and the last program.
  [[nodiscard]] std::string asked() const { return guarded(asked_); }
  [[nodiscard]] std::string last_program() const { return guarded(last_program_); }
  /// How the last program ended; empty: it runs, or none has.
  [[nodiscard]] std::string ended() const { return guarded(ended_); }

  std::atomic<int> robot_mode, safety_mode;
  std::atomic<bool> cut{false};                   ///< closes the connection of RTDE, once
  std::atomic<bool> mute{false}, garbage{false};  ///< sends no states; sends what is none, once
  std::atomic<bool> deaf{false};                  ///< hears nothing; what has come is heard later
  std::atomic<bool> stop_program{false};          ///< as somebody at the pendant
  std::atomic<double> tool_x_m{0.0}, tool_speed_m_per_s{0.0}, wall_force_n{0.0}, most_force_n{0.0};
  std::atomic<double> torque_n_m{0.0};  ///< size of the last direct_torque
  std::atomic<int> programs{0}, zeroed{0}, connections{0};
  std::atomic<long> cycles{0}, unheard{0};  ///< while a program runs; those to which no set point came
  std::atomic<long> late{0};                ///< cycles that the machine began 0.5 ms late or more
  std::atomic<int> longest_unheard{0};      ///< in a row

 private:
  using Tcp = boost::asio::ip::tcp;
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Clock = std::chrono::steady_clock;
  using Value = UrScript::Value;
  static constexpr double kCycle_s = 2e-3, kLag_s = 0.03, kDamping = 2.0, kBias_n = 5.0;
  struct Ended {
    std::string why;
  };

  // Numbers with the highest byte first.
  static void put(std::string& to, std::uint64_t value, int bytes) {
    for (int i = bytes - 1; i >= 0; --i) to += static_cast<char>(value >> (8 * i) & 0xff);
  }
  static void put(std::string& to, double value) { put(to, std::bit_cast<std::uint64_t>(value), 8); }
  static std::uint64_t number(const std::string& from, std::size_t at, int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i)
      value = value << 8 | static_cast<unsigned char>(from.at(at + static_cast<std::size_t>(i)));
    return value;
  }
  std::string guarded(const std::string& text) const {
    const std::scoped_lock lock{mutex_};
    return text;
  }
  void note(std::string& text, const std::string& value) {
    const std::scoped_lock lock{mutex_};
    text = value;
  }

  // RTDE.
  static std::vector<std::string> names_in(const std::string& list) {
    std::vector<std::string> names;
    for (std::size_t at = 0; at <= list.size();) {
      const std::size_t comma = std::min(list.find(',', at), list.size());
      names.push_back(list.substr(at, comma - at));
      at = comma + 1;
    }
    return names;
  }
  [[nodiscard]] std::string type_of(const std::string& name) const {
    if (name == options_.refused) return options_.by;
    if (name == "timestamp" || name.starts_with("input_double_register_")) return "DOUBLE";
    if (name.starts_with("actual_")) return "VECTOR6D";
    if (name == "runtime_state") return "UINT32";
    if (name == "robot_mode" || name == "safety_mode" || name.find("_int_register_") != name.npos) return "INT32";
    return "NOT_FOUND";
  }
  [[nodiscard]] std::string types_of(const std::vector<std::string>& names) const {
    std::string all;
    for (const std::string& name : names) all += (all.empty() ? "" : ",") + type_of(name);
    return all;
  }
  void answer(char kind, const std::string& payload) {
    std::string all;
    put(all, payload.size() + 3, 2);
    all += kind + payload;
    boost::system::error_code error;
    client_->write_some(boost::asio::buffer(all), error);
    if (error) hang_up();
  }
  void hang_up() {
    client_.reset();
    started_ = false;
    heard_.clear();
  }
  void handle(char kind, const std::string& payload) {
    if (kind != 'U') {
      const std::scoped_lock lock{mutex_};
      asked_ += heard_.substr(0, payload.size() + 3);
    }
    if (kind == 'V') return answer(kind, {options_.speaks_version_2 && number(payload, 0, 2) == 2 ? '\1' : '\0'});
    if ((kind == 'O' || kind == 'S') && !options_.warns.empty())
      answer('M', static_cast<char>(options_.warns.size()) + options_.warns + "\4RTDE\1");
    if (kind == 'S') return answer(kind, {(started_ = options_.starts) ? '\1' : '\0'});
    if (kind == 'P') return started_ = false, answer(kind, "\1");
    std::string reply;
    if (kind == 'v') {
      for (const std::uint32_t part : options_.version) put(reply, part, 4);
      put(reply, 1234, 4);
    } else if (kind == 'O') {
      outputs_ = names_in(payload.substr(8));
      reply = '\7' + types_of(outputs_);
    } else if (kind == 'I') {
      inputs_ = names_in(payload);
      reply = '\3' + types_of(inputs_);
      // A line of the log may come before any answer.
      answer('M', std::string{"\5hello\4RTDE\3", 12});
    } else if (kind == 'U' && started_ && payload.at(0) == '\3') {
      std::size_t at = 1;
      for (const std::string& name : inputs_) {
        const auto index = static_cast<std::size_t>(std::stoi(name.substr(name.rfind('_') + 1)));
        if (type_of(name) == "DOUBLE") {
          double_register_.at(index) = std::bit_cast<double>(number(payload, at, 8));
          at += 8;
        } else {
          int_register_.at(index) = static_cast<std::int32_t>(number(payload, at, 4));
          at += 4;
        }
      }
      if (at != payload.size()) throw std::runtime_error{"a set point of another length"};
      updated_ = Clock::now();
      has_set_point_ = true;
      return;
    }
    if (!reply.empty()) answer(kind, reply);
  }
  void say_state() {
    std::string payload{'\7'};
    const auto six = [&](const Vector6& v) {
      for (const double each : v) put(payload, each);
    };
    for (const std::string& name : outputs_) {
      if (name == "timestamp") put(payload, static_cast<double>(time_) * kCycle_s);
      if (name == "actual_q") six(q_);
      if (name == "actual_qd") six(v_);
      if (name == "actual_TCP_pose") six(tool());
      if (name == "actual_TCP_speed") six(Vector6{arm_.jacobian(pose_) * v_});
      if (name == "actual_TCP_force") six(measured());
      if (name == "robot_mode") put(payload, static_cast<std::uint32_t>(robot_mode.load()), 4);
      if (name == "safety_mode") put(payload, static_cast<std::uint32_t>(safety_mode.load()), 4);
      if (name == "runtime_state") put(payload, !running_ ? 1 : may_move() ? 2 : 4, 4);
      if (name == "output_int_register_24") put(payload, static_cast<std::uint32_t>(said_), 4);
    }
    if (garbage.exchange(false)) payload.pop_back();
    answer('U', payload);
  }
  void listen() {
    boost::system::error_code error;
    Tcp::socket caller{context_};
    rtde_->accept(caller, error);
    if (!error) {
      hang_up();
      caller.set_option(Tcp::no_delay{true}, error);
      caller.non_blocking(true, error);
      client_.emplace(std::move(caller));
      ++connections;
    }
    if (client_ && cut.exchange(false)) hang_up();
    std::array<char, 4096> bytes;
    while (client_ && !deaf) {
      const std::size_t n = client_->read_some(boost::asio::buffer(bytes), error);
      if (error == boost::asio::error::would_block) break;
      if (error) hang_up();
      heard_.append(bytes.data(), n);
      for (std::size_t size; client_ && heard_.size() >= 3 && heard_.size() >= (size = number(heard_, 0, 2));
           heard_.erase(0, size))
        handle(heard_[2], heard_.substr(3, size - 3));
    }
  }
  void listen_for_programs() {
    boost::system::error_code error;
    Tcp::socket caller{context_};
    programs_->accept(caller, error);
    if (!error) {
      caller.non_blocking(true, error);
      sender_.emplace(std::move(caller));
      text_.clear();
    }
    if (!sender_) return;
    std::array<char, 4096> bytes;
    const std::size_t n = sender_->read_some(boost::asio::buffer(bytes), error);
    if (error && error != boost::asio::error::would_block) sender_.reset();
    text_.append(bytes.data(), n);
    if (!text_.ends_with("\nend\n") || !options_.takes_programs) return;
    note(last_program_, text_);
    pending_ = std::exchange(text_, {});
    if (running_) throw Ended{"another program"};
  }

  // The arm.
  void look() { pose_ = arm_.pose(q_); }
  [[nodiscard]] Vector6 tool() const {
    Vector6 all;
    all << pose_.tool, rotation_vector(Eigen::Quaterniond{pose_.tool_rotation});
    return all;
  }
  [[nodiscard]] double wall_force() const { return -options_.wall_n_per_m * std::max(0.0, pose_.tool.x() - wall_x_m_); }
  [[nodiscard]] Vector6 sensed() const {
    Vector6 f = Vector6::Zero();
    f << wall_force(), kBias_n, 0.0, 0.0, 0.0, 0.0;
    return f;
  }
  [[nodiscard]] Vector6 measured() const { return sensed() - offset_; }
  [[nodiscard]] bool may_move() const { return robot_mode == 7 && (safety_mode == 1 || safety_mode == 2); }
  void move() {
    if (torque_ && may_move()) {
      constexpr int kParts = 20;
      for (int i = 0; i < kParts; ++i) {
        Vector6 f = Vector6::Zero();
        f[0] = wall_force();
        const Vector6 torque = *torque_ + arm_.jacobian(pose_).transpose() * f - kDamping * v_;
        v_ += kCycle_s / kParts * arm_.forward_dynamics(pose_, v_, torque, Eigen::Vector3d::Zero());
        q_ += kCycle_s / kParts * v_;
        look();
      }
      target_ = q_;
    } else {
      if (!may_move()) target_ = q_;
      const Vector6 before = q_;
      q_ += (1.0 - std::exp(-kCycle_s / kLag_s)) * (target_ - q_);
      v_ = (q_ - before) / kCycle_s;
      look();
    }
    torque_.reset();
    tool_x_m = pose_.tool.x();
    tool_speed_m_per_s = (arm_.jacobian(pose_) * v_).head<3>().norm();
    wall_force_n = -wall_force();
    most_force_n = std::max(most_force_n.load(), wall_force_n.load());
  }
  [[nodiscard]] Vector6 inverse(const Vector6& wanted, Vector6 q) const {
    for (int i = 0; i < 50; ++i) {
      const ArmModel::Pose at = arm_.pose(q);
      Vector6 left;
      left << wanted.head<3>() - at.tool,
          rotation_vector(rotation(wanted.tail<3>()) * Eigen::Quaterniond{at.tool_rotation}.conjugate());
      if (left.norm() < 1e-10) return q;
      const Eigen::Matrix<double, 6, 6> J = arm_.jacobian(at);
      q += J.fullPivLu().solve(left);
    }
    throw Ended{"no inverse kinematics"};
  }

  /// One cycle of 2 ms. Throws Ended where it ends the program.
  void cycle() {
    if (!going_) throw Ended{"switched off"};
    next_ = std::max(next_ + std::chrono::microseconds{2000}, Clock::now() - std::chrono::milliseconds{20});
    std::this_thread::sleep_until(next_);
    late += Clock::now() - next_ > std::chrono::microseconds{500} ? 1 : 0;
    ++time_;
    move();
    has_set_point_ = false;
    listen();
    if (running_) {
      ++cycles;
      unheard += has_set_point_ ? 0 : 1;
      silent_ = has_set_point_ ? 0 : silent_ + 1;
      longest_unheard = std::max(longest_unheard.load(), silent_);
    }
    listen_for_programs();
    if (client_ && started_ && !mute) say_state();
    if (running_ && stop_program.exchange(false)) throw Ended{"stopped at the pendant"};
    if (running_ && watched_s_ > 0.0 && Clock::now() - updated_ > std::chrono::duration<double>{watched_s_})
      throw Ended{"watchdog"};
  }
  /// The next cycle in which the program goes on: a protective stop pauses it.
  void pass() {
    do cycle();
    while (!may_move());
  }
  static Vector6 six(const Value& value) {
    if (value.numbers.size() != 6) throw std::runtime_error{"six numbers are expected"};
    return Vector6{value.numbers.data()};
  }
  static Value list(const Vector6& v) { return {{v.begin(), v.end()}, {}}; }
  Value call(const std::string& name, const UrScript::Arguments& given) {
    const auto in = [&](std::size_t i) { return given.in_order.at(i); };
    const auto index = [&] { return static_cast<std::size_t>(in(0).number()); };
    if (name == "get_actual_joint_positions") return list(q_);
    if (name == "get_steptime") return {{kCycle_s}, {}};
    if (name == "read_input_integer_register") return {{static_cast<double>(int_register_.at(index()))}, {}};
    if (name == "read_input_float_register") return {{double_register_.at(index())}, {}};
    if (name == "get_inverse_kin") return list(inverse(six(in(0)), six(in(1))));
    if (name == "sync") return pass(), Value{};
    if (name == "sleep") {
      for (int i = 0; i < std::lround(in(0).number() / kCycle_s); ++i) pass();
    } else if (name == "write_output_integer_register") {
      if (index() == 24) said_ = static_cast<std::int32_t>(in(1).number());
    } else if (name == "rtde_set_watchdog") {
      if (in(0).text != inputs_.at(0) || in(2).text != "stop") throw std::runtime_error{"another watchdog"};
      watched_s_ = 1.0 / in(1).number();
      updated_ = Clock::now();
    } else if (name == "zero_ftsensor") {
      offset_ = sensed();
      ++zeroed;
    } else if (name == "servoj") {
      const double look_ahead_s = given.named.at("lookahead_time").number(), gain = given.named.at("gain").number();
      if (given.named.at("t").number() != kCycle_s || !(look_ahead_s >= 0.03 && look_ahead_s <= 0.2) ||
          !(gain >= 100.0 && gain <= 2000.0))
        throw std::runtime_error{"servoj out of its range"};
      target_ = six(in(0));
      if (!((target_ - q_).cwiseAbs().maxCoeff() < 0.5)) throw Ended{"a set point too far away"};
      pass();
    } else if (name == "direct_torque") {
      if (options_.version[0] == 5 && options_.version[1] < 23) throw std::runtime_error{"no function direct_torque"};
      torque_ = six(in(0));
      torque_n_m = torque_->norm();
      pass();
    } else if (name == "stopj") {
      target_ = q_;
      for (int i = 0; i < 3; ++i) pass();
    } else {
      throw std::runtime_error{"no function " + name};
    }
    return {};
  }
  void run(const std::string& text) {
    note(ended_, {});
    watched_s_ = 0.0;
    silent_ = 0;
    try {
      running_ = true;
      ++programs;
      UrScript{text}.run(
          [this](const std::string& name, const UrScript::Arguments& given) { return call(name, given); });
      note(ended_, "by itself");
    } catch (const Ended& e) {
      note(ended_, e.why);
    } catch (const std::exception& e) {
      note(ended_, e.what());
    }
    running_ = false;
    torque_.reset();
    target_ = q_;
  }
  void serve() {
    // As a controller, where it is permitted: other load does not disturb it.
    const sched_param real_time{60};
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &real_time);
    next_ = Clock::now();
    while (going_) {
      try {
        pending_.empty() ? cycle() : run(std::exchange(pending_, {}));
      } catch (const Ended&) {
      }
    }
  }

  UrOptions options_;
  ArmModel arm_;
  ArmModel::Pose pose_;
  Vector6 q_, v_ = Vector6::Zero(), target_, offset_ = Vector6::Zero();
  std::optional<Vector6> torque_;
  double wall_x_m_ = 0.0;

  boost::asio::io_context context_;
  std::optional<Tcp::acceptor> rtde_, programs_;
  std::optional<Tcp::socket> client_, sender_;
  std::string heard_, text_, pending_;
  std::vector<std::string> outputs_, inputs_;
  std::array<std::int32_t, 48> int_register_{};
  std::array<double, 48> double_register_{};
  std::int32_t said_ = 0;
  bool started_ = false, running_ = false, has_set_point_ = false;
  int silent_ = 0;
  long time_ = 0;
  double watched_s_ = 0.0;
  Clock::time_point next_, updated_;

  mutable std::mutex mutex_;
  std::string asked_, last_program_, ended_;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

}  // namespace twoport::test
