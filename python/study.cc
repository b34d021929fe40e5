#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "common/base/text.h"
#include "common/hardware/transparency_host.h"
#include "common/method/catalogue.h"
#include "common/record/summary.h"
#include "common/record/trace_channel.h"
#include "common/scene/find.h"
#include "common/scene/hints.h"
#include "common/scene/scene.h"
#include "lab/run.h"
#include "lab/study/boundary.h"
#include "lab/study/parallel.h"
#include "lab/study/sweep.h"
#include "python/bind.h"

namespace twoport::python {
namespace {

using namespace py::literals;
using Strings = std::vector<std::string>;

std::string text_from(const py::handle& from, const char* what) {
  if (!py::isinstance<py::str>(from))
    throw ConfigError{fmt::format("{}: {} is not a text", what, std::string{py::str(py::repr(from))})};
  return from.cast<std::string>();
}

/// The strings of `from`: one, or a sequence of them.
Strings strings_from(const py::handle& from, const char* what) {
  if (py::isinstance<py::str>(from) || !py::isinstance<py::iterable>(from)) return {text_from(from, what)};
  Strings all;
  for (const py::handle& each : from) all.push_back(text_from(each, what));
  return all;
}

Strings overrides_from(const py::args& from) {
  Strings all;
  for (const py::handle& each : from)
    for (std::string& assignment : strings_from(each, "override")) {
      if (const std::string error = assignment_error(assignment); !error.empty()) throw ConfigError{error};
      all.push_back(std::move(assignment));
    }
  return all;
}

SceneOfText parsed(std::string source, std::string text, Strings overrides) {
  SceneOfText s{std::move(source), std::move(text), std::move(overrides), {}};
  try {
    s.scene = parse_scene(s.text, s.source, s.overrides);
  } catch (const ConfigError&) {
    // One for hardware may leave the duration out.
    s.scene = parse_scene(s.text, s.source, s.overrides, SceneFor::live);
    if (std::isfinite(s.scene.duration_s)) throw;
  }
  return s;
}
std::string path_from(const py::object& path) {
  return py::module_::import("os").attr("fspath")(path).cast<std::string>();
}
SceneOfText load(const py::object& path, const py::args& overrides) {
  const std::string source = scene_file(path_from(path));
  return parsed(source, read_whole(source), overrides_from(overrides));
}
SceneOfText parse(const std::string& text, const py::args& overrides, const std::string& name) {
  return parsed(name, text, overrides_from(overrides));
}
SceneOfText with_overrides(const SceneOfText& before, const py::args& overrides) {
  Strings all = before.overrides;
  for (std::string& each : overrides_from(overrides)) all.push_back(std::move(each));
  return parsed(before.source, before.text, std::move(all));
}

/// A view on the rows, which live as long as it does; read-only.
py::array view(const std::shared_ptr<const TraceTable>& table) {
  py::list fields;
  for (const TraceTable::Field& f : table->fields())
    fields.append(f.vector ? py::make_tuple(f.name, "<f8", py::make_tuple(f.size)) : py::make_tuple(f.name, "<f8"));
  const py::dtype type = py::dtype::from_args(fields);
  const py::capsule owner{new std::shared_ptr<const TraceTable>{table},
                          [](void* p) { delete static_cast<std::shared_ptr<const TraceTable>*>(p); }};
  // With its own stride: pybind11 before 2.12 misreads the size of a row that NumPy 2 states.
  const auto stride = type.attr("itemsize").cast<py::ssize_t>();
  py::array array{type, {static_cast<py::ssize_t>(table->rows())}, {stride}, table->data(), owner};
  array.attr("setflags")("write"_a = false);
  return array;
}

py::dict units(const TraceTable& table) {
  py::dict all;
  for (const TraceTable::Field& f : table.fields())
    all[py::str(f.name)] = f.vector && f.size == 6 ? fmt::format("{}, {}", f.unit, f.rotational_unit) : f.unit;
  return all;
}

struct Result {
  using PythonClass = void;
  std::string summary_json;
  py::dict summary;
  Strings violations;
  py::object trace, gripper_trace;
  py::dict units;
};

py::dict dict_of(const std::string& json) {
  return py::module_::import("json").attr("loads")(json);
}

/// A function of Python as a transparency layer. Its first exception ends the coupling, and is kept.
class FunctionLayer final : public TransparencyHost {
 public:
  FunctionLayer(py::function function, int dof) : function_{std::move(function)}, dof_{dof} {}
  bool step(const twoport_transparency_reading& in, twoport_transparency_wish& out) noexcept override {
    const py::gil_scoped_acquire gil;
    try {
      const auto list = [](const double* from, int count) { return std::vector<double>(from, from + count); };
      py::dict reading;
      reading["dt_s"] = in.dt_s;
      reading["coupled"] = in.coupled != 0;
      reading["position_m"] = list(in.position_m, std::min(dof_, 3));
      reading["attitude_wxyz"] = list(in.attitude, 4);
      reading["velocity"] = list(in.velocity, dof_);
      reading["applied"] = list(in.applied, dof_);
      reading["has_report"] = in.has_report != 0;
      reading["report_is_new"] = in.report_is_new != 0;
      reading["slave_position_m"] = list(in.slave_position_m, std::min(dof_, 3));
      reading["slave_attitude_wxyz"] = list(in.slave_attitude, 4);
      reading["slave_velocity"] = list(in.slave_velocity, dof_);
      reading["slave_force"] = list(in.slave_force, dof_);
      const auto force = function_(reading).cast<std::vector<double>>();
      if (static_cast<int>(force.size()) != dof_)
        throw py::value_error(fmt::format("transparency returned {} numbers; it must return {}", force.size(), dof_));
      std::copy(force.begin(), force.end(), out.force);
      return true;
    } catch (...) {
      error_ = std::current_exception();
      return false;
    }
  }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  py::function function_;
  int dof_;
  std::exception_ptr error_;
};

Result run_scene(const SceneOfText& s, bool trace, std::int64_t trace_every, const std::string& verdict,
                 const std::optional<py::function>& transparency) {
  if (trace_every < 1) throw ConfigError{fmt::format("trace_every is {}; it must be 1 or more", trace_every)};
  if (verdict != "tail" && verdict != "plain")
    throw ConfigError{fmt::format("verdict is {}; it must be tail or plain", verdict)};
  if (!std::isfinite(s.scene.duration_s)) static_cast<void>(parse_scene(s.text, s.source, s.overrides));  // refuses it
  std::shared_ptr<TraceTable> table, gripper_table;
  const double rate_hz = std::max(s.scene.master_rate_hz, s.scene.slave_rate_hz);
  const double rows = s.scene.duration_s * rate_hz / static_cast<double>(trace_every) + 1.0;
  if (trace) table = std::make_shared<TraceTable>(s.scene.dof, s.scene.coordinates(), rows);
  if (trace && s.scene.gripper) gripper_table = std::make_shared<TraceTable>(1, 1, rows);
  Scene scene = s.scene;
  std::shared_ptr<FunctionLayer> layer;
  if (transparency) {
    if (scene.joints > 0) throw ConfigError{"transparency is given, but space of " + s.source + " is JOINTS"};
    const auto external = std::find_if(std::begin(kTransparencyLayers), std::end(kTransparencyLayers),
                                       [](const TransparencyLayerName& each) { return each.is_external; });
    if (!choose_method(scene.control, std::string{external->name} + "+" + scene.control.passivity))
      throw ConfigError{"transparency is given, but control.passivity.method is " + scene.control.method_name +
                        ", which has no layers"};
    scene.control.plugin.host = layer = std::make_shared<FunctionLayer>(*transparency, scene.dof);
  }
  const Summary summary = interruptible(
      [&](const std::atomic<bool>& stop) {
        return lab::run(scene, {.trace_every = static_cast<std::uint64_t>(trace_every),
                                .verdict = verdict == "plain" ? lab::VerdictFrom::plain : lab::VerdictFrom::tail,
                                .table = table.get(),
                                .gripper_table = gripper_table.get(),
                                .stop = &stop});
      },
      [] {});
  if (layer) layer->rethrow();
  const std::string json = to_json(summary);
  const auto view_or_none = [](const auto& of) { return of ? py::object{view(of)} : py::none(); };
  return {json,
          dict_of(json),
          violations(s.scene.expect, summary),
          view_or_none(table),
          view_or_none(gripper_table),
          table ? units(*table) : py::dict{}};
}

py::tuple state(const Result& r) {
  return py::make_tuple(r.summary_json, r.violations, r.trace, r.units, r.gripper_trace);
}
Result result_from(const py::tuple& state) {
  const auto json = state[0].cast<std::string>();
  const py::object trace = state[2], gripper_trace = state[4];
  for (const py::object& each : {trace, gripper_trace})
    if (!each.is_none()) each.attr("setflags")("write"_a = false);
  return {json, dict_of(json), state[1].cast<Strings>(), trace, gripper_trace, state[3]};
}

struct Recording {
  using PythonClass = void;
  RecordingHeader header;
  bool torn;
  py::object trace, gripper_trace;
  py::dict units;
};

Recording load_recording(const py::object& path) {
  RecordingReader reader{path_from(path)};
  RecordedRun run = [&] {
    const py::gil_scoped_release others_go_on;
    return read_run(reader);
  }();
  return {std::move(run.header), reader.torn(), view(run.trace),
          run.gripper ? py::object{view(run.gripper)} : py::none(), units(*run.trace)};
}

struct TableOfTexts {
  using PythonClass = void;
  Strings columns;
  std::vector<Strings> rows;
  std::string csv;

