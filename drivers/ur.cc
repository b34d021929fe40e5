#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_BEAST_USE_STD_STRING_VIEW
#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // the thread sanitizer does not support fences
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/error.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/base/text.h"
#include "common/hardware/registry.h"
#include "common/scene/scene.h"
#include "drivers/newest.h"
#include "drivers/rtde.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using Error = boost::system::error_code;
using Eigen::Vector3d;
using Now = std::chrono::steady_clock;
using rtde::Kind, rtde::Numbers;
using namespace std::chrono_literals;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr Duration kSilence = 100ms;    // without a package the connection is lost; without a command the robot stops
constexpr Duration kOpening = 2s;       // for each step of the first connection
constexpr Duration kReopening = 500ms;  // and of a later one
constexpr Duration kStarting = 5s;      // of the program
constexpr Duration kRetry = 200ms;      // between two connections
constexpr double kRate_hz = 500.0;
constexpr std::uint32_t kLeastMinor = 3;  // of PolyScope 5, the first one with the upper registers
constexpr int kSilentCycles = 40;         // without a package the program on the controller stops the robot by itself
constexpr int kRunning = 7, kNormal = 1, kReduced = 2, kPlaying = 2;
constexpr std::int32_t kEndedByItself = 0;  // in place of a program's number
// From a set point to the robot: two cycles on the way, and the least look-ahead of servoj.
constexpr Servo kServo{.period = Seconds{1.0 / kRate_hz}, .delay = Seconds{4e-3}, .lag = Seconds{0.03}};
constexpr double kFarthestTool_m = 0.5;     // of the controller from the flange of the scene's arm
constexpr double kMostSpeed_m_per_s = 1.0;  // of the tool
constexpr Seconds kForceReturns{1.0};       // after a lost connection
constexpr int kPortsApart = 2;              // of RTDE (30004) from that of programs (30002)
constexpr std::uint16_t kRtdePort = 30004;
constexpr std::size_t kAtOnce = 4096;  // bytes of a read

/// What the program on the controller does.
enum class Motion : std::int32_t { end = -1, hold = 0, move = 1 };
/// What the numbers of a set point are.
enum class Drive { pose, torque };

/// Of the controller, in URScript: it reads set points and moves the robot, and stops it where no package has come for kSilentCycles; the
/// watchdog of RTDE does so where it does not get that far. `zero`: the force sensor, which must not touch anything then.
std::string program(std::int32_t id, Drive drive, bool zero) {
  std::string numbers;
  for (int i = 24; i < 30; ++i) numbers += fmt::format("{}read_input_float_register({})", i > 24 ? ", " : "", i);
  const std::string drives = drive == Drive::torque ? fmt::format("direct_torque([{}])", numbers)
                                                    : fmt::format(R"(q = get_inverse_kin(p[{}], q)
      servoj(q, t=get_steptime(), lookahead_time=0.03, gain=500))",
                                                                  numbers);
  return fmt::format(R"(def twoport():
  {zero}
  local q = get_actual_joint_positions()
  local heard = read_input_integer_register(24)
  local silent = 0
  local moves = False
  rtde_set_watchdog("input_int_register_24", 10, "stop")
  write_output_integer_register(24, {id})
  while silent < {most}:
    local count = read_input_integer_register(24)
    local motion = read_input_integer_register(25)
    if count == heard:
      silent = silent + 1
    else:
      silent = 0
      heard = count
    end
    if motion == {move}:
      moves = True
      {drives}
    elif motion == {end}:
      silent = {most}
    else:
      if moves:
        moves = False
        stopj(4.0)
        q = get_actual_joint_positions()
      end
      sync()
    end
  end
  if moves:
    stopj(4.0)
  end
  write_output_integer_register(24, {none})
end
)",
                     fmt::arg("zero", zero ? "zero_ftsensor()\n  sleep(0.1)" : ""), fmt::arg("id", id),
                     fmt::arg("most", kSilentCycles), fmt::arg("move", static_cast<int>(Motion::move)),
                     fmt::arg("end", static_cast<int>(Motion::end)), fmt::arg("drives", drives),
                     fmt::arg("none", kEndedByItself));
}

