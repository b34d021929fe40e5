#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace twoport::lab {

struct LaneUse;
struct Progress;

/// An option of a command.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_{option} {}

  Option required();
  Option show_default();  ///< in the help
  Option one_of(std::initializer_list<std::string> values);
  template <class Number>
  Option between(Number least, Number most);
  Option positive();
  Option at_least_one();  ///< a whole number
  Option assignment();    ///< PATH=VALUE
  Option scene();         ///< a scene's file, or a name that stands for it (scene_file)
  Option may_be_bare();   ///< given without a value
  Option needs(Option other);
  Option excludes(Option other);

 private:
  CLI::Option* option_;
};

/// A command line, or a command on it. Only this interface's own file includes CLI11, which takes seconds to compile.
class Command {
 public:
  explicit Command(CLI::App& app) : app_{&app} {}

  Command add(const std::string& name, const std::string& description);
  /// Without dashes it is a positional argument.
  template <class Value>
  Option option(const std::string& name, Value& into, const std::string& help);
  /// An option that takes one value and may be given several times.
  Option list(const std::string& name, std::vector<std::string>& into, const std::string& help);
  void flag(const std::string& name, bool& into, const std::string& help);
  /// A flag that prints and ends the program.
  void print(const std::string& name, std::function<void()> what, const std::string& help);
  void describe(const std::string& option, const std::string& help);
  void footer(const std::string& text);
  [[nodiscard]] bool given() const;

 private:
  CLI::App* app_;
};

/// A subcommand and what it does once its arguments are read: returns the exit status.
struct Subcommand {
  Command command;
  std::function<int()> run;
};

/// The positional argument SCENE and the repeatable --set PATH=VALUE.
void add_scene(Command command, std::string& scene, std::vector<std::string>& set);
/// --jobs N, at least 1; as many as there are processors unless given.
void add_jobs(Command command, int& jobs);
/// --lanes N.
void add_lanes(Command command, std::optional<int>& lanes);
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

}  // namespace twoport::lab