  /// Numbers where all cells are (empty: NaN), else texts.
  [[nodiscard]] py::object at(const std::string& name) const {
    const auto found = std::find(columns.begin(), columns.end(), name);
    if (found == columns.end()) throw py::key_error{name};
    Strings texts;
    for (const Strings& row : rows) texts.push_back(row[static_cast<std::size_t>(found - columns.begin())]);
    std::vector<double> numbers;
    for (const std::string& text : texts) {
      const std::optional<double> value = number_from<double>(text);
      if (!value && !text.empty()) return py::cast(texts);
      numbers.push_back(value.value_or(std::numeric_limits<double>::quiet_NaN()));
    }
    return py::array_t<double>(static_cast<py::ssize_t>(numbers.size()), numbers.data());
  }
};

TableOfTexts table_of(const lab::Table& table) {
  TableOfTexts all{.columns = table.columns, .rows = {}, .csv = lab::to_csv(table)};
  for (const lab::Values& row : table.rows) {
    Strings& texts = all.rows.emplace_back();
    for (const lab::Value& value : row) texts.push_back(value.text());
  }
  return all;
}

/// Threads: 0 or None is one for each core.
int jobs_from(const std::optional<int>& jobs) {
  if (!jobs) return lab::all_cores();
  if (*jobs < 1) throw ConfigError{fmt::format("jobs is {}; it must be 1 or more", *jobs)};
  return *jobs;
}

/// What a study reports while it runs, and who is told, with the interpreter's lock.
class Listener {
 public:
  explicit Listener(py::object heard) : heard_{std::move(heard)} {}
  void set(std::size_t done, std::size_t count) { done_ = done, count_ = count; }
  void tell() {
    if (heard_.is_none()) return;
    const std::size_t done = done_, count = count_;
    if (count == 0 || std::exchange(told_, done + 1) == done + 1) return;
    heard_(done, count);
  }

