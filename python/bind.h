#pragma once

#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <optional>
#include <string>
#include <typeinfo>
#include <vector>

#include "common/base/check.h"
#include "common/base/vector.h"
#include "common/link/mailbox.h"
#include "common/scene/load.h"

namespace twoport::python {

namespace py = pybind11;

/// A scene, and the text and overrides that it was read from.
struct SceneOfText {
  using PythonClass = void;
  std::string source;  ///< path of the file, or what stands for it in error sentences
  std::string text;
  std::vector<std::string> overrides;
  Scene scene;
};

/// The control of the scene must be over a link.
inline const Scene& over_a_link(const SceneOfText& s, const char* what) {
  const Architecture a = s.scene.control.architecture;
  if (a == Architecture::render || a == Architecture::uncontrolled)
    throw ConfigError{
        fmt::format("{}: control.architecture of {} has no link; it must be POSITION_FORCE, "
                    "POSITION_MEASURED_FORCE or POSITION_POSITION",
                    what, s.source)};
  return s.scene;
}

/// Parts of the module, one for each file.
void add_studies(py::module_& module);
void add_controllers(py::module_& module);
void add_nodes(py::module_& module);
void add_live(py::module_& module);

/// Throws TypeError unless `from` is an object of the class, on which __init__ has run.
void check_made(const py::handle& from, const std::type_info& of);

/// As __reduce_ex__: pickling and copying are refused with the sentence `why`.
inline auto not_pickled(const char* why) {
  return [why](const py::handle&, int) -> py::object { throw py::type_error(why); };
}

/// Largest magnitude of a finite number that is read: sums and products of such numbers stay finite.
inline constexpr double kLargestNumber = 1e9;
inline void check_size(double value, const char* what) {
  if (std::isfinite(value) && std::abs(value) > kLargestNumber)
    throw ConfigError{fmt::format("{}: {} is too large; it must be {} at most", what, value, kLargestNumber)};
}

/// N numbers from a sequence, or with N = 1 from a number; of a port of joints as many as there are, the others are zero. Throws ConfigError,
/// whose sentence begins with `what`.
template <int N>
Eigen::Matrix<double, N, 1> numbers_from(const py::handle& from, const char* what, int joints = N) {
  const int count = N == kJointPort ? joints : N;
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  if constexpr (N == 1) {
    if (PyFloat_Check(from.ptr())) {
      v[0] = PyFloat_AS_DOUBLE(from.ptr());
      check_size(v[0], what);
      return v;
    }
  }
  const auto array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(from);
  if (!array)
    throw ConfigError{fmt::format("{}: {} cannot be read as numbers", what, std::string{py::str(py::repr(from))})};
  if (array.size() != count || array.ndim() > 1)
    throw ConfigError{
        fmt::format("{}: {} numbers of {} dimensions; it must hold {}", what, array.size(), array.ndim(), count)};
  for (int i = 0; i < count; ++i) {
    v[i] = array.data()[i];
    check_size(v[i], what);
  }
  return v;
}

/// The first `count` numbers; 0: all.
template <class Vector>
py::array_t<double> to_array(const Vector& v, py::ssize_t count = 0) {
  py::array_t<double> array(count > 0 ? count : v.size());
  std::copy_n(v.data(), array.size(), array.mutable_data());
  return array;
}

/// Position as numbers: N of them; N = 6: 7, with the attitude as a unit quaternion w x y z; joints as numbers_from().
template <int N>
Position<N> position_from(const py::handle& from, const char* what, int joints = N) {
  if constexpr (N == 6) {
    const auto v = numbers_from<7>(from, what);
    if (const double length = v.template tail<4>().norm(); !(std::abs(length - 1.0) < 1e-6) && length - length == 0.0)
      throw ConfigError{fmt::format("{}: the attitude w x y z has the length {}; it must be 1", what, length)};
    return {v.template head<3>(), Eigen::Quaterniond{v[3], v[4], v[5], v[6]}};
  } else {
    return Position<N>{numbers_from<N>(from, what, joints)};
  }
}
template <int N>
py::array_t<double> to_array(const Position<N>& x, py::ssize_t joints = 0) {
  if constexpr (N == 6) {
    Eigen::Matrix<double, 7, 1> v;
    const Eigen::Quaterniond& q = x.attitude();
    v << x.translation(), q.w(), q.x(), q.y(), q.z();
    return to_array(v);
  } else {
    return to_array(x.translation(), joints);
  }
}

/// What a side of a link tells of itself.
class AnySide {
 public:
  using PythonClass = void;
  virtual ~AnySide() = default;
  [[nodiscard]] virtual int dof() const = 0;
  [[nodiscard]] virtual double rate_hz() const = 0;
  [[nodiscard]] virtual std::string mode() const = 0;
  [[nodiscard]] virtual std::optional<double> round_trip_s() const = 0;
};
inline constexpr const char* kDof = "Degrees of freedom: 1, 3 or 6; of a port of joints their number, 1 to 8.";
inline constexpr const char* kModes = "idle, coupled, holding, released, let_go or stopped.";
template <class Side>
py::class_<Side> side_class(py::module_& module, const char* name, const char* doc, const char* not_pickled_why) {
  return py::class_<Side>{module, name, doc}
      .def_property_readonly("dof", &Side::dof, kDof)
      .def_property_readonly("rate_hz", &Side::rate_hz, "Rate at which step() is to be called [Hz].")
      .def_property_readonly("mode", &Side::mode, kModes)
      .def_property_readonly("round_trip_s", &Side::round_trip_s,
                             "As the newest report shows it [s]; None: not known yet.")
      .def("__reduce_ex__", not_pickled(not_pickled_why));
}
template <int N>
std::optional<double> round_trip_of(const PeerState<N>& peer) {
  if (!peer.has_report || peer.round_trip() < Duration{0}) return {};
  return to_seconds(peer.round_trip()).si();
}

/// Calls work(stop) in another thread, without the interpreter's lock, and meanwhile every 20 ms watch() with the lock. When a
/// signal's handler (Ctrl-C) or watch() raises, `stop` becomes true, and the exception goes on once work has ended.
template <class Work, class Watch>
auto interruptible(Work work, Watch watch) {
  std::atomic<bool> stop{false};
  auto result = std::async(std::launch::async, [&] { return work(stop); });
  const auto ended = [&](std::chrono::milliseconds within) {
    const py::gil_scoped_release released;
    return result.wait_for(within) == std::future_status::ready;
  };
  try {
    while (!ended(std::chrono::milliseconds{20})) {
      if (PyErr_CheckSignals() != 0) throw py::error_already_set{};
      watch();
    }
  } catch (...) {
    stop = true;
    const py::gil_scoped_release released;
    result.wait();
    throw;
  }
  return result.get();
}

}  // namespace twoport::python

/// Of a class with `using PythonClass = void`: only objects of it that are whole become C++ references. One made by __new__ alone
/// has no C++ object, and pybind11 would hand out memory that nobody has filled.
template <class T>
class pybind11::detail::type_caster<T, typename T::PythonClass> : public type_caster_base<T> {
 public:
  bool load(handle from, bool convert) {
    twoport::python::check_made(from, typeid(T));
    return type_caster_base<T>::load(from, convert);
  }
};
