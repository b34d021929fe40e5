#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/built_for.h"
#include "common/hardware/device.h"
#include "common/hardware/modulated_transformer.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"
#include "common/link/report.h"
#include "common/runtime/cycle.h"
#include "common/wire/header.h"
#include "lab/engine/both_nodes.h"
#include "master/master_node.h"
#include "python/bind.h"
#include "slave/slave_node.h"

namespace twoport::python {
namespace {

/// Who sends: the side, and what its scene must share with the receiver's.
struct Sender {
  Side side;
  std::vector<SharedField> fields;
  int dof;  ///< or number of joints
};

/// What one side tells the other one in a tick. Immutable.
struct Message {
  using PythonClass = void;
  std::variant<Report<1>, Report<3>, Report<6>, Report<kJointPort>> report;
  std::shared_ptr<const Sender> sender;

  template <class Use>
  auto use(Use use) const {
    return std::visit(use, report);
  }
};

/// The link of one node: what has been handed in since the last tick, and what the node sends.
template <int N>
class InHand {
 public:
  void put(const Report<N>& r) { arrived_.push_back(r); }
  std::optional<Report<N>> take_sent() { return std::exchange(sent_, std::nullopt); }

  template <class Visit>
  void poll(Duration, Visit visit) noexcept {
    for (const Report<N>& r : arrived_) visit(r);
    arrived_.clear();
  }
  void send(const auto& r, Duration) noexcept { sent_ = r; }

 private:
  std::vector<Report<N>> arrived_;
  std::optional<Report<N>> sent_;
};

/// Ticks of a side, by its own clock.
template <class Clock>
class Ticks {
 public:
  explicit Ticks(double rate_hz) : dt_{1.0 / rate_hz} {}
  Tick<Clock> at(double t_s) {
    if (!(t_s >= 0.0 && t_s < 1e9)) throw ConfigError{fmt::format("t_s is {}; it must be 0 to 1e9", t_s)};
    const Duration now = to_duration(t_s);
    double periods = 1.0;
    if (before_) {
      if (now <= *before_)
        throw ConfigError{fmt::format("t_s is {}; it must be after the last tick, {}", t_s, to_seconds(*before_).si())};
      periods = std::max(1.0, std::round(to_seconds(now - *before_).si() / dt_.si()));
    }
    before_ = now;
    return {Instant<Clock>{now}, dt_, periods * dt_};
  }

 private:
  Seconds dt_;
  std::optional<Duration> before_;
};

struct MasterResult {
  using PythonClass = void;
  py::array_t<double> force, wanted;
  std::shared_ptr<Message> message;
  double dissipated_j, undissipated_j;
  std::string mode;
};
struct SlaveResult {
  using PythonClass = void;
  py::array_t<double> force, x_d, v_d;
  std::shared_ptr<Message> message;
  double dissipated_j;
  std::string mode;
};

class AnyNode : public AnySide {
 public:
  virtual void receive(const Message& message) = 0;
  [[nodiscard]] virtual py::dict packets() const = 0;
};

template <int N, class Base>
class WithLink : public Base {
 public:
  WithLink(Side side, const Scene& s)
      : mail_{lab::mailbox_of<N>(side, s, InHand<N>{})},
        rate_hz_{side == Side::master ? s.master_rate_hz : s.slave_rate_hz},
        self_{std::make_shared<Sender>(Sender{side, shared_fields(s), s.coordinates()})} {}
  void receive(const Message& message) override {
    if (message.sender->side == self_->side)
      throw ConfigError{fmt::format("message: of a {}; this node takes those of a {}", to_string(self_->side),
                                    to_string(self_->side == Side::master ? Side::slave : Side::master))};
    const auto* report = std::get_if<Report<N>>(&message.report);
    if (report == nullptr || message.sender->dof != dof())
      throw ConfigError{fmt::format("message: of {} degrees of freedom; this node has {}", message.sender->dof, dof())};
    for (std::size_t i = 0; i < self_->fields.size(); ++i)
      if (message.sender->fields[i].digest != self_->fields[i].digest)
        throw ConfigError{
            fmt::format("message: {} of its sender's scene differs from this node's", self_->fields[i].path)};
    if (report->finite()) mail_.transport().put(*report);
  }
  [[nodiscard]] int dof() const override { return self_->dof; }
  [[nodiscard]] double rate_hz() const override { return rate_hz_; }
  [[nodiscard]] py::dict packets() const override {
    const PacketCounts& c = mail_.counts();
    using namespace py::literals;
    return py::dict("sent"_a = c.sent, "received"_a = c.received, "lost"_a = c.lost, "late"_a = c.late,
                    "duplicated"_a = c.duplicated, "rejected"_a = c.rejected, "stale"_a = c.stale);
  }
  [[nodiscard]] std::optional<double> round_trip_s() const override { return round_trip_of(mail_.known()); }

