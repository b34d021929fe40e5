#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/scene/find.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/lanes/lanes.h"
#include "lab/plot/pictures.h"
#include "lab/study/adversary.h"
#include "lab/study/cells.h"
#include "lab/study/compare.h"
#include "lab/study/link_advice.h"
#include "lab/study/map.h"

namespace twoport::lab {
namespace {

/// The values of "a,b" or start:stop:count, as --vary takes them. Throws ConfigError that names the option.
std::vector<std::string> words_of(const std::string& option, const std::string& spec) {
  if (spec.empty()) return {};
  try {
    return parse_axis(option + "=" + spec, option).values;
  } catch (const ConfigError&) {
    throw ConfigError{
        fmt::format("{} is {}; it must be a,b,c or start:stop:count, with :log for the logarithm", option, spec)};
  }
}

std::vector<double> values_of(const std::string& option, const std::string& spec) {
  std::vector<double> all;
  for (const std::string& value : words_of(option, spec)) {
    const std::optional<double> number = number_from<double>(value);
    if (!number) throw ConfigError{fmt::format("{} has {}; it must be a number", option, value)};
    all.push_back(*number);
  }
  return all;
}

/// The rule by which map, compare and recommend name a method (best_of).
constexpr const char* kBestRule =
    R"(
error       root of the sum of squares of felt-force error, missing force, drag in free space and chatter [N]; missing force: by how
            much the environment's force, in the mean over the run, is below that of the same scene without delay, loss and control
best        of the methods that are stable and quiet with every seed, press at least half and at most one and a half times that
            force, bound the energy of a port and have never paid the hand more than E(0), the one with the least error
)";

struct MapArguments {
  MapOptions map;
  std::optional<int> lanes;
  std::string methods, round_trips, losses, bursts, stiffnesses, out, verdict = "lean", robot;
};

auto cells_run(const Map& map) {
  return std::count_if(map.cells.begin(), map.cells.end(), [](const MapCell& c) { return c.runs() > 0; });
}
auto cells_that_hold(const Map& map) {
  return std::count_if(map.cells.begin(), map.cells.end(), [](const MapCell& c) { return c.runs() > 0 && c.holds(); });
}

int map_command(MapArguments& a) {
  a.map.methods = words_of("--methods", a.methods);
  const auto take = [](const char* option, const std::string& spec, std::vector<double>& into) {
    if (!spec.empty()) into = values_of(option, spec);
  };
  take("--round-trip-ms", a.round_trips, a.map.round_trips_ms);
  take("--loss", a.losses, a.map.losses);
  take("--burst-packets", a.bursts, a.map.bursts_packets);
  take("--stiffness", a.stiffnesses, a.map.stiffnesses_n_per_m);
  a.map.verdict = verdict_from(a.verdict);
  a.map.lanes = checked_lanes(a.lanes.value_or(0));
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.map.scene, a.map.set);
  if (robot) {
    a.map.robot = &*robot;
    if (a.stiffnesses.empty()) a.map.stiffnesses_n_per_m = {0.0};
  }
  if (!a.out.empty()) make_folder(a.out);
  double spent_s = 0.0;
  a.map.stop = &stop_by_user();
  Sketch sketch{a.out, "map.png"};
  a.map.coarse = [&](const Map& known) {
    const std::optional<Map> all = filled(known);
    if (all && sketch.is_due())
      sketch.tell(fmt::format("{} of {} cells: {} hold", cells_run(known), known.cells.size(), cells_that_hold(known)),
                  [&] {
                    if (!a.out.empty()) draw(*all, a.out);
                  });
  };
  const Map map = make_map(a.map, [&](const Progress& progress) {
    spent_s = progress.spent_s;
    show_progress(progress);
  });
  const std::optional<Map> drawn = map.stopped ? filled(map) : map;
  const auto cells = cells_run(map);
  if (map.stopped) print_error("{}stopped: {} of {} cells\n", progress_is_shown() ? "\n" : "", cells, map.cells.size());
  if (!drawn) return kStoppedStatus;
  const double runs = static_cast<double>(cells) * a.map.seeds;
  print_error("{} runs in {:.1f} s, {:.0f} a second\n", runs, spent_s, runs / spent_s);
  if (a.lanes) say_lanes(map.use);
  std::fputs(to_text(map).c_str(), stdout);
  const int status = map.stopped ? kStoppedStatus : 0;
  if (a.out.empty()) return status;
  write_whole(a.out + "/table.csv", to_csv(to_table(map)));
  fmt::print("{}/table.csv: {} rows\n{}\n", a.out, cells, draw(*drawn, a.out));
  return status;
}