std::string name_of(int mode, int first, std::string_view names) {
  for (; mode > first && !names.empty(); --mode) names.remove_prefix(std::min(names.find(' '), names.size() - 1) + 1);
  return mode == first && !names.empty() ? std::string{names.substr(0, names.find(' '))} : "unknown";
}
/// Why the robot may not move; empty: it may.
std::string stopped_by(const rtde::State& s) {
  if (s.safety_mode != kNormal && s.safety_mode != kReduced)
    return "its safety mode is " +
           name_of(
               s.safety_mode, 1,
               "NORMAL REDUCED PROTECTIVE_STOP RECOVERY SAFEGUARD_STOP SYSTEM_EMERGENCY_STOP "
               "ROBOT_EMERGENCY_STOP VIOLATION FAULT VALIDATE_JOINT_ID UNDEFINED_SAFETY_MODE "
               "AUTOMATIC_MODE_SAFEGUARD_STOP SYSTEM_THREE_POSITION_ENABLING_STOP TP_THREE_POSITION_ENABLING_STOP") +
           "; it must be NORMAL or REDUCED";
  if (s.robot_mode != kRunning)
    return "its robot mode is " +
           name_of(s.robot_mode, -1,
                   "NO_CONTROLLER DISCONNECTED CONFIRM_SAFETY BOOTING POWER_OFF POWER_ON IDLE BACKDRIVE RUNNING "
                   "UPDATING_FIRMWARE") +
           "; it must be RUNNING: power it on and release its brakes";
  return {};
}

struct Command {
  Motion motion = Motion::hold;
  Numbers numbers{};
};
struct Reading {
  rtde::State state;
  bool fault = false;
  bool lost = false;  ///< there is no connection
};

/// A connection that cannot be made, in words.
struct Refused {
  std::string why;
};

/// The connection to a controller, on a thread of its own: a package of it, and the newest command.
class Controller {
 public:
  Controller(const std::string& arguments, bool torques, bool only_torques)
      : where_{arguments}, torques_{torques}, only_torques_{only_torques} {
    const std::string flag = "--robot ur:" + where_ + ": ";
    std::string host = where_;
    std::uint16_t port = kRtdePort;
    if (const std::size_t colon = where_.rfind(':'); colon != where_.npos && where_.back() != ']') {
      const auto given = number_from<std::uint16_t>(where_.substr(colon + 1));
      host.resize(colon);
      port = given.value_or(0);
    }
    if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
    if (host.empty() || port <= kPortsApart)
      throw ConfigError{flag +
                        "ARGS is HOST or HOST:PORT of the controller's RTDE, as 192.168.1.10; programs go to PORT - 2"};
    try {
      Error error;
      rtde_at_ = tcp::resolver{context_}.resolve(host, std::to_string(port), error);
      if (!error) programs_at_ = tcp::resolver{context_}.resolve(host, std::to_string(port - kPortsApart), error);
      if (error) throw Refused{"there is no such host (" + error.message() + ")"};
      connect(true);
    } catch (const Refused& refused) {
      throw ConfigError{flag + refused.why};
    }
    thread_ = std::thread{[this] { run(); }};
    schedule(SCHED_OTHER, {});
  }
  ~Controller() {
    going_ = false;
    thread_.join();
  }
  Controller(const Controller&) = delete;
  Controller& operator=(const Controller&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] Drive drive() const { return drive_; }
  /// When the program began.
  [[nodiscard]] const rtde::State& first() const { return first_; }
  /// Why the last reading is a fault.
  [[nodiscard]] std::string trouble(const rtde::State& s) const {
    const std::string why = stopped_by(s);
    return "--robot ur:" + where_ + ": " +
           (why.empty() ? "the program on the controller has ended: somebody or its watchdog has stopped it, or the "
                          "pose has no inverse kinematics"
                        : why);
  }
  /// A loop in real time gets its readings in time.
  void follow_priority_of_caller() noexcept {
    int policy = 0;
    sched_param own{};
    pthread_getschedparam(pthread_self(), &policy, &own);
    if (policy != SCHED_FIFO) return;
    own.sched_priority = std::max(1, own.sched_priority - 1);
    schedule(policy, own);
  }
  // Of the control step.
  bool take(Reading& reading) noexcept { return readings_.take(reading); }
  void push(const Command& command) noexcept { commands_.put(command); }