 protected:
  std::shared_ptr<Message> take_sent() {
    const auto sent = mail_.transport().take_sent();
    return sent ? std::make_shared<Message>(Message{*sent, self_}) : nullptr;
  }

  Mailbox<N, InHand<N>> mail_;

 private:
  double rate_hz_;
  std::shared_ptr<const Sender> self_;
};

class AnyMaster : public AnyNode {
 public:
  virtual MasterResult step(double t_s, const py::object& x, const py::object& v, const py::object& applied,
                            bool held) = 0;
  [[nodiscard]] virtual double observed_j() const = 0;
  virtual void control(std::optional<bool> clutched, const std::optional<std::vector<int>>& locked,
                       std::optional<double> motion, std::optional<double> force) = 0;
  virtual void rehome() = 0;
  [[nodiscard]] virtual bool rehomes() const = 0;
};

template <int N>
class MasterOf final : public WithLink<N, AnyMaster> {
 public:
  explicit MasterOf(const Scene& s)
      : WithLink<N, AnyMaster>{Side::master, s},
        ticks_{s.master_rate_hz},
        node_{s.control, s.schedule},
        engage_s_{s.device_mount.engage_s} {}
  MasterResult step(double t_s, const py::object& x, const py::object& v, const py::object& applied,
                    bool held) override {
    GivenReading<DeviceSample<N>> device;
    const int n = this->dof();
    device.sample.x = position_from<N>(x, "x", n);
    device.sample.v = Velocity<N>{numbers_from<N>(v, "v", n)};
    device.sample.applied = applied.is_none() ? command_ : Force<N>{numbers_from<N>(applied, "applied", n)};
    device.sample.held = held;
    const Tick<MasterClock> tick = ticks_.at(t_s);
    DeviceTruth<N> truth;
    if (works_) transformer_.step(device.sample, truth, false, tick.ended.si(), engage_s_);
    const auto out = run_cycle(node_, device, this->mail_, tick);
    command_ = works_ ? transformer_.to_hand(out.command) : out.command;
    return {to_array(command_.vec(), n), to_array(out.wanted.vec(), n), this->take_sent(),
            out.dissipated.si(),         out.undissipated.si(),         to_string(out.mode)};
  }
  [[nodiscard]] std::string mode() const override { return to_string(node_.mode()); }
  [[nodiscard]] double observed_j() const override { return node_.observed().si(); }
  void control(std::optional<bool> clutched, const std::optional<std::vector<int>>& locked,
               std::optional<double> motion, std::optional<double> force) override {
    HandControls c = transformer_.controls();
    if (clutched) c.clutched = *clutched;
    if (locked) {
      c.locked = 0;
      for (const int axis : *locked) {
        if (axis < 0 || axis >= this->dof())
          throw ConfigError{fmt::format("locked: {}; an axis is 0 to {}", axis, this->dof() - 1)};
        c.locked |= 1u << axis;
      }
    }
    if (motion && !(*motion > 0.0 && *motion <= 1.0))
      throw ConfigError{fmt::format("motion is {}; it must be above 0 and at most 1", *motion)};
    if (force && !(*force >= 0.0 && *force <= 1.0))
      throw ConfigError{fmt::format("force is {}; it must be 0 to 1", *force)};
    c.motion = motion.value_or(c.motion);
    c.force = force.value_or(c.force);
    transformer_.set(c);
    works_ = true;
  }
  void rehome() override {
    transformer_.rehome();
    works_ = true;
  }
  [[nodiscard]] bool rehomes() const override { return transformer_.rehomes(); }

