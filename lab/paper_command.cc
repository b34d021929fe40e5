#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <mutex>

#include "common/base/check.h"
#include "common/base/file.h"
#include "lab/cli/commands.h"
#include "lab/paper.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string out;
  int jobs = all_cores();
};

void say(const std::string& line) {
  fmt::print("{}\n", line);
  std::fflush(stdout);
}

int paper_command(const Arguments& a) {
  if (a.jobs < 1) throw ConfigError{fmt::format("--jobs is {}; it must be at least 1", a.jobs)};
  std::error_code error;
  std::filesystem::create_directories(a.out, error);
  if (error) throw ConfigError{fmt::format("--out {}: cannot be created: {}", a.out, error.message())};

  PaperTable table;
  for (PaperCase& which : paper_cases()) table.results.push_back({std::move(which), {}});
  say(fmt::format("{} cases, {} seeds of 4 s each", table.results.size(), kPaperSeeds));
  for_each_parallel(table.results.size(), a.jobs,
                    [&](std::size_t i) { table.results[i].numbers = measure(table.results[i].which); });
  table.admittance = admittance_runs();
  table.frames = frame_checks();
  const std::string text = paper_text(table);
  write_whole(a.out + "/figures.csv", paper_csv(table));
  write_whole(a.out + "/table.txt", text);

  const std::vector<PaperFigure> figures = paper_figures();
  std::mutex guard;
  for_each_parallel(figures.size(), a.jobs, [&](std::size_t i) {
    const PaperFigure& f = figures[i];
    const std::string made = draw(f.make(), a.out);
    const std::lock_guard lock{guard};
    say(fmt::format("{}: {}", f.title, made));
  });
  say(text);
  say(fmt::format("{0}/figures.csv, {0}/table.txt", a.out));
  return 0;
}

}  // namespace

void add_paper_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& paper =
      *app.add_subcommand("paper", "Reproduce the figures and numbers of the reference paper from simulated data");
  paper.add_option("--out", a->out, "Folder for pictures, their data, figures.csv and table.txt")->required();
  paper.add_option("--jobs", a->jobs, "Threads")->capture_default_str();
  paper.footer(
      "\"Time Domain Passivity Control for 6 Degrees of Freedom Haptic Displays\": Figures 4 and 6 to 11, and claims\n"
      "without a figure: the admittance, rendered friction, the reference energy, independence of the frame.\n"
      "The scenes of scenes/paper/ are built in; each row of figures.csv lists its overrides.");
  paper.callback([a, &chosen] { chosen = [a] { return paper_command(*a); }; });
}

}  // namespace twoport::lab