 private:
  void schedule(int policy, const sched_param& p) noexcept {
    pthread_setschedparam(thread_.native_handle(), policy, &p);
  }
  /// One operation of a stream, to its end or for `limit` at most.
  template <class Start>
  Error complete(beast::tcp_stream& stream, Duration limit, Start start) {
    Error result;
    stream.expires_after(limit);
    start([&result](Error e, auto&&...) { result = e; });
    context_.restart();
    context_.run();
    return result;
  }
  Error send(const std::string& package) {
    return complete(*stream_, kSilence, [&](auto done) { asio::async_write(*stream_, asio::buffer(package), done); });
  }
  /// Length of the package at the front of what has been heard; 0: it is not whole.
  [[nodiscard]] std::size_t whole() const {
    if (heard_.size() < rtde::kHeader) return 0;
    std::string_view front = heard_;
    const std::size_t size = rtde::take<std::uint16_t>(front);
    return heard_.size() >= size ? std::max(size, rtde::kHeader) : 0;
  }
  Error hear(Duration limit) {
    std::size_t more = 0;
    const std::size_t before = heard_.size();
    heard_.resize(before + kAtOnce);
    const Error error = complete(*stream_, limit, [&](auto done) {
      stream_->async_read_some(asio::buffer(heard_.data() + before, kAtOnce), [&more, done](Error e, std::size_t n) {
        more = n;
        done(e);
      });
    });
    heard_.resize(before + more);
    return error;
  }
  /// The payload of the next package of a kind; others before it are passed over.
  std::string answer(Kind kind) {
    for (;;) {
      std::size_t size;
      while ((size = whole()) == 0)
        if (const Error error = hear(opening_))
          throw Refused{"the controller does not answer as RTDE (" + error.message() + ")"};
      const auto got = static_cast<Kind>(heard_[2]);
      std::string payload = heard_.substr(rtde::kHeader, size - rtde::kHeader);
      heard_.erase(0, size);
      if (got == Kind::text && !rtde::warning(payload).empty()) said_ = rtde::warning(payload);
      if (got == kind) return payload;
    }
  }
  std::string ask(Kind kind, const std::string& package) {
    if (const Error error = send(package)) throw Refused{"the connection is lost (" + error.message() + ")"};
    return answer(kind);
  }