 private:
  py::object heard_;
  std::atomic<std::size_t> done_{0}, count_{0};
  std::size_t told_ = 0;
};

TableOfTexts sweep_scene(const SceneOfText& s, const py::object& vary, std::int64_t seeds,
                         const std::optional<int>& jobs, const py::object& out, const py::object& progress,
                         const std::string& verdict) {
  if (verdict != "tail" && verdict != "lean" && verdict != "plain")
    throw ConfigError{fmt::format("verdict is {}; it must be tail, lean or plain", verdict)};
  if (seeds < 0) throw ConfigError{fmt::format("seeds is {}; it must be 0 or more", seeds)};
  lab::SweepOptions o;
  o.scene = s.source;
  o.text = s.text;
  o.set = s.overrides;
  for (const std::string& axis : strings_from(vary, "vary")) o.axes.push_back(lab::parse_axis(axis, "vary"));
  o.seeds = static_cast<std::size_t>(seeds);
  o.jobs = jobs_from(jobs);
  o.verdict = verdict == "plain"  ? lab::VerdictFrom::plain
              : verdict == "lean" ? lab::VerdictFrom::lean
                                  : lab::VerdictFrom::tail;
  if (!out.is_none()) o.out = path_from(out);
  if (!out.is_none() && o.out.empty()) throw ConfigError{"out is empty; it must be a folder, or None"};
  Listener listener{progress};
  const lab::Table table = interruptible(
      [&](const std::atomic<bool>& stop) {
        o.stop = &stop;
        return lab::sweep(o, [&](const lab::Progress& p) { listener.set(p.done, p.count); });
      },
      [&] { listener.tell(); });
  listener.tell();
  return table_of(table);
}

struct BoundaryOfScene {
  using PythonClass = void;
  std::string path;
  double stable, unstable;
  std::vector<std::tuple<double, bool, std::string>> trials;
};

py::object boundary_of(const SceneOfText& s, const py::object& vary, const py::object& along, double tolerance,
                       int scan, const std::optional<int>& jobs) {
  lab::BoundaryOptions o;
  o.scene = s.source;
  o.text = s.text;
  o.set = s.overrides;
  o.vary = lab::parse_interval(text_from(vary, "vary"));
  o.tolerance = tolerance;
  o.scan = scan;
  o.jobs = jobs_from(jobs);
  if (!along.is_none()) {
    const lab::Axis axis = lab::parse_axis(text_from(along, "along"), "along");
    return py::cast(table_of(lab::to_table(interruptible(
        [&](const std::atomic<bool>& stop) {
          o.stop = &stop;
          return lab::boundary_curve(o, axis);
        },
        [] {}))));
  }
  BoundaryOfScene result{.path = o.vary.name(), .stable = 0.0, .unstable = 0.0, .trials = {}};
  const lab::Boundary found = interruptible(
      [&](const std::atomic<bool>& stop) {
        o.stop = &stop;
        return lab::find_boundary(
            o, [&](const lab::Trial& t) { result.trials.emplace_back(t.value, t.stable, t.verdict); });
      },
      [] {});
  result.stable = found.stable;
  result.unstable = found.unstable;
  return py::cast(result);
}

}  // namespace

void add_studies(py::module_& module) {
  const auto of_scene = [](auto Scene::*field) {
    return [field](const SceneOfText& s) { return std::invoke(field, s.scene); };
  };
  const auto of_header = [](auto RecordingHeader::*field) {
    return [field](const Recording& r) { return r.header.*field; };
  };
  py::class_<SceneOfText>(
      module, "Scene",
      R"(A scene with its overrides, checked. Made by load_scene and parse_scene; immutable. Pickled as text: files that it names are
read again where it is unpickled.)")
      .def("override", &with_overrides,
           R"(This scene with more overrides: override("to_slave.delay_ms=50", "control.passivity.method=NONE").

PATH=VALUE as for --set of the programs. Errors: ValueError with the programs' sentence.)")
      .def(
          "hints", [](const SceneOfText& s) { return hints(s.scene); },
          "What of the scene is probably not meant: sentences, which the programs print as warnings.")
      .def_readonly("source", &SceneOfText::source, "Path of the file, or the name given to the text.")
      .def_readonly("text", &SceneOfText::text, "Text before the overrides.")
      .def_property_readonly(
          "overrides", [](const SceneOfText& s) { return py::tuple(py::cast(s.overrides)); }, "PATH=VALUE, in order.")
      .def_property_readonly("name", of_scene(&Scene::name), "Name of the scene.")
      .def_property_readonly("description", of_scene(&Scene::description), "Its description.")
      .def_property_readonly("dof", of_scene(&Scene::coordinates), kDof)
      .def_property_readonly("duration_s", of_scene(&Scene::duration_s),
                             "Length of a run [s]; infinite: not given, for live sides.")
      .def_property_readonly("master_rate_hz", of_scene(&Scene::master_rate_hz), "Rate of the master [Hz].")
      .def_property_readonly("slave_rate_hz", of_scene(&Scene::slave_rate_hz), "Rate of the slave [Hz].")
      .def_property_readonly("seed", of_scene(&Scene::seed), "Seed of all that is random.")
      .def_property_readonly(
          "architecture", [](const SceneOfText& s) { return to_string(s.scene.control.architecture); },
          "As control.architecture has it.")
      .def_property_readonly(
          "method", [](const SceneOfText& s) { return s.scene.control.method_name; },
          "As control.passivity.method has it.")
      .def(py::pickle([](const SceneOfText& s) { return py::make_tuple(s.source, s.text, s.overrides); },
                      [](const py::tuple& state) {
                        return parsed(state[0].cast<std::string>(), state[1].cast<std::string>(),
                                      state[2].cast<Strings>());
                      }))
      .def("__repr__", [](const SceneOfText& s) {
        return fmt::format("<twoport.Scene \"{}\" of {}, dof {}, {}, {}>", s.scene.name, s.source,
                           s.scene.coordinates(), to_string(s.scene.control.architecture), s.scene.control.method_name);
      });
  module.def("_look_above", &look_above, "Where else the project's folders are looked for.");
  module.def("_project_folder", &project_folder, "A folder of the project.");
  module.def("load_scene", &load, "path"_a,
             R"(Reads a scene file: load_scene("scenes/demo.textproto", "to_slave.delay_ms=50").

path: of the file, or the name of a scene of the project ("demo"). overrides: PATH=VALUE as for --set of the programs, applied in order.
Errors: ValueError with the programs' sentence: file, line and column, or path, value, and what is allowed.)");
  module.def("parse_scene", &parse, "text"_a, py::kw_only(), "name"_a = "text",
             R"(Reads a scene from text: parse_scene("dof: 1 ...", "seed=2", name="mine").

text: a scene as a file holds it. overrides: PATH=VALUE, applied in order. name: stands for the file in errors; files that the
scene names are looked for in its folder.
Errors: ValueError, as load_scene.)");

  py::class_<Result>(module, "Result", "What a run leaves.")
      .def_readonly(
          "summary", &Result::summary,
          R"(What summary.json of twoport-lab holds (docs/reference/summary-and-trace.md). Keys and values are the program's, except
"step_ns": this machine's time for a tick [ns], which differs from run to run.)")
      .def_readonly("summary_json", &Result::summary_json, "summary.json itself.")
      .def_readonly("violations", &Result::violations,
                    "What the scene expects and the run did not meet, a sentence each.")
      .def_readonly(
          "trace", &Result::trace,
          R"(The columns of trace.csv with all digits, one element for each tick of the master; None where none was asked for.

A structured array: trace["t_s"] has a number for each tick, trace["master_x"] `dof` of them. It is a read-only view of the
run's own memory, without a copy, and so is each column; it stays valid when the result is gone.)")
      .def_readonly(
          "gripper_trace", &Result::gripper_trace,
          R"(The same of the gripper, the columns of trace-gripper.csv as dof 1; None where the scene has none.)")
      .def_readonly("units", &Result::units,
                    R"(Unit of each column of the trace; with dof 6 "m, rad": translation, rotation.)")
      .def(py::pickle(&state, &result_from))
      .def("__repr__", [](const Result& r) {
        return fmt::format("<twoport.Result {}: {}>", std::string{py::str(r.summary["scene"])},
                           std::string{py::str(r.summary["verdict"])});
      });
  module.def("run", &run_scene, "scene"_a, py::kw_only(), "trace"_a = true, "trace_every"_a = 1, "verdict"_a = "tail",
             "transparency"_a = py::none(),
             R"(Runs a scene in virtual time, as `twoport-lab run` does: the same summary and trace, bit for bit.

trace: keep the trace. trace_every: one tick in so many has a row.
verdict: "tail" (the loop left alone after the scene's end, beside a twin) or "plain" (from the scene's own run: faster, and
UNDECIDED more often).
transparency: a function in place of the scene's transparency layer. It is called in each tick of the master with a dict (position_m, velocity,
applied, slave_force, ..., lists in SI units; common/hardware/transparency_plugin.h has all) and returns the force wanted at the hand, one
number an axis, power force·velocity into the network. The passivity layer limits it. The verdict is then "plain".
Other threads of Python go on meanwhile; Ctrl-C ends it. Errors: ValueError.)");

  py::class_<Recording>(module, "Recording", "A recording of a run, in memory. Made by load_recording.")
      .def_readonly(
          "trace", &Recording::trace,
          R"(The columns of trace.csv with all digits, one element for each recorded row; of a live master's recording
those of the master, of a slave's those of the slave. A read-only structured array, as Result.trace.)")
      .def_readonly("gripper_trace", &Recording::gripper_trace, "The same of the gripper; None where there is none.")
      .def_readonly("units", &Recording::units, R"(Unit of each column; with dof 6 "m, rad": translation, rotation.)")
      .def_readonly("torn", &Recording::torn,
                    "Has the file no end? Its program was killed; the trace goes as far as it goes.")
      .def_property_readonly("program", of_header(&RecordingHeader::program), "Name and version of what wrote it.")
      .def_property_readonly("start_unix_ns", of_header(&RecordingHeader::start_unix_ns),
                             "The computer's clock at t_s = 0 [ns since 1970]; 0 of a run in virtual time.")
      .def_property_readonly("scene_text", of_header(&RecordingHeader::scene_text), "Its scene, before the overrides.")
      .def_property_readonly(
          "overrides", [](const Recording& r) { return py::tuple(py::cast(r.header.overrides)); },
          "PATH=VALUE, in order: parse_scene(scene_text, *overrides).")
      .def("__reduce_ex__", not_pickled("a Recording cannot be copied or pickled: load it where it is needed"))
      .def("__repr__", [](const Recording& r) {
        return fmt::format("<twoport.Recording of {}, {} rows>", r.header.program, py::len(r.trace));
      });
  module.def("load_recording", &load_recording, "path"_a,
             R"(Reads the trace of a recording that --record has made.

path: of the MCAP file. Errors: ValueError, with the file's name and the reason, for what is no recording, is damaged or holds no
trace.)");

  py::class_<TableOfTexts>(
      module, "Table",
      R"(A table of a study: table["stable"] is a column, as numbers (an array; NaN: not known) or texts (a list).)")
      .def_readonly("columns", &TableOfTexts::columns, "Names of the columns.")
      .def_readonly("rows", &TableOfTexts::rows, "The cells as texts, row by row; numbers with all digits.")
      .def_readonly("csv", &TableOfTexts::csv, "The file that the program writes, table.csv or boundary.csv.")
      .def("__getitem__", &TableOfTexts::at, "name"_a, "A column. Errors: KeyError.")
      .def(
          "__len__", [](const TableOfTexts& t) { return t.rows.size(); }, "Number of rows.")
      .def(py::pickle([](const TableOfTexts& t) { return py::make_tuple(t.columns, t.rows, t.csv); },
                      [](const py::tuple& state) {
                        return TableOfTexts{state[0].cast<Strings>(), state[1].cast<std::vector<Strings>>(),
                                            state[2].cast<std::string>()};
                      }))
      .def("__repr__", [](const TableOfTexts& t) {
        return fmt::format("<twoport.Table, {} rows, {} columns>", t.rows.size(), t.columns.size());
      });
  module.def("sweep", &sweep_scene, "scene"_a, "vary"_a, py::kw_only(), "seeds"_a = 0, "jobs"_a = py::none(),
             "out"_a = py::none(), "progress"_a = py::none(), "verdict"_a = "tail",
             R"(Runs a scene over a grid, as `twoport-lab sweep` does: the same table, bit for bit.

vary: PATH=SPEC, or several of them, the last varies fastest. SPEC: a,b,c or start:stop:count or start:stop:count:log;
A,B=SPEC links the paths A and B.
seeds: runs a cell, with the scene's seed, seed + 1, ...; 0: one, without columns of the spread.
jobs: threads; None: one for each core. out: folder for table.csv and the finished cells, from which a sweep that was ended
goes on; None: nothing is kept. progress: called as progress(done, count), in cells.
verdict: "tail", "lean" (with the twin only where a passivity controller acts) or "plain", as --verdict of the program.
Other threads of Python go on meanwhile; Ctrl-C ends it. Errors: ValueError.)");

  py::class_<BoundaryOfScene>(module, "Boundary", "A stability boundary.")
      .def_readonly("path", &BoundaryOfScene::path, "What was varied.")
      .def_readonly("value", &BoundaryOfScene::stable, "The last stable value, as the program prints it.")
      .def_readonly("unstable", &BoundaryOfScene::unstable, "The first unstable value found on the other side.")
      .def_readonly("trials", &BoundaryOfScene::trials, "The runs of the search: value, stable, verdict.")
      .def(py::pickle([](const BoundaryOfScene& b) { return py::make_tuple(b.path, b.stable, b.unstable, b.trials); },
                      [](const py::tuple& state) {
                        return BoundaryOfScene{state[0].cast<std::string>(), state[1].cast<double>(),
                                               state[2].cast<double>(),
                                               state[3].cast<decltype(BoundaryOfScene::trials)>()};
                      }))
      .def("__repr__",
           [](const BoundaryOfScene& b) { return fmt::format("<twoport.Boundary {} = {}>", b.path, b.stable); });
  const lab::BoundaryOptions defaults{};
  module.def("boundary", &boundary_of, "scene"_a, "vary"_a, py::kw_only(), "along"_a = py::none(),
             "tolerance"_a = defaults.tolerance, "scan"_a = defaults.scan, "jobs"_a = py::none(),
             R"(Finds where a scene stops being stable, as `twoport-lab boundary` does.

vary: PATH=LO:HI; A,B=LO:HI varies both. along: PATH=SPEC as for sweep; then a Table is returned, a boundary for each value.
tolerance: relative width of the final bracket. scan: values between the ends that are tried first. jobs: threads for the scan.
Returns a Boundary, with `along` a Table. Ctrl-C ends it. Errors: ValueError, also when both ends agree.)");

  module.def(
      "methods",
      [] {
        std::vector<std::pair<std::string, std::string>> all;
        for (const MethodName& each : kMethods) all.emplace_back(each.name, each.summary);
        return all;
      },
      "Name and sentence of each method of control.passivity.method over a link; the first is that of a scene that "
      "names none.");
}

}  // namespace twoport::python
