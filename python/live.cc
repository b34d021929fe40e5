#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/hardware/sensor_zero.h"
#include "common/link/zero_requests.h"
#include "common/platform/live_link.h"
#include "common/runtime/cycle.h"
#include "master/master_node.h"
#include "python/bind.h"
#include "slave/slave_node.h"

namespace twoport::python {
namespace {

struct LiveOutput {
  using PythonClass = void;
  double t_s;
  py::array_t<double> force, set_point;
  std::string mode;
};

class AnyLive : public AnySide {
 public:
  virtual double wait() = 0;
  virtual LiveOutput step(const py::object& x, const py::object& v, const py::object& f, bool held) = 0;
  [[nodiscard]] virtual std::int64_t missed() const = 0;
  virtual void zero_force_sensor() = 0;
  [[nodiscard]] virtual SensorRest sensor() const = 0;
  [[nodiscard]] virtual double energy_j() const = 0;
  [[nodiscard]] virtual py::object peer_x() const = 0;
  [[nodiscard]] virtual py::object peer_f() const = 0;
};
/// For the two classes of Python.
struct AnyLiveMaster : AnyLive {};
struct AnyLiveSlave : AnyLive {};

/// Node, link and clock of one side.
template <int N, class Base>
class Live final : public Base {
 public:
  static constexpr bool kMaster = std::is_same_v<Base, AnyLiveMaster>;
  using Node = std::conditional_t<kMaster, MasterNode<N>, SlaveNode<N>>;
  using Clock = std::conditional_t<kMaster, MasterClock, SlaveClock>;

  Live(const Scene& s, const LiveArguments& a)
      : scene_{s},
        rate_hz_{kMaster ? s.master_rate_hz : s.slave_rate_hz},
        link_{kMaster ? Side::master : Side::slave, scene_, a},
        node_{scene_.control, scene_.schedule} {}

  double wait() override {
    if (!waited_) waited_ = next();
    return to_seconds(waited_->now.time_since_epoch()).si();
  }
  LiveOutput step(const py::object& x, const py::object& v, const py::object& f, bool held) override {
    const int n = dof();
    const auto position = position_from<N>(x, "x", n);
    const Velocity<N> velocity{numbers_from<N>(v, "v", n)};
    const std::optional<Force<N>> given =
        f.is_none() ? std::nullopt
                    : std::optional{Force<N>{numbers_from<N>(f, kMaster ? "applied" : "f_environment", n)}};
    wait();
    const Tick<Clock> tick = *std::exchange(waited_, std::nullopt);
    if (!link_.refusal().empty()) throw IoError{std::string{link_.refusal()}};
    link_.met(node_);
    say_of_sensor();
    LiveOutput result{to_seconds(tick.now.time_since_epoch()).si(), {}, {}, {}};
    if constexpr (kMaster) {
      GivenReading<DeviceSample<N>> device;
      device.sample.x = position;
      device.sample.v = velocity;
      device.sample.applied = given.value_or(command_);
      device.sample.held = held;
      const auto out = run_cycle(node_, device, link_.mail(), tick);
      command_ = out.command;
    } else {
      GivenReading<RobotSample<N>> robot;
      robot.sample.x = position;
      robot.sample.v = velocity;
      if (given) robot.sample.f_environment = sensor_.step(*given, robot.sample.x, command_, tick.ended, true);
      const auto out = run_cycle(node_, robot, link_.mail(), tick);
      command_ = out.command.f;
      result.set_point = to_array(out.command.x_d, n);
    }
    link_.note();
    result.force = to_array(command_.vec(), n);
    result.mode = to_string(node_.mode());
    return result;
  }
  [[nodiscard]] int dof() const override { return scene_.coordinates(); }
  [[nodiscard]] double rate_hz() const override { return rate_hz_; }
  [[nodiscard]] std::string mode() const override { return to_string(node_.mode()); }
  [[nodiscard]] std::int64_t missed() const override { return missed_; }
  void zero_force_sensor() override { sensor_.ask(); }
  [[nodiscard]] SensorRest sensor() const override { return sensor_.rest(); }
  [[nodiscard]] double energy_j() const override {
    if constexpr (kMaster) {
      return node_.observed().si();
    } else {
      return node_.delivered().si();
    }
  }
  [[nodiscard]] py::object peer_x() const override {
    return of_peer([](const PortReport<N>& r) -> const auto& { return r.x; });
  }
  [[nodiscard]] py::object peer_f() const override {
    return of_peer([](const PortReport<N>& r) -> const auto& { return r.f.vec(); });
  }
  [[nodiscard]] std::optional<double> round_trip_s() const override { return round_trip_of(link_.known()); }

