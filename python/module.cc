#include <pybind11/pybind11.h>

#include "common/base/check.h"
#include "python/bind.h"

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
  twoport::python::add_studies(module);
  twoport::python::add_controllers(module);
  twoport::python::add_nodes(module);
}