void add_map(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<MapArguments>();
  CLI::App& map = *app.add_subcommand("map", "Where each method holds: round trip, loss and stiffness varied");
  CLI::Option* scene =
      map.add_option("--scene", a->map.scene, "Another scene than scenes/map.textproto, which is built in")
          ->transform(scene_file);
  add_list(map, "--set", a->map.set, "PATH=VALUE, before those that the map sets");
  add_robot(map, a->robot)->needs(scene);
  map.add_option("--methods", a->methods, "NAME,NAME or TRANSPARENCY+PASSIVITY; every named method if absent");
  map.add_option("--round-trip-ms", a->round_trips, "Values as for sweep --vary; half of it each way");
  map.add_option("--loss", a->losses, "Probability each way");
  map.add_option("--burst-packets", a->bursts, "Mean number of packets lost in a row; 1: independent");
  map.add_option("--stiffness", a->stiffnesses, "Of the environment [N/m]");
  map.add_option("--seeds", a->map.seeds, "Runs per cell, with seeds counted up from the scene's")
      ->capture_default_str();
  map.add_option(
         "--verdict", a->verdict,
         "lean: left alone after the scene's end, beside a twin where a passivity controller acts; tail: with a "
         "twin always, as run does")
      ->check(CLI::IsMember({"lean", "tail"}))
      ->capture_default_str();
  map.add_option("--out", a->out, "Folder for table.csv and the pictures");
  add_jobs(map, a->map.jobs);
  add_lanes(map, a->lanes);
  map.footer(
      R"(A method holds in a place where every seed is stable and quiet and at least half of the force is pressed that the
same scene presses without delay, loss and control. It is good where it holds and its error is below half of that force:
a method that displays nothing, or drags as much, is not.
)" + std::string{kBestRule} +
      R"(
Cells run from coarse to fine; Ctrl-C leaves table and pictures of those that have run.)");
  map.callback([a, &chosen] { chosen = [a] { return map_command(*a); }; });
}

constexpr double kLongestDelay_ms = 5e4, kMostLoss = 0.99;

struct RecommendArguments {
  std::optional<double> delay_ms, loss, stiffness;
  double burst = 1.0;
  int seeds = 3, jobs = 1;
  bool json = false;
  std::string methods, link, scene, robot;
};

int status_of(const std::string& recommended) {
  return recommended == "none" ? 3 : 0;
}

int recommend_for_link(const RecommendArguments& a) {
  const LinkTrace link = parse_link_trace(read_text(a.link), a.link);
  for (const auto& [name, way] : {std::pair{"to_slave", &link.to_slave}, {"to_master", &link.to_master}})
    if (way->empty()) throw ConfigError{fmt::format("{} has no row of {}; both directions are needed", a.link, name)};
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.scene, {});
  const LinkAdvice advice = recommend(link,
                                      {.scene = a.scene,
                                       .set = {},
                                       .methods = words_of("--methods", a.methods),
                                       .stiffnesses_n_per_m = {a.stiffness.value_or(a.scene.empty() ? 1000.0 : 0.0)},
                                       .seeds = 1,
                                       .robot = robot ? &*robot : nullptr,
                                       .jobs = a.jobs},
                                      show_progress);
  std::fputs((a.json ? to_json(advice) : to_text(advice)).c_str(), stdout);
  return status_of(advice.method);
}