 private:
  /// Requests of the master to zero the force sensor, and the slave's answers to them.
  void say_of_sensor() noexcept {
    auto& transport = link_.mail().transport();
    const EnvironmentMessage& heard = transport.heard_environment();
    if constexpr (kMaster) {
      if (!sensor_.is_used()) return;
      sensor_.step(heard, said_);
    } else {
      if (heard.number == 0) return;
      if (answers_.hear(heard, transport.pairings())) sensor_.ask();
      said_.answer = EnvironmentAnswer::real;
      said_.number = heard.number;
      answers_.say(sensor_.rest(), said_);
    }
    transport.say_environment(said_);
  }

  using Now = std::chrono::steady_clock;

  py::object of_peer(auto get) const {
    const PeerState<N>& peer = link_.known();
    return peer.has_report ? py::object{to_array(get(peer.newest), dof())} : py::none();
  }
  /// Sleeps to the tick after the last one. Where that is over by more than a period, it is the newest one that has begun; those
  /// before it are left out.
  Tick<Clock> next() {
    const Seconds period{1.0 / rate_hz_};
    const double passed = std::chrono::duration<double>(Now::now() - start_).count();
    const std::int64_t k = std::max(k_ + 1, static_cast<std::int64_t>(std::floor(passed * rate_hz_)));
    const Duration at = tick_time(k, rate_hz_);
    {
      const py::gil_scoped_release released;
      std::this_thread::sleep_until(start_ + at);
    }
    const std::int64_t periods = k - std::exchange(k_, k);
    missed_ += periods - 1;
    return {Instant<Clock>{at}, period, static_cast<double>(periods) * period};
  }

