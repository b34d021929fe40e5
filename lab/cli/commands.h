#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/scene/scene.h"
#include "lab/engine/hosted.h"

namespace twoport::lab {

struct LaneUse;
struct Progress;

/// What the given command does once its arguments are read; it returns the exit status.
using Chosen = std::function<int()>;

/// An option that takes one value and may be given several times.
CLI::Option* add_list(CLI::App& command, const std::string& name, std::vector<std::string>& into,
                      const std::string& help);
/// A check: a number above 0.
CLI::Validator positive();
/// The positional argument SCENE and the repeatable --set PATH=VALUE.
void add_scene(CLI::App& command, std::string& scene, std::vector<std::string>& set);
/// --jobs N, at least 1; as many as there are processors unless given.
void add_jobs(CLI::App& command, int& jobs);
/// --lanes N.
void add_lanes(CLI::App& command, std::optional<int>& lanes);
/// Says on stderr which runs were stepped several at once, and why others were not.
void say_lanes(const LaneUse& use);

/// Is stderr a terminal?
bool progress_is_shown();
/// Writes a line over the last one of stderr where that is a terminal; elsewhere one after 5, 10, 20, … s, and later once a minute. `last`:
/// the work has ended.
void show_line(const std::string& line, double spent_s, bool last);
/// Exit status of a study that was stopped.
inline constexpr int kStoppedStatus = 130;
/// Set by the first SIGINT (Ctrl-C) or SIGTERM that is not ignored; a second one ends the program.
const std::atomic<bool>& stop_by_user();

/// Tells of a study what is known of it before it has ended: for the first time after half a second, later each time that half as much time
/// more has passed, and ten times what telling took. In the folder `out`, unless that is empty, coarse.html shows `picture`, which draw() makes,
/// and loads itself again every second until the study has ended.
class Sketch {
 public:
  Sketch(std::string out, std::string picture) : out_{std::move(out)}, picture_{std::move(picture)} {}
  ~Sketch();
  Sketch(const Sketch&) = delete;
  [[nodiscard]] bool is_due() const { return Clock::now() >= next_; }
  /// Writes a line to stderr and calls draw().
  void tell(const std::string& line, const std::function<void()>& draw);

 private:
  using Clock = std::chrono::steady_clock;
  void write_page(const std::string& head) const;

  std::string out_, picture_, line_;
  Clock::time_point start_ = Clock::now();
  Clock::time_point next_ = start_ + std::chrono::milliseconds{500};
};

/// "3 of 12 cells, 2 s, 6 s left".
void show_progress(const Progress& progress);
/// "3 of 12 runs, 2 s, 6 s left".
void show_runs(const Progress& progress);

/// --robot mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off].
CLI::Option* add_robot(CLI::App& command, std::string& robot);
/// The robot of that option; nothing where it was not given. Throws ConfigError where it cannot be opened or the scene cannot have it.
std::optional<HostedRobot> open_robot(const std::string& choice, const Scene& scene);
/// The same for a scene that is read where there is a choice only.
std::optional<HostedRobot> open_robot(const std::string& choice, const std::string& scene,
                                      const std::vector<std::string>& set);

/// Throws ConfigError, which begins with `option`, where one of the paths is what the world of --robot takes the place of.
void refuse_replaced(const std::string& option, const std::vector<std::string>& paths);

void add_run_command(CLI::App& app, Chosen& chosen);
void add_methods_command(CLI::App& app, Chosen& chosen);
void add_boundary_command(CLI::App& app, Chosen& chosen);
/// `sweep` and `merge`.
void add_sweep_commands(CLI::App& app, Chosen& chosen);
void add_zwidth_command(CLI::App& app, Chosen& chosen);
void add_chart_command(CLI::App& app, Chosen& chosen);
void add_doctor_command(CLI::App& app, Chosen& chosen);
void add_impedance_command(CLI::App& app, Chosen& chosen);
/// `adversary`, `compare`, `gallery`, `map`, `matrix` and `recommend`.
void add_map_commands(CLI::App& app, Chosen& chosen);
/// `replay` and `export`.
void add_recording_commands(CLI::App& app, Chosen& chosen);
/// `trim` and `blocks`.
void add_trim_commands(CLI::App& app, Chosen& chosen);

/// `arm`: kinematics and dynamics of an arm at one position, as JSON.
void add_arm_command(CLI::App& app, Chosen& chosen);

/// `paper`.
void add_paper_command(CLI::App& app, Chosen& chosen);

}  // namespace twoport::lab