 private:
  Ticks<MasterClock> ticks_;
  MasterNode<N> node_;
  ModulatedTransformer<N> transformer_;
  double engage_s_;
  bool works_ = false;  ///< from the first use of the transformer on
  Force<N> command_;    ///< at the hand
};

class AnySlave : public AnyNode {
 public:
  virtual SlaveResult step(double t_s, const py::object& x, const py::object& v, const py::object& f_environment,
                           bool ideal) = 0;
  [[nodiscard]] virtual double delivered_j() const = 0;
};

template <int N>
class SlaveOf final : public WithLink<N, AnySlave> {
 public:
  explicit SlaveOf(const Scene& s)
      : WithLink<N, AnySlave>{Side::slave, s}, ticks_{s.slave_rate_hz}, node_{s.control, s.schedule} {}
  SlaveResult step(double t_s, const py::object& x, const py::object& v, const py::object& f_environment,
                   bool ideal) override {
    GivenReading<RobotSample<N>> robot;
    const int n = this->dof();
    robot.sample.x = position_from<N>(x, "x", n);
    robot.sample.v = Velocity<N>{numbers_from<N>(v, "v", n)};
    if (!f_environment.is_none())
      robot.sample.f_environment = Force<N>{numbers_from<N>(f_environment, "f_environment", n)};
    robot.sample.ideal = ideal;
    const auto out = run_cycle(node_, robot, this->mail_, ticks_.at(t_s));
    return {to_array(out.command.f.vec(), n),
            to_array(out.command.x_d, n),
            to_array(out.command.v_d.vec(), n),
            this->take_sent(),
            out.dissipated.si(),
            to_string(out.mode)};
  }
  [[nodiscard]] std::string mode() const override { return to_string(node_.mode()); }
  [[nodiscard]] double delivered_j() const override { return node_.delivered().si(); }

