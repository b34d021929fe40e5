#include "tests/support/live.h"

#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace twoport::test {
namespace {

Process start(const std::string& program, const Pair& pair, const std::string& address_flag, const std::string& out,
              const Words& more, const Surroundings& s) {
  Words command{program, "--scene", pair.scene, address_flag, pair.address(), "--out", pair.at(out)};
  command.insert(command.end(), pair.scheduling.begin(), pair.scheduling.end());
  command.insert(command.end(), more.begin(), more.end());
  return Process{command, s};
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream in{line};
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  return cells;
}

}  // namespace

std::string press(int dof, std::string_view architecture) {
  const std::string along_x = dof == 1 ? "" : ", 0, 0";
  const bool turns = dof == 6, link = architecture != "RENDER";
  std::string text = fmt::format(R"(name: "press"
dof: {}
duration_s: 2
rate_hz: 1000
seed: 3
operator {{
  hand {{ mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 {} }}
  path {{ hold {{ duration_s: 0.2 }} }}
  path {{ move_to {{ position_m: [0.03{}] duration_s: 0.5 }} }}
}}
device {{ mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 {} }}
control {{
  architecture: {}
  virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }}
  passivity {{ method: FORCE_PROJECTED }}
}}
environment {{ wall {{ normal: [-1{}] offset_m: -0.02 stiffness_n_per_m: {} }} }}
)",
                                 dof, turns ? "rotational_stiffness_n_m_per_rad: 1" : "", along_x,
                                 turns ? "inertia_kg_m2: 1e-4 rotational_damping_n_m_s_per_rad: 1e-3" : "",
                                 architecture, along_x, link ? 5000 : 500);
  if (link)
    text += fmt::format(R"(to_slave {{ delay_ms: 10 }}
to_master {{ delay_ms: 10 }}
robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor {{ }} {} }}
)",
                        turns ? "inertia_kg_m2: 1e-3 rotational_damping_n_m_s_per_rad: 0.01" : "");
  return text;
}

std::string two_arms(const std::string& examples) {
  std::string text = read_text(examples + "/plugin/scene.textproto");
  for (std::size_t at = 0; (at = text.find("\"scara.", at)) != text.npos; ++at)
    text.insert(at + 1, examples + "/plugin/");
  return text + "duration_s: 2.5\n";
}

Trace::Trace(const std::string& path) {
  const std::string text = read_text(path);
  if (text.empty() || text.back() != '\n') throw std::runtime_error{path + ": missing, or its last line is cut"};
  std::istringstream in{text};
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> names = split(line);
  for (const std::string& name : names) columns[name];
  while (std::getline(in, line)) {
    const std::vector<std::string> cells = split(line);
    if (cells.size() != names.size()) throw std::runtime_error{path + ": a row of another length: " + line};
    for (std::size_t i = 0; i < cells.size(); ++i) columns[names[i]].push_back(std::stod(cells[i]));
  }
}

double Trace::peak(const std::string& name, double from_s, double to_s) const {
  const std::vector<double>&t = (*this)["t_s"], &value = (*this)[name];
  double peak = -1.0;
  for (std::size_t i = 0; i < t.size(); ++i)
    if (t[i] >= from_s && t[i] < to_s) peak = std::max(peak, std::abs(value[i]));
  return peak;
}

schema::Summary summary_in(const std::string& folder) {
  schema::Summary summary;
  const auto status = google::protobuf::util::JsonStringToMessage(read_text(folder + "/summary.json"), &summary);
  if (!status.ok()) throw std::runtime_error{folder + "/summary.json: " + status.ToString()};
  return summary;
}

bool kept_time(const std::vector<schema::Summary>& of_a_run) {
  return std::all_of(of_a_run.begin(), of_a_run.end(), [](const schema::Summary& s) {
    return s.deadline_misses() <= s.steps() / 100 && s.loop_lateness_us().max() < 10e3;
  });
}

void expect_sound(const std::vector<schema::Summary>& of_a_run) {
  if (!kept_time(of_a_run)) {
    for (const schema::Summary& s : of_a_run)
      fmt::print(
          "not judged: the {} left out {} ticks of {}, and was up to {:.3g} ms late; {}, least energy {:.3g} J\n",
          s.side(), s.deadline_misses(), s.deadline_misses() + s.steps(), 1e-3 * s.loop_lateness_us().max(),
          s.verdict(), s.min_port_energy_j());
    return;
  }
  for (const schema::Summary& s : of_a_run) {
    // A slave does not know whether the loop is stable, and a master not always.
    EXPECT_EQ(s.has_stable(), s.side() == "master" && s.verdict_kind() != "UNDECIDED")
        << s.side() << ": " << s.verdict();
    EXPECT_NE(s.verdict_kind(), "UNSTABLE") << s.side() << ": " << s.verdict();
    if (s.side() == "master") {
      EXPECT_GE(s.min_port_energy_j(), -1e-3);
    }
  }
}

bool comes_true(const std::function<bool()>& condition) {
  const auto until = std::chrono::steady_clock::now() + 30s;
  while (!condition() && std::chrono::steady_clock::now() < until) std::this_thread::sleep_for(1ms);
  return condition();
}

Pair::Pair(std::string_view text) : scene{folder.write("scene.textproto", text)} {}

void Pair::await(std::string_view out, double t_s) const {
  const std::string path = at(out) + "/trace.csv.partial";
  const auto until = std::chrono::steady_clock::now() + 30s;
  while (std::chrono::steady_clock::now() < until) {
    // The last whole row is between the last two ends of lines; a header is no number.
    constexpr std::streamoff kTail = 16384;
    std::ifstream in{path, std::ios::ate};
    in.seekg(std::max<std::streamoff>(0, in.tellg() - kTail));
    std::ostringstream tail;
    tail << in.rdbuf();
    const std::string text = tail.str();
    const std::size_t end = text.rfind('\n');
    const std::size_t begin = end == text.npos || end == 0 ? text.npos : text.rfind('\n', end - 1);
    if (begin != text.npos && std::strtod(text.c_str() + begin + 1, nullptr) >= t_s) return;
    std::this_thread::sleep_for(5ms);
  }
  ADD_FAILURE() << path << ": the run has not come to " << t_s << " s";
}

void Pair::share_key() {
  const std::string key = folder.write("key", "6b1f0c9ad2e7435891bb03f4a76e2dc538e0174f5ca92b86d47a10ef6539c2b8\n");
  std::filesystem::permissions(key, std::filesystem::perms::owner_read);
  scheduling.insert(scheduling.end(), {"--key", key});
}

Process Pair::slave(const std::string& out, const Words& more, const Surroundings& s) const {
  return start(TWOPORT_SLAVE, *this, "--listen", out, more, s);
}
Process Pair::master(const std::string& out, const Words& more, const Surroundings& s) const {
  return start(TWOPORT_MASTER, *this, "--peer", out, more, s);
}
Process Pair::listening_slave(const std::string& out, const Words& more, const Surroundings& s) const {
  Process process = slave(out, more, s);
  process.says("listening on");
  return process;
}

}  // namespace twoport::test