  Scene scene_;
  double rate_hz_;
  LiveLink<N> link_;
  Node node_;
  Force<N> command_;
  std::conditional_t<kMaster, ZeroRequests, SensorZero<N>> sensor_{};
  ZeroAnswers answers_;
  EnvironmentMessage said_{.number = 1};
  std::optional<Tick<Clock>> waited_;  ///< of wait(), for step()
  Now::time_point start_ = Now::now();
  std::int64_t k_ = 0, missed_ = 0;
};

template <class Base>
std::unique_ptr<Base> open(const SceneOfText& s, const char* what, const std::string& address, const std::string& key) {
  static_cast<void>(over_a_link(s, what));
  LiveArguments arguments;
  arguments.address = address;
  arguments.key = key;
  const Scene scene = parse_scene(s.text, s.source, s.overrides, SceneFor::live);
  return for_dof(scene.dof,
                 [&]<int N>() -> std::unique_ptr<Base> { return std::make_unique<Live<N, Base>>(scene, arguments); });
}

}  // namespace

void add_live(py::module_& module) {
  using namespace py::literals;

  py::class_<LiveOutput>(module, "LiveOutput", "What a live side computes in a tick.")
      .def_readonly("t_s", &LiveOutput::t_s, "Time of the tick, from the side's start [s].")
      .def_readonly("force", &LiveOutput::force,
                    "Until the next tick: at a master the force at its port, push the hand with -force; at a slave the "
                    "force on the robot [N], dof 6: [N], [N m].")
      .def_readonly("set_point", &LiveOutput::set_point, "Of a slave: where the robot is wanted [m], dof 6: 7 numbers.")
      .def_readonly("mode", &LiveOutput::mode, kModes);

  side_class<AnyLive>(module, "Live", "What LiveMaster and LiveSlave share.",
                      "a live side cannot be copied or pickled: it has a socket")
      .def_property_readonly("missed", &AnyLive::missed, "Ticks left out so far, as step() was called too late.")
      .def("zero_force_sensor", &AnyLive::zero_force_sensor,
           "Asks the slave to take away what the robot's force sensor reads while nothing is pressed; the next 0.5 s "
           "decide.")
      .def_property_readonly(
          "zero_answer",
          [](const AnyLive& side) { return std::string{side.sensor().asked ? "" : sentence(side.sensor().answer)}; },
          "What has become of the newest request: a sentence; empty while it waits.")
      .def_property_readonly(
          "sensor_drift_n",
          [](const AnyLive& side) {
            const double drift_n = side.sensor().drift_n;
            return drift_n < 0.0 ? std::nullopt : std::optional{drift_n};
          },
          "Force that the sensor read when nothing was pressed last [N]; None: not known, as at a master before its "
          "first request.")
      .def_property_readonly(
          "peer_x", &AnyLive::peer_x,
          "Position of the other side, as its newest report says [m], dof 6: 7 numbers; with space JOINTS of "
          "each joint [rad]. None: none has come.")
      .def_property_readonly(
          "peer_f", &AnyLive::peer_f,
          "Of a master's peer the force on the robot, of a slave's the force displayed, likewise [N].")
      .def(
          "wait", &AnyLive::wait,
          R"(Waits for the next tick and returns its time, from the side's start [s]: read your hardware now, then call step().)");

  py::class_<AnyLiveMaster, AnyLive>(
      module, "LiveMaster",
      R"(A master over UDP, in place of twoport-master: a device of yours, a slave anywhere.

scene: as that of the slave; its device and operator are not used
peer: ADDRESS:PORT of the slave
key: file of twoport-keygen; without one only addresses of this machine
Errors: ValueError; OSError where the two sides cannot work together.)")
      .def(py::init([](const SceneOfText& s, const std::string& peer, const std::string& key) {
             return open<AnyLiveMaster>(s, "LiveMaster", peer, key);
           }),
           "scene"_a, "peer"_a, py::kw_only(), "key"_a = "")
      .def_property_readonly("observed_j", &AnyLive::energy_j,
                             "Energy that the hand has put in so far, E(0) not included [J].")
      .def("step", &AnyLive::step, "x"_a, "v"_a, "applied"_a = py::none(), "held"_a = true,
           R"(One tick: exchanges packets and returns the force. Waits for the tick first, unless wait() has.

x, v: position [m] and velocity [m/s] of the handle, dof 6: 7 numbers, and twist; with space JOINTS of each joint [rad], [rad/s]
applied: force held at the port since the last step [N]; None: the one returned then
held: does the operator hold the handle?)");
  py::class_<AnyLiveSlave, AnyLive>(module, "LiveSlave",
                                    R"(A slave over UDP, in place of twoport-slave: a robot of yours. As LiveMaster.

listen: ADDRESS:PORT)")
      .def(py::init([](const SceneOfText& s, const std::string& listen, const std::string& key) {
             return open<AnyLiveSlave>(s, "LiveSlave", listen, key);
           }),
           "scene"_a, "listen"_a, py::kw_only(), "key"_a = "")
      .def_property_readonly("delivered_j", &AnyLive::energy_j, "Net energy that has left the link into the robot [J].")
      .def(
          "step",
          [](AnyLiveSlave& side, const py::object& x, const py::object& v, const py::object& f) {
            return side.step(x, v, f, true);
          },
          "x"_a, "v"_a, "f_environment"_a = py::none(),
          R"(One tick: exchanges packets and returns force and set point of the robot. Waits for the tick first, unless wait() has.

x, v: position [m] and velocity [m/s] of the robot, dof 6: 7 numbers, and twist; with space JOINTS of each joint [rad], [rad/s]
f_environment: the force sensor's, of the robot on the environment [N]; None: 0)");
}

}  // namespace twoport::python