int recommend_command(const RecommendArguments& a) {
  if (!a.link.empty()) return recommend_for_link(a);
  for (const auto& [name, value] :
       {std::pair{"--delay-ms", a.delay_ms}, {"--loss", a.loss}, {"--stiffness", a.stiffness}})
    if (!value)
      throw ConfigError{
          fmt::format("recommend: {} is missing; give --link, or --delay-ms, --loss and --stiffness", name)};
  // The map would name the round trip, which nobody gave.
  if (!(*a.delay_ms >= 0.0 && *a.delay_ms <= kLongestDelay_ms))
    throw ConfigError{fmt::format("--delay-ms is {}; it must be between 0 and {:g}", *a.delay_ms, kLongestDelay_ms)};
  if (!(*a.loss >= 0.0 && *a.loss <= kMostLoss))
    throw ConfigError{fmt::format(
        "--loss is {}; it must be between 0 and {}, the probability of a loss{}", *a.loss, kMostLoss,
        *a.loss > 1.0 && *a.loss <= 100.0 * kMostLoss ? fmt::format(": for {} % write {:g}", *a.loss, *a.loss / 100.0)
                                                      : "")};
  const Map map = make_map({.scene = {},
                            .set = {},
                            .methods = words_of("--methods", a.methods),
                            .round_trips_ms = {2.0 * *a.delay_ms},
                            .losses = {*a.loss},
                            .bursts_packets = {a.burst},
                            .stiffnesses_n_per_m = {*a.stiffness},
                            .seeds = a.seeds,
                            .jobs = a.jobs},
                           show_progress);
  const Recommendation found = recommend(standings(map, 0));
  if (a.json) {
    fmt::print("{{\"method\": {}, \"initial_energy_j\": {:.4g}, \"why\": {}}}\n", json_string(found.method),
               map.initial_energy_j[0], json_string(found.why));
  } else {
    fmt::print("{}: {}\n", found.method, found.why);
  }
  return status_of(found.method);
}

void add_recommend(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<RecommendArguments>();
  CLI::App& recommend = *app.add_subcommand("recommend", "The method for a network and a wall, by running them all");
  CLI::Option* link = recommend.add_option("--link", a->link, "FILE of doctor --save, in place of delay and loss");
  recommend.add_option("--delay-ms", a->delay_ms, "One way")->excludes(link);
  recommend.add_option("--loss", a->loss, "Probability each way")->excludes(link);
  recommend.add_option("--stiffness", a->stiffness,
                       "Of the environment [N/m]; with --link 1000 if absent, or that of --scene");
  recommend.add_option("--burst-packets", a->burst, "Mean number of packets lost in a row")
      ->capture_default_str()
      ->excludes(link);
  CLI::Option* scene = recommend.add_option("--scene", a->scene, "With --link: another scene than that of map")
                           ->transform(scene_file)
                           ->needs(link);
  add_robot(recommend, a->robot)->needs(scene);
  recommend.add_option("--seeds", a->seeds, "Runs per method")->capture_default_str();
  recommend.add_option("--methods", a->methods, "NAME,NAME or TRANSPARENCY+PASSIVITY; every named method if absent");
  recommend.add_flag("--json", a->json, "Print the same as JSON");
  add_jobs(recommend, a->jobs);
  recommend.footer(
      "Without --link prints one line: NAME: why. With it, blocks to paste into a scene, the reasons as comments. The "
      "scene is that of `map`: an ordinary hand, device and robot. Recommended is the best; status 3: there is "
      "none.\n" +
      std::string{kBestRule});
  recommend.callback([a, &chosen] { chosen = [a] { return recommend_command(*a); }; });
}

/// Columns of compare and matrix; the glossary shows them.
constexpr const char* kColumns =
    R"(verdict     STABLE; RESTLESS: bounded and passive, but a passivity controller keeps it moving; UNSTABLE; UNDECIDED
pressed     force that the environment takes, mean over the contact
felt err    felt force less that of the environment, as old as the way back makes it, rms over the contact
held        felt force over the environment's at the end of the last rest in contact; 1 is right
muted       share of the contact in which less than a tenth of the environment's force is felt
drag        force felt while nothing touches, rms
chatter     felt force above 30 Hz, rms
turned      angle between felt force and environment's force, rms over the contact
drift       distance of the robot from the delayed hand at the end, at rest
hand, both  least energy put in through the hand's port, through hand's and robot's ports together; passive: at least -E(0))";

