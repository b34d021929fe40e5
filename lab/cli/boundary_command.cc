#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "lab/cli/commands.h"
#include "lab/study/boundary.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

struct Arguments {
  BoundaryOptions boundary;
  std::string interval;
};

int boundary_command(Arguments& a) {
  a.boundary.vary = parse_interval(a.interval);
  const Boundary found = find_boundary(a.boundary, [](const Trial& t) {
    fmt::print("{:<14} {:<9} {}\n", t.value, t.stable ? "stable" : "unstable", t.verdict);
    std::fflush(stdout);
  });
  if (found.stable > found.unstable) fmt::print("stable from here up:\n");
  fmt::print("{} = {}\n", a.boundary.vary.name(), found.stable);
  return 0;
}

}  // namespace

Subcommand add_boundary_command(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  a->boundary.jobs = all_cores();
  CLI::App* boundary = app.add_subcommand("boundary", "Find where a scene stops being stable along one number");
  add_scene(boundary, a->boundary.scene, a->boundary.set);
  boundary
      ->add_option("--vary", a->interval,
                   "PATH=LO:HI, LO < HI; stable at one end and unstable at the other; A,B=LO:HI moves both")
      ->required();
  boundary->add_option("--tolerance", a->boundary.tolerance, "Relative width to which it is found")
      ->capture_default_str();
  boundary->add_option("--scan", a->boundary.scan, "Values between the ends tried first; the first change counts")
      ->capture_default_str();
  boundary->footer(
      "Every run is a line: value, verdict. The last line is PATH = VALUE, the largest value up to which the run is\n"
      "stable (the smallest from which it is, where it is stable at HI). Exit status 2 when both ends agree.\n"
      "The verdict is the summary's `stable`: something must set the loop in motion, or nothing grows; near a "
      "boundary\n"
      "growth is slow, so give the run time after the operator's path has ended.");
  return {boundary, [a] { return boundary_command(*a); }};
}

}  // namespace twoport::lab
