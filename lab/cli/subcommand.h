#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lab/study/many_runs.h"
#include "lab/study/sweep.h"

namespace twoport::lab {

/// A subcommand and what it does once its arguments are read: returns the exit status.
struct Subcommand {
  CLI::App* app;
  std::function<int()> run;
};

/// The positional argument SCENE and the repeatable --set PATH=VALUE.
void add_scene(CLI::App* command, std::string& scene, std::vector<std::string>& set);
/// --jobs N, at least 1.
void add_jobs(CLI::App* command, int& jobs);
/// --lanes N.
void add_lanes(CLI::App* command, std::optional<int>& lanes);
/// Says on stderr which runs were stepped several at once, and why others were not.
void say_lanes(const LaneUse& use);
/// An option that takes one value and may be given several times.
CLI::Option* add_list(CLI::App* command, const std::string& name, std::vector<std::string>& into,
                      const std::string& help);

/// Is stderr a terminal?
bool progress_is_shown();
/// Writes "3 of 12 cells, 2 s, 6 s left" over the last line of stderr when it is a terminal.
void show_progress(const Progress& progress);

}  // namespace twoport::lab