struct MatrixArguments {
  MatrixOptions matrix;
  std::optional<int> lanes;
  std::string transparencies, passivities, out, robot;
};

int matrix_command(MatrixArguments& a) {
  a.matrix.transparencies = words_of("--transparency", a.transparencies);
  a.matrix.passivities = words_of("--passivity", a.passivities);
  a.matrix.lanes = checked_lanes(a.lanes.value_or(0));
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.matrix.scene, a.matrix.set);
  if (robot) a.matrix.robot = &*robot;
  if (!a.out.empty()) make_folder(a.out);
  const Matrix all = matrix(a.matrix, show_progress);
  fmt::print("{}what it says: twoport-lab matrix --help\n", to_text(all));
  if (a.out.empty()) return 0;
  write_whole(a.out + "/table.csv", to_csv(to_table(all)));
  fmt::print("{}/table.csv: {} pairs\n{}\n", a.out, all.cells.size(), draw(all, a.out));
  return 0;
}

void add_matrix(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<MatrixArguments>();
  CLI::App& matrix =
      *app.add_subcommand("matrix", "Every transparency layer under every passivity layer, on one scene");
  add_scene(matrix, a->matrix.scene, a->matrix.set);
  add_robot(matrix, a->robot);
  matrix.add_option("--transparency", a->transparencies, "LAYER,LAYER; if absent all that some pair can run with");
  matrix.add_option("--passivity", a->passivities, "LAYER,LAYER; if absent all that some pair can run with");
  matrix.add_option("--out", a->out, "Folder for table.csv and the picture");
  add_jobs(matrix, a->matrix.jobs);
  add_lanes(matrix, a->lanes);
  matrix.footer(std::string{kColumns} + R"(
broken      the passivity layer's claim of energy: the port that it bounds has given more than E(0) and 0.1 mJ

twoport-lab methods --layers lists the layers and what each claims: the hand's port, or both together with E(0) of both
sides. Every pair has the E(0) that the scene has as it is. A claim that counts the device's own damping is not judged.)");
  matrix.callback([a, &chosen] { chosen = [a] { return matrix_command(*a); }; });
}

struct CompareArguments {
  CompareOptions compare;
  std::string methods, robot;
};

int compare_command(CompareArguments& a) {
  a.compare.methods = words_of("--methods", a.methods);
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.compare.scene, a.compare.set);
  if (robot) a.compare.robot = &*robot;
  if (!a.compare.out.empty()) make_folder(a.compare.out);
  const Comparison all = compare(a.compare, show_progress);
  fmt::print("{}what the columns say: twoport-lab compare --help\n", to_text(all));
  if (a.compare.out.empty()) return 0;
  write_whole(a.compare.out + "/table.csv", to_csv(to_table(all)));
  fmt::print("{}/table.csv: {} methods\n{}\n", a.compare.out, all.methods.size(), draw(all, a.compare.out));
  return 0;
}