  void connect(bool first) {
    said_.clear();
    try {
      negotiate(first);
      start_program(first);
    } catch (const Refused& refused) {
      stream_.reset();
      throw Refused{refused.why + (said_.empty() ? "" : "; it says \"" + in_one_line(said_) + '"')};
    }
  }
  void negotiate(bool first) {
    heard_.clear();
    Error error;
    // A controller that is only starting refuses connections.
    for (const auto until = Now::now() + opening_;; std::this_thread::sleep_for(kRetry)) {
      stream_.emplace(context_);
      error = complete(*stream_, opening_, [&](auto done) { stream_->async_connect(rtde_at_, done); });
      if (!first || error != asio::error::connection_refused || Now::now() > until) break;
    }
    if (!error) stream_->socket().set_option(tcp::no_delay{true}, error);
    if (error)
      throw Refused{"no controller is there (" + error.message() + "); check the address, and that RTDE is enabled"};
    if (ask(Kind::protocol, rtde::request_protocol()) != "\1")
      throw Refused{"the controller does not speak version 2 of RTDE"};
    const std::string version = ask(Kind::controller, rtde::package(Kind::controller));
    std::string_view rest = version;
    if (version.size() != 16) throw Refused{"the controller does not say its version"};
    const auto major = rtde::take<std::uint32_t>(rest), minor = rtde::take<std::uint32_t>(rest);
    if (major < 5 || (major == 5 && minor < kLeastMinor))
      throw Refused{
          fmt::format("the controller has PolyScope {}.{}; it must be 5.{} or later", major, minor, kLeastMinor)};
    const bool has_torque = major > 5 ? major > 10 || minor >= 11 : minor >= 23;
    if (only_torques_ && !has_torque)
      throw Refused{
          fmt::format("the controller has PolyScope {}.{}; joints need direct torque control, which 5.23 and 10.11 "
                      "have; with space CARTESIAN it follows set points",
                      major, minor)};
    if (first) {
      drive_ = torques_ && has_torque ? Drive::torque : Drive::pose;
      name_ = fmt::format("Universal Robots at {}, PolyScope {}.{}, {}", where_, major, minor,
                          drive_ == Drive::torque ? "direct torque" : "servoj");
    }
    recipe(Kind::outputs, rtde::request_outputs(kRate_hz), rtde::kOutputs, rtde::kOutputTypes, out_);
    recipe(Kind::inputs, rtde::request_inputs(), rtde::kInputs, rtde::kInputTypes, in_);
    if (ask(Kind::start, rtde::package(Kind::start)) != "\1") throw Refused{"the controller does not start RTDE"};
  }
  void recipe(Kind kind, const std::string& request, std::string_view names, std::string_view types,
              std::uint8_t& number) {
    const std::string answered = ask(kind, request);
    if (answered.empty()) throw Refused{"the controller gives no recipe"};
    number = static_cast<std::uint8_t>(answered.front());
    if (const std::string refused = rtde::first_refused(names, types, std::string_view{answered}.substr(1));
        !refused.empty())
      throw Refused{"the controller refuses " + refused +
                    (refused.ends_with("IN_USE") ? "; another program writes it: end that one, or a fieldbus" : "")};
  }
  /// Sends the program, and waits until it runs. The sensor is zeroed at the first one only: later on it may touch something.
  void start_program(bool first) {
    id_ = static_cast<std::int32_t>(Now::now().time_since_epoch().count() & 0x3fffffff) | 1;
    beast::tcp_stream programs{context_};
    bool sent = false;
    for (const auto end = Now::now() + kStarting; Now::now() < end && going_;) {
      if (!read_states() || send(next({}))) throw Refused{"the connection is lost"};
      if (const std::string why = stopped_by(state_); !why.empty()) throw Refused{why};
      if (state_.program == id_ && state_.runtime_state == kPlaying) {
        if (first) first_ = state_;
        return;
      }
      if (std::exchange(sent, true)) continue;
      const std::string text = program(id_, drive_, first);
      Error error = complete(programs, opening_, [&](auto done) { programs.async_connect(programs_at_, done); });
      if (!error)
        error = complete(programs, opening_, [&](auto done) { asio::async_write(programs, asio::buffer(text), done); });
      if (error) throw Refused{"the controller takes no program (" + error.message() + ")"};
    }
    throw Refused{"the controller does not start the program; put it into remote control, and enable its interfaces"};
  }

