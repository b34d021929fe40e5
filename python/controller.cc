#include "common/passivity/controller.h"

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/built_for.h"
#include "common/coupling/layers.h"
#include "common/passivity/observer.h"
#include "common/passivity/passivated.h"
#include "python/bind.h"

namespace twoport::python {
namespace {

Method method_of(const std::string& name) {
  if (const ControllerName* known = find_name(kControllers, name)) return known->method;
  throw ConfigError{fmt::format("method is {}; it must be one of {}", name, fmt::join(names_of(kControllers), ", "))};
}

/// use.operator()<N>() of a port with `dof` degrees of freedom, or `dof` joints.
template <class Use>
auto for_port(int dof, bool joints, Use use) {
  if (joints ? dof < 1 || dof > kJointPort : dof != 1 && dof != 3 && dof != 6)
    throw ConfigError{fmt::format("dof is {}; it must be 1, 3 or 6, or with joints=True 1 to {}", dof, kJointPort)};
  return for_dof(joints ? kJointPort : dof, use);
}

double not_negative(const char* name, double value) {
  if (!(value >= 0.0 && value <= kLargestNumber))
    throw ConfigError{fmt::format("{} is {}; it must be 0 to {}", name, value, kLargestNumber)};
  return value;
}

double positive(const char* name, double value) {
  if (!(value > 0.0 && value <= kLargestNumber))
    throw ConfigError{fmt::format("{} is {}; it must be above 0 and at most {}", name, value, kLargestNumber)};
  return value;
}

/// A one-port whose answer has been computed already.
template <class OutKind, class InKind>
struct Given {
  using Out = OutKind;
  using In = InKind;
  const Out* wanted;
  Out step(const In&, Seconds) const noexcept { return *wanted; }
};

class Controller {
 public:
  using PythonClass = void;
  virtual ~Controller() = default;
  virtual py::array_t<double> step(const py::object& wanted, const py::object& input, double dt_s) = 0;
  [[nodiscard]] virtual double energy_j() const = 0;
  [[nodiscard]] virtual double dissipated_j() const = 0;
  [[nodiscard]] virtual double undissipated_j() const = 0;
};

/// Passivated with the wanted answer as an argument, so that the element may be Python. Of a port of joints the first `count` numbers are used.
template <class Out, class In>
class ControllerOf final : public Controller {
 public:
  ControllerOf(const ControllerOptions& options, Energy initial, int count)
      : port_{Given<Out, In>{&wanted_}, options, initial}, count_{count} {}
  ControllerOf(const ControllerOf&) = delete;
  ControllerOf& operator=(const ControllerOf&) = delete;

  py::array_t<double> step(const py::object& wanted, const py::object& input, double dt_s) override {
    const Seconds dt{positive("dt_s", dt_s)};
    const Out out{numbers_from<Out::kSize>(wanted, "wanted", count_)};
    const In in{numbers_from<In::kSize>(input, "input", count_)};
    if (!all_finite(out, in)) throw ConfigError{"wanted and input must be finite"};
    wanted_ = out;
    return to_array(port_.step(in, dt).vec(), count_);
  }
  [[nodiscard]] double energy_j() const override { return port_.energy().si(); }
  [[nodiscard]] double dissipated_j() const override { return port_.last().dissipated.si(); }
  [[nodiscard]] double undissipated_j() const override { return port_.last().undissipated.si(); }