void add_compare(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<CompareArguments>();
  CLI::App& compare =
      *app.add_subcommand("compare", "Every method on one scene: a table, and their traces in one picture");
  add_scene(compare, a->compare.scene, a->compare.set);
  add_robot(compare, a->robot);
  compare.add_option("--methods", a->methods, "NAME,NAME; all of them if absent");
  compare.add_option("--out", a->compare.out, "Folder for table.csv and the picture");
  add_jobs(compare, a->compare.jobs);
  compare.footer(kColumns + std::string{kBestRule} + R"(
An error is "-" of a run that is not STABLE, and where the scene without delay, loss and control presses nothing or is
unstable. Where the scene states no E(0), every method has that of the default's rule.)");
  compare.callback([a, &chosen] { chosen = [a] { return compare_command(*a); }; });
}

struct GalleryArguments {
  GalleryOptions gallery;
  std::string methods, out;
};

int gallery_command(GalleryArguments& a) {
  a.gallery.methods = words_of("--methods", a.methods);
  if (!a.out.empty()) make_folder(a.out);
  const Gallery all = gallery(a.gallery, show_progress);
  std::fputs(to_text(all).c_str(), stdout);
  if (!a.out.empty()) {
    write_whole(a.out + "/table.csv", to_csv(to_table(all)));
    fmt::print("{}/table.csv: {} rows\n", a.out, all.entries.size() * all.methods.size());
  }
  bool met = true;
  for (const Gallery::Entry& each : all.entries)
    for (const std::string& sentence : each.missed) {
      print_error("{}: {}\n", each.scene, sentence);
      met = false;
    }
  return met ? 0 : 3;
}

void add_gallery(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<GalleryArguments>();
  a->gallery.folder = project_folder("scenes/edge");
  CLI::App& gallery =
      *app.add_subcommand("gallery", "Who survives what: the scenes of a folder, each with every method");
  gallery.add_option("folder", a->gallery.folder,
                     "Folder of scenes (.textproto); absent: scenes/edge, here or in the source tree of this program");
  gallery.add_option("--methods", a->methods, "NAME,NAME; all of them if absent");
  gallery.add_option("--out", a->out, "Folder for table.csv");
  add_jobs(gallery, a->gallery.jobs);
  gallery.footer(
      R"(STABLE, RESTLESS (bounded and passive, but a passivity controller keeps it moving), UNSTABLE, UNDECIDED; mute: STABLE, but more than half
of the contact is felt with less than a tenth of the environment's force.)");
  gallery.callback([a, &chosen] { chosen = [a] { return gallery_command(*a); }; });
}

struct AdversaryArguments {
  AdversaryOptions adversary;
  std::string methods, out;
  bool claiming = false;
};

int adversary_command(AdversaryArguments& a) {
  a.adversary.methods = words_of("--methods", a.methods);
  if (a.claiming) a.adversary.methods = claiming_methods();
  if (!a.out.empty()) make_folder(a.out);
  const Adversary all = attack_all(a.adversary, show_progress);
  std::fputs(to_text(all).c_str(), stdout);
  if (!a.out.empty()) {
    write_whole(a.out + "/table.csv", to_csv(to_table(all)));
    fmt::print("{}/table.csv: {} rows\n", a.out, all.methods.size() * static_cast<std::size_t>(a.adversary.runs));
  }
  std::fputs((broken_runs(all) + moved_runs(all)).c_str(), stderr);
  return all.broken() == 0 && all.moved_by_themselves() == 0 ? 0 : 3;
}

void add_adversary(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<AdversaryArguments>();
  CLI::App& adversary = *app.add_subcommand(
      "adversary", "Hand, robot, network and packets drawn to create energy: the least that each method lets pass");
  adversary.add_option("--methods", a->methods, "NAME,NAME; all of them if absent");
  adversary.add_flag("--joints", a->adversary.joints, "Ports of joints: two arms in place of the drawn bodies");
  adversary.add_flag("--claiming", a->claiming, "Every pair of layers and every method that claims a bound");
  adversary.add_option("--seed", a->adversary.seed, "Of the first run")->capture_default_str();
  adversary.add_option("--runs", a->adversary.runs, "Per method, with seeds counted up")->capture_default_str();
  adversary.add_option("--out", a->out, "Folder for table.csv, a row for each run");
  add_jobs(adversary, a->adversary.jobs);
  adversary.footer(
      R"(hand: least energy through the hand's port; told lies: the same where the slave's reports are replaced; both: through the
hand's and the slave's port together; below -E(0): runs in which the hand gets more than its allowance; self-moved: runs in
which the robot moves more than 1 mm while the hand rests and nothing pushes it. A run that breaks what its method claims, or moves by itself,
is named with the command that runs it again, and the exit status is 3.)");
  adversary.callback([a, &chosen] { chosen = [a] { return adversary_command(*a); }; });
}

}  // namespace

void add_map_commands(CLI::App& app, Chosen& chosen) {
  for (const auto add : {add_adversary, add_compare, add_gallery, add_map, add_matrix, add_recommend}) add(app, chosen);
}

}  // namespace twoport::lab
