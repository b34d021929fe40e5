# The Python module is built where Python and pybind11 are installed. It links the libraries into a shared object, so they are
# position independent; with or without it, their objects are the same.
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
# No function of the project is replaced by one of another library: all may be inlined as in a program.
add_compile_options(-fno-semantic-interposition)
option(TWOPORT_PYTHON "Build the Python module where Python 3 and pybind11 are installed" ${PROJECT_IS_TOP_LEVEL})
set(twoport_python OFF)
if(TWOPORT_PYTHON AND NOT TWOPORT_SANITIZE AND NOT TWOPORT_FUZZ)
  # The system's interpreter, for which its packages are; another one by -D Python3_EXECUTABLE=...
  if(NOT Python3_EXECUTABLE AND EXISTS /usr/bin/python3)
    set(Python3_EXECUTABLE /usr/bin/python3)
  endif()
  # Its own headers, also where a python3-config of another interpreter is on the PATH.
  if(Python3_EXECUTABLE AND NOT Python3_INCLUDE_DIR)
    execute_process(COMMAND ${Python3_EXECUTABLE} -c "import sysconfig; print(sysconfig.get_path('include'))"
                    OUTPUT_VARIABLE Python3_INCLUDE_DIR OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  endif()
  find_package(Python3 3.9 QUIET COMPONENTS Interpreter Development.Module)
  find_path(PYBIND11_INCLUDE_DIR pybind11/pybind11.h)
  if(Python3_FOUND AND PYBIND11_INCLUDE_DIR)
    set(twoport_python ON)
    message(STATUS "Python module: for ${Python3_EXECUTABLE} ${Python3_VERSION}")
  else()
    message(STATUS "Python module: not built; it needs python3-dev and pybind11-dev")
  endif()
endif()