 private:
  Out wanted_{};
  Passivated<Given<Out, In>> port_;
  int count_;
};

std::unique_ptr<Controller> make_controller(int dof, bool joints, const std::string& method, const std::string& output,
                                            double initial_energy_j, std::optional<double> max_gain, bool unilateral,
                                            bool predict, double mass_kg, double radius_of_gyration_m,
                                            double max_turn_rad) {
  ControllerOptions o;
  o.method = method_of(method);
  o.unilateral = unilateral;
  o.predict = predict;
  o.mass_kg = not_negative("mass_kg", mass_kg);
  o.max_turn_rad = not_negative("max_turn_rad", max_turn_rad);
  o.radius_of_gyration_m = positive("radius_of_gyration_m", radius_of_gyration_m);
  const Energy initial{not_negative("initial_energy_j", initial_energy_j)};
  const bool force = output == "force";
  if (!force && output != "velocity")
    throw ConfigError{fmt::format("output is {}; it must be force or velocity", output)};
  if (!force && (o.method == Method::metric_damping || o.method == Method::force_cone))
    throw ConfigError{
        fmt::format("method is {}; with the output velocity it must be NONE, CLASSIC or FORCE_PROJECTED", method)};
  if (max_gain) (force ? o.max_gain : o.max_mobility_m_per_n_s) = not_negative("max_gain", *max_gain);
  return for_port(dof, joints, [&]<int N>() -> std::unique_ptr<Controller> {
    if (force) return std::make_unique<ControllerOf<Force<N>, Velocity<N>>>(o, initial, dof);
    return std::make_unique<ControllerOf<Velocity<N>, Force<N>>>(o, initial, dof);
  });
}

class Spring {
 public:
  using PythonClass = void;
  virtual ~Spring() = default;
  virtual py::array_t<double> step(const py::object& wanted, const py::object& input) = 0;
  [[nodiscard]] virtual double energy_j() const = 0;
  [[nodiscard]] virtual double share() const = 0;
};

template <int N>
class SpringOf final : public Spring {
 public:
  SpringOf(const EnergySpringOptions& o, Seconds dt, int count)
      : port_{Given<Force<N>, Velocity<N>>{&wanted_}, o}, dt_{dt}, count_{count} {}
  SpringOf(const SpringOf&) = delete;
  SpringOf& operator=(const SpringOf&) = delete;

  py::array_t<double> step(const py::object& wanted, const py::object& input) override {
    const Force<N> f{numbers_from<N>(wanted, "wanted", count_)};
    const Velocity<N> v{numbers_from<N>(input, "input", count_)};
    if (!all_finite(f, v)) throw ConfigError{"wanted and input must be finite"};
    wanted_ = f;
    return to_array(port_.step(v, dt_).vec(), count_);
  }
  [[nodiscard]] double energy_j() const override { return port_.energy().si(); }
  [[nodiscard]] double share() const override { return port_.share(); }

 private:
  Force<N> wanted_{};
  Passivated<Given<Force<N>, Velocity<N>>, EnergySpringOptions> port_;
  Seconds dt_;
  int count_;
};

std::unique_ptr<Spring> make_spring(int dof, double stiffness, double initial_energy_j, bool joints, double mass_kg,
                                    double rotational_stiffness, double inertia_kg_m2, double dt_s) {
  const EnergySpringOptions o{
      .stiffness_n_per_m = positive("stiffness_n_per_m", stiffness),
      .rotational_stiffness_n_m_per_rad = not_negative("rotational_stiffness_n_m_per_rad", rotational_stiffness),
      .mass_kg = not_negative("mass_kg", mass_kg),
      .inertia_kg_m2 = not_negative("inertia_kg_m2", inertia_kg_m2),
      .initial = Energy{positive("initial_energy_j", initial_energy_j)}};
  const Seconds dt{positive("dt_s", dt_s)};
  if (dof == 6 && !joints) positive("rotational_stiffness_n_m_per_rad, of dof 6,", rotational_stiffness);
  return for_port(dof, joints,
                  [&]<int N>() -> std::unique_ptr<Spring> { return std::make_unique<SpringOf<N>>(o, dt, dof); });
}

class PortObserver {
 public:
  using PythonClass = void;
  virtual ~PortObserver() = default;
  virtual double step(const py::object& held, const py::object& x, const py::object& v, double dt_s) = 0;
  [[nodiscard]] virtual double energy_j() const = 0;
};

template <int N>
class PortObserverOf final : public PortObserver {
 public:
  PortObserverOf(Energy initial, ObserverRule rule, int count) : observer_{initial}, rule_{rule}, count_{count} {}