  /// The newest state, of at least one more package. False: the connection is lost.
  bool read_states() {
    for (bool any = false;;) {
      const std::size_t size = whole();
      if (size == 0) {
        if (any) return true;
        if (hear(kSilence)) return false;
        continue;
      }
      if (static_cast<Kind>(heard_[2]) == Kind::data) {
        const auto state = rtde::read_state(std::string_view{heard_}.substr(rtde::kHeader, size - rtde::kHeader), out_);
        if (!state) return false;
        state_ = *state;
        any = true;
      }
      heard_.erase(0, size);
    }
  }
  std::string next(const Command& c) {
    return rtde::set_point(in_, {static_cast<std::int32_t>(++count_), static_cast<std::int32_t>(c.motion), c.numbers});
  }
  Command wanted() {
    const auto now = Now::now();
    if (commands_.take(command_)) commanded_at_ = now;
    return fault_ || now - commanded_at_ > kSilence ? Command{} : command_;
  }
  void exchange() {
    const bool heard = read_states();
    fault_ = fault_ || (heard && !stopped_by(state_).empty());
    // A program that has ended by itself has heard nothing for too long: as good as a lost connection.
    if (heard && (fault_ || state_.program != kEndedByItself)) {
      fault_ = fault_ || state_.program != id_ || state_.runtime_state != kPlaying;
      if (!send(next(wanted()))) return readings_.put({state_, fault_, false});
    }
    stream_.reset();
    readings_.put({state_, fault_, true});
  }
  void run() {
    opening_ = kReopening;
    while (going_) {
      if (stream_) {
        exchange();
        continue;
      }
      std::this_thread::sleep_for(kRetry);
      try {
        if (going_) connect(false);
      } catch (const Refused&) {
        fault_ = fault_ || !stopped_by(state_).empty();
        readings_.put({state_, fault_, true});
      }
      commanded_at_ = {};  // of before
    }
    if (!stream_) return;
    send(next({Motion::end, {}}));
    send(rtde::package(Kind::pause));
  }

  std::string where_;
  bool torques_, only_torques_;
  asio::io_context context_;
  tcp::resolver::results_type rtde_at_, programs_at_;
  std::optional<beast::tcp_stream> stream_;  ///< none: no connection
  std::string heard_;
  std::string said_;  ///< the last warning of its log before it starts
  std::string name_;
  Drive drive_ = Drive::pose;
  std::uint8_t out_ = 0, in_ = 0;  ///< recipes
  std::int32_t id_ = 0;            ///< of the program
  std::uint32_t count_ = 0;
  rtde::State state_, first_;
  bool fault_ = false;
  Command command_;
  Now::time_point commanded_at_;
  Newest<Reading> readings_;
  Newest<Command> commands_;
  Duration opening_ = kOpening;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

using Square = Eigen::Matrix<double, 6, 6>;
Vector6 vector_of(const Numbers& n) {
  return Vector6{n.data()};
}
Numbers numbers_of(const Vector6& v) {
  Numbers n;
  std::copy_n(v.data(), n.size(), n.begin());
  return n;
}

/// The arm of the scene, which a robot that follows torques needs: joints always, a tool of six axes where the scene names it.
template <int N>
std::optional<ArmModel> arm_of(const DriverOptions& o) {
  const bool given = o.scene.robot && o.scene.robot->arm;
  if (N != kJointPort && (N != 6 || !given)) return {};
  const std::size_t joints = given ? o.scene.robot->arm->parameters->joints.size() : 0;
  if (joints != 6)
    throw ConfigError{
        fmt::format("--robot ur:{}: robot.arm of the scene has {} joints; it must be the robot's, with 6, as "
                    "arm {{ file: \"ur5e\" }}",
                    o.arguments, joints)};
  return ArmModel{*o.scene.robot->arm->parameters};
}

/// A robot of Universal Robots, in axes of its base; with three axes or one its tool keeps its attitude.
template <int N>
class UrRobot final : public Robot<N> {
 public:
  static constexpr bool kDrivesJoints = true;

  explicit UrRobot(const DriverOptions& o)
      : arm_{arm_of<N>(o)}, controller_{o.arguments, arm_.has_value(), N == kJointPort} {
    reading_.state = controller_.first();
    start_ = vector_of(reading_.state.pose);
    if (controller_.drive() == Drive::pose) arm_.reset();
    if (!arm_) return;
    look();
    if (!(lever_.norm() < kFarthestTool_m))
      throw ConfigError{
          fmt::format("--robot ur:{}: the tool is {:.2f} m from the flange of robot.arm of the scene; it must be "
                      "less than {:g} m: take the arm of this robot, in axes of the controller's base",
                      o.arguments, lever_.norm(), kFarthestTool_m)};
  }

