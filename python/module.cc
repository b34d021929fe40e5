#include <pybind11/pybind11.h>

#include "common/base/check.h"
#include "python/bind.h"

namespace twoport::python {

void check_made(const py::handle& from, const std::type_info& of) {
  const py::handle type = py::detail::get_type_handle(of, true);
  const auto name = [](const py::handle& class_) { return class_.attr("__name__").cast<std::string>(); };
  if (!py::isinstance(from, type))
    throw py::type_error(fmt::format("{} is no twoport.{}", std::string{py::str(py::repr(from))}, name(type)));
  if (!reinterpret_cast<py::detail::instance*>(from.ptr())->get_value_and_holder().holder_constructed())
    throw py::type_error(fmt::format("this twoport.{} is empty: it was made by __new__ without __init__", name(type)));
}

}  // namespace twoport::python

// The extension module twoport._twoport; python/twoport/__init__.py is what users import.
PYBIND11_MODULE(_twoport, module) {
  namespace py = pybind11;
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const twoport::ConfigError& e) {
      PyErr_SetString(PyExc_ValueError, e.what());
    } catch (const twoport::IoError& e) {
      PyErr_SetString(PyExc_OSError, e.what());
    }
  });
  module.attr("__version__") = TWOPORT_VERSION;
  // NumPy is loaded here: pybind11 would do so within the first call, where two threads at once wait for each other.
  py::detail::npy_api::get();
  // Classes and signatures name the package, which is what users import.
  const py::object name = module.attr("__name__");
  module.attr("__name__") = "twoport";
  twoport::python::add_studies(module);
  twoport::python::add_controllers(module);
  twoport::python::add_nodes(module);
  twoport::python::add_live(module);
  module.attr("__name__") = name;
}