  double step(const py::object& held, const py::object& x, const py::object& v, double dt_s) override {
    const Seconds dt{positive("dt_s", dt_s)};
    const Force<N> f{numbers_from<N>(held, "held", count_)};
    const PortMotion<N> now{position_from<N>(x, "x", count_), Velocity<N>{numbers_from<N>(v, "v", count_)}};
    if (!all_finite(f, now.x, now.v)) throw ConfigError{"held, x and v must be finite"};
    if (before_) observer_.book(0, held_energy(rule_, f, now - *before_, dt));
    before_ = now;
    return energy_j();
  }
  [[nodiscard]] double energy_j() const override { return observer_.energy().si(); }

 private:
  Observer<1> observer_;
  ObserverRule rule_;
  int count_;
  std::optional<PortMotion<N>> before_;
};

std::unique_ptr<PortObserver> make_observer(int dof, bool joints, double initial_energy_j, const std::string& rule) {
  if (rule != "EXACT" && rule != "RECTANGLE")
    throw ConfigError{fmt::format("rule is {}; it must be EXACT or RECTANGLE", rule)};
  const Energy initial{not_negative("initial_energy_j", initial_energy_j)};
  return for_port(dof, joints, [&]<int N>() -> std::unique_ptr<PortObserver> {
    return std::make_unique<PortObserverOf<N>>(initial, rule == "EXACT" ? ObserverRule::exact : ObserverRule::rectangle,
                                               dof);
  });
}

}  // namespace

void add_controllers(py::module_& module) {
  using namespace py::literals;
  const ControllerOptions defaults{};

  py::class_<PortObserver>(module, "PassivityObserver", R"(Energy that has gone in through a port, one tick at a time:

    E(k) = E(0) + sum f(k-1).(x(k) - x(k-1))

The network behind the port is passive while E >= 0. Signs: f.v is power into the network.

dof: 1, 3 or 6; joints=True: the number of joints, 1 to 8. initial_energy_j: E(0) [J], 0 or more.
rule: "EXACT", or "RECTANGLE", f(k-1).v(k-1) T, which misses what a sampled spring generates.
Errors: ValueError.)")
      .def(py::init(&make_observer), "dof"_a, py::kw_only(), "joints"_a = false, "initial_energy_j"_a = 0.0,
           "rule"_a = "EXACT")
      .def("step", &PortObserver::step, "held"_a, "x"_a, "v"_a, "dt_s"_a,
           R"(Books the interval that ends now, and returns E [J].

held: force held since the last call, after all limits [N], dof 6: force and torque [N], [N m], joints [N m]
x: position [m], dof 6: 7 numbers, position and attitude w x y z, joints [rad]
v: velocity [m/s], dof 6: twist [m/s], [rad/s], joints [rad/s]
dt_s: length of the interval [s]. The first call books nothing.)")
      .def("__reduce_ex__", not_pickled("a PassivityObserver cannot be copied or pickled"))
      .def_property_readonly("energy_j", &PortObserver::energy_j, "E, E(0) included [J].");

  py::class_<Controller>(module, "PassivityController",
                         R"(Passivity observer and controller around an element of your own with one port.

Your element computes the output that it wants for an input (velocity in, force out; or force in, velocity out).
step() returns the output to apply instead: the same, less what would take more energy out of the element than has gone in.

    E(k) = E(k-1) + out(k-1).in(k) T
    FORCE_PROJECTED   out = wanted s:               the direction is kept
    CLASSIC           out = wanted + gain in:       damping
    METRIC_DAMPING    CLASSIC, with the response of the mass at the port;  FORCE_CONE: turned by max_turn_rad at most

Exact when `input` is the mean over the interval that has just ended and the output is held until the next step.

dof: 1, 3 or 6; joints=True: the number of joints, 1 to 8. Norms, directions and gains are those of the numbers given: scale joints of unlike
inertia first, x = s q, v = s q', f = torque/s with s^2 the inertia.
initial_energy_j: E(0) [J]. output: "force" (an impedance) or "velocity" (an admittance).
max_gain: largest damping against energy that is already missing; None: 10 N s/m, with the output "velocity" 0.01 m/(N s).
unilateral: a projected output keeps its sign. predict: the coming interval's deficit counts too.
mass_kg, radius_of_gyration_m: of the body at the port; 0 kg: not known. max_turn_rad: FORCE_CONE only [rad].
Errors: ValueError. Source: docs/reference/notation.md, common/passivity/controller.h.)")
      .def(py::init(&make_controller), "dof"_a, py::kw_only(), "joints"_a = false, "method"_a = "FORCE_PROJECTED",
           "output"_a = "force", "initial_energy_j"_a = 0.0, "max_gain"_a = py::none(),
           "unilateral"_a = defaults.unilateral, "predict"_a = defaults.predict, "mass_kg"_a = defaults.mass_kg,
           "radius_of_gyration_m"_a = defaults.radius_of_gyration_m, "max_turn_rad"_a = defaults.max_turn_rad)
      .def("step", &Controller::step, "wanted"_a, "input"_a, "dt_s"_a,
           R"(The output to apply until the next step.

wanted: what the element answers [N] or [m/s], dof 6: [N], [N m] or [m/s], [rad/s]
input: velocity [m/s] or force [N], the mean since the last step;  dt_s: time since then [s])")
      .def("__reduce_ex__", not_pickled("a PassivityController cannot be copied or pickled"))
      .def_property_readonly("energy_j", &Controller::energy_j, "E, E(0) included [J].")
      .def_property_readonly("dissipated_j", &Controller::dissipated_j,
                             "Dissipated by the last step, over the coming interval, as predicted by out.in [J].")
      .def_property_readonly("undissipated_j", &Controller::undissipated_j,
                             "Deficit that the last step could not dissipate; it stays in the account [J].");

  py::class_<Spring>(module, "EnergySpring",
                     R"(The force of an element of your own, limited to that of a spring that holds the port's energy.

    E(k) = E(k-1) + f(k-1).v(k) T        v: mean velocity of the interval that has just ended
    f(k) = s wanted(k),  0 <= s <= 1     |f| <= sqrt(2 K (E + E(0))), and what the coming interval returns <= E + E(0)

E >= -E(0), with the mass known for any hand that changes its force by no more than 20 N within two ticks. Positive f.v goes into the element:
the hand feels -f. The direction is kept.

dof: 1, 3 or 6; joints=True: the number of joints, 1 to 8, scaled as for PassivityController.
stiffness_n_per_m: K, no less than the element's. initial_energy_j: E(0) > 0 [J]. dt_s: of every step [s].
mass_kg, inertia_kg_m2: of the handle; 0: not known. rotational_stiffness_n_m_per_rad: above 0 with dof 6.
Errors: ValueError. Source: docs/reference/energy-bound.md, common/passivity/passivated.h.)")
      .def(py::init(&make_spring), "dof"_a, py::kw_only(), "stiffness_n_per_m"_a, "initial_energy_j"_a,
           "joints"_a = false, "mass_kg"_a = 0.0, "rotational_stiffness_n_m_per_rad"_a = 0.0, "inertia_kg_m2"_a = 0.0,
           "dt_s"_a = 1e-3)
      .def("step", &Spring::step, "wanted"_a, "input"_a,
           R"(The force to apply until the next step.

wanted: what the element answers [N], dof 6: [N], [N m];  input: velocity, the mean since the last step [m/s], [rad/s])")
      .def("__reduce_ex__", not_pickled("an EnergySpring cannot be copied or pickled"))
      .def_property_readonly("energy_j", &Spring::energy_j, "E + E(0), not below 0 within the claim [J].")
      .def_property_readonly("share", &Spring::share, "s of the last step.");
}

}  // namespace twoport::python