  [[nodiscard]] RobotInfo info() const override {
    RobotInfo info{.name = controller_.name(), .watchdog = to_seconds(kSilence)};
    if (N != kJointPort) info.limits.speed_m_per_s = kMostSpeed_m_per_s;
    if (controller_.drive() == Drive::pose) info.servo = kServo;
    return info;
  }
  RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept override {
    const bool fresh = controller_.take(reading_);
    if (arm_) look();
    RobotSample<N> sample = of(reading_.state);
    gain_ = reading_.lost ? 0.0 : std::min(1.0, gain_ + tick.ended / kForceReturns);
    if (reading_.lost) sample.v = Velocity<N>{Velocity<N>::Vector::Constant(std::numeric_limits<double>::quiet_NaN())};
    sample.status = reading_.fault ? HardwareStatus::fault : fresh ? HardwareStatus::ok : HardwareStatus::stale;
    return sample;
  }
  void actuate(const RobotCommand<N>& c) noexcept override {
    Vector6 numbers = start_;
    if constexpr (N == kJointPort) {
      numbers = c.f.vec().template head<6>();
    } else if constexpr (N == 6) {
      if (arm_)
        numbers = jacobian_.transpose() * c.f.vec();
      else
        numbers << c.x_d.translation(), rotation_vector(c.x_d.attitude());
    } else {
      numbers.head<N>() = c.x_d.translation();
    }
    if (arm_) numbers *= gain_;
    controller_.push({Motion::move, numbers_of(numbers)});
  }
  void start() noexcept override { controller_.follow_priority_of_caller(); }
  void release() noexcept override { controller_.push({}); }
  [[nodiscard]] std::string trouble() const override {
    return reading_.fault ? controller_.trouble(reading_.state) : std::string{};
  }

 private:
  /// At the joints' positions: the Jacobian of the controller's tool, which is `lever_` from the flange.
  void look() noexcept {
    const ArmModel::Pose pose = arm_->pose(vector_of(reading_.state.q));
    jacobian_ = arm_->jacobian(pose);
    lever_ = vector_of(reading_.state.pose).head<3>() - pose.tool;
    for (int i = 0; i < 6; ++i) jacobian_.col(i).head<3>() += jacobian_.col(i).tail<3>().cross(lever_);
  }
  [[nodiscard]] RobotSample<N> of(const rtde::State& s) const noexcept {
    RobotSample<N> sample;
    const Vector6 pose = vector_of(s.pose), on_environment = -vector_of(s.force);
    if constexpr (N == kJointPort) {
      using Joints = typename Force<N>::Vector;
      const auto joints = [](const Vector6& six) {
        Joints all = Joints::Zero();
        all.template head<6>() = six;
        return all;
      };
      sample.x = Position<N>{joints(vector_of(s.q))};
      sample.v = Velocity<N>{joints(vector_of(s.qd))};
      sample.f_environment = Force<N>{joints(jacobian_.transpose() * on_environment)};
    } else {
      if constexpr (N == 6)
        sample.x = Position<6>{pose.head<3>(), rotation(pose.tail<3>())};
      else
        sample.x = Position<N>{pose.head<N>()};
      sample.v = Velocity<N>{vector_of(s.speed).template head<N>()};
      sample.f_environment = Force<N>{on_environment.template head<N>()};
    }
    return sample;
  }

  std::optional<ArmModel> arm_;  ///< of a robot that follows torques
  Controller controller_;
  Reading reading_;
  Vector6 start_;
  Square jacobian_ = Square::Zero();
  Vector3d lever_ = Vector3d::Zero();
  double gain_ = 1.0;  ///< of torques
};

}  // namespace

void add_ur(Registry& all) {
  all.robots.add<UrRobot>("ur", "ur:HOST[:PORT], a robot of Universal Robots by RTDE: set points, or torques");
}

}  // namespace twoport