 private:
  Ticks<SlaveClock> ticks_;
  SlaveNode<N> node_;
};

/// Makes a node of a scene, which must have a link.
template <class Any, template <int> class Of>
auto made(const char* name) {
  return [name](const SceneOfText& s) {
    const Scene& scene = over_a_link(s, name);
    return for_dof(scene.dof, [&]<int N>() -> std::unique_ptr<Any> { return std::make_unique<Of<N>>(scene); });
  };
}

}  // namespace

void add_nodes(py::module_& module) {
  using namespace py::literals;
  const auto of_report = [](auto use) { return [use](const Message& m) { return m.use(use); }; };
  const auto numbers = [](auto get) {
    return [get](const Message& m) { return m.use([&](const auto& r) { return to_array(get(r), m.sender->dof); }); };
  };

  py::class_<Message, std::shared_ptr<Message>>(
      module, "Message",
      R"(What one side tells the other in a tick. Keep it as long as your network delays it, then hand it to
receive() of the other node. Immutable.)")
      .def_property_readonly(
          "dof", [](const Message& m) { return m.sender->dof; }, kDof)
      .def_property_readonly("sequence", of_report([](const auto& r) { return r.sequence; }), "Number, from 1.")
      .def_property_readonly("sent_s", of_report([](const auto& r) { return to_seconds(Duration{r.sent_ns}).si(); }),
                             "Time of the tick by the sender's clock [s].")
      .def_property_readonly("x", numbers([](const auto& r) { return r.x; }),
                             "Position of the port [m], dof 6: 7 numbers, position and attitude w x y z.")
      .def_property_readonly("v", numbers([](const auto& r) { return r.v.vec(); }),
                             "Velocity of the port [m/s], dof 6: [m/s], [rad/s].")
      .def_property_readonly(
          "f", numbers([](const auto& r) { return r.f.vec(); }),
          "Force: the slave's is the one it returns, the master's the one it displays [N], dof 6: [N], [N m].")
      .def_property_readonly("energy_in_j", of_report([](const auto& r) { return r.energy_in_j; }),
                             "Energy that has entered the link at the sender since the session began [J].")
      .def_property_readonly("mode", of_report([](const auto& r) { return std::string{to_string(r.mode)}; }),
                             "Mode of the sender.")
      .def("__reduce_ex__",
           not_pickled("a Message cannot be copied or pickled: it is immutable, and of a node of this process"))
      .def("__repr__", [](const Message& m) {
        return m.use([](const auto& r) {
          return fmt::format("<twoport.Message {} of {:.9g} s, {}>", r.sequence, to_seconds(Duration{r.sent_ns}).si(),
                             to_string(r.mode));
        });
      });

  py::class_<MasterResult>(module, "MasterOutput", "What the master computes in a tick.")
      .def_readonly("force", &MasterResult::force,
                    "Force at the master port until the next tick [N], dof 6: [N], [N m]. force.v is power into the "
                    "network: push the hand with -force.")
      .def_readonly("wanted", &MasterResult::wanted, "The same before passivity control.")
      .def_readonly("message", &MasterResult::message, "Message for the slave; None where a deadband sends none.")
      .def_readonly("dissipated_j", &MasterResult::dissipated_j, "Dissipated by the controller in this tick [J].")
      .def_readonly("undissipated_j", &MasterResult::undissipated_j, "Deficit that remains in the account [J].")
      .def_readonly("mode", &MasterResult::mode, kModes);
  py::class_<SlaveResult>(module, "SlaveOutput", "What the slave computes in a tick.")
      .def_readonly("force", &SlaveResult::force,
                    "Coupling force on the robot until the next tick [N], dof 6: [N], [N m].")
      .def_readonly("x_d", &SlaveResult::x_d, "Set point, which an ideal robot follows [m], dof 6: 7 numbers.")
      .def_readonly("v_d", &SlaveResult::v_d, "Velocity of the set point [m/s], dof 6: [m/s], [rad/s].")
      .def_readonly("message", &SlaveResult::message, "Message for the master; None where a deadband sends none.")
      .def_readonly("dissipated_j", &SlaveResult::dissipated_j, "Dissipated by the controller in this tick [J].")
      .def_readonly("mode", &SlaveResult::mode, kModes);

  side_class<AnyNode>(module, "Node", "What MasterNode and SlaveNode share: the end of a link.",
                      "a node cannot be copied or pickled: make one from its scene")
      .def(
          "receive", &AnyNode::receive, "message"_a,
          R"(Hands a message of the other side to the next step(). You decide when, how often and in what order: messages may be
delayed, lost, repeated and reordered. One whose numbers are not finite is dropped, as a link does.
Errors: ValueError for one of this side, of another number of degrees of freedom, or from a scene that differs in what both
sides must share (method, coupling, scales, ...).)")
      .def_property_readonly("packets", &AnyNode::packets,
                             "Messages sent, and received, lost, late, duplicated, rejected, stale so far.");

  py::class_<AnyMaster, AnyNode>(module, "MasterNode",
                                 R"(The master over a link, one tick at a time: motion of the device in, force out.

It is the node of twoport-master and of the laboratory, with the controllers of the scene (control.*), its rates and its
transmission; device, operator, delays and environment of the scene are not used: they are yours.
Errors: ValueError for a scene without a link.)")
      .def(py::init(made<AnyMaster, MasterOf>("MasterNode")), "scene"_a)
      .def("step", &AnyMaster::step, "t_s"_a, "x"_a, "v"_a, py::kw_only(), "applied"_a = py::none(), "held"_a = true,
           R"(One period: takes what has been received, returns the force and the message to send.

t_s: time by the master's clock [s], after that of the last step
x: position of the handle [m], dof 6: 7 numbers, position and attitude w x y z; with space JOINTS, here and in all that follows, a number for
each joint [rad], [rad/s], [N m]
v: its velocity [m/s], dof 6: twist [m/s], [rad/s]
applied: force held at the port since the last step [N]; None: the one returned then
held: does the operator hold the handle?
For numbers that are not finite it applies no force in this tick. Errors: ValueError.)")
      .def(
          "control", &AnyMaster::control, py::kw_only(), "clutched"_a = py::none(), "locked"_a = py::none(),
          "motion"_a = py::none(), "force"_a = py::none(),
          R"(Changes what is given, for the motion after the next step(), as the page's controls do; device_mount.engage_s of the scene is
the ramp.

clutched: the hand moves alone and feels nothing; the robot goes on pressing what it presses
locked: axes of the master's world, from 0, that the robot keeps; [] for none
motion: scale of translations, times the scene's, above 0 and at most 1
force: scale of the force felt, times the scene's, 0 to 1
Errors: ValueError; then nothing changes.)")
      .def("rehome", &AnyMaster::rehome,
           "Makes the hand's present pose the robot's: the set point yields until no force is left, 2 s at most.")
      .def_property_readonly("rehomes", &AnyMaster::rehomes, "Does it re-home?")
      .def_property_readonly("observed_j", &AnyMaster::observed_j,
                             "Energy that the hand has put in so far, E(0) not included [J].");

  py::class_<AnySlave, AnyNode>(
      module, "SlaveNode",
      R"(The slave over a link, one tick at a time: motion of the robot in, force out. As MasterNode.)")
      .def(py::init(made<AnySlave, SlaveOf>("SlaveNode")), "scene"_a)
      .def("step", &AnySlave::step, "t_s"_a, "x"_a, "v"_a, py::kw_only(), "f_environment"_a = py::none(),
           "ideal"_a = false,
           R"(One period: takes what has been received, returns the force on the robot and the message to send.

t_s: time by the slave's clock [s], after that of the last step
x: position of the robot [m], dof 6: 7 numbers, position and attitude w x y z
v: its velocity [m/s], dof 6: twist [m/s], [rad/s]
f_environment: the force sensor's, of the robot on the environment [N], dof 6: [N], [N m]; None: 0
ideal: the robot follows x_d exactly
For numbers that are not finite it applies no force in this tick. Errors: ValueError.)")
      .def_property_readonly("delivered_j", &AnySlave::delivered_j,
                             "Net energy that has left the link into the slave [J].");
}

}  // namespace twoport::python
