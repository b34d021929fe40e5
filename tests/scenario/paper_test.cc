#include "lab/paper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <string>
#include <tuple>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "tests/support/process.h"
#include "tests/support/svg.h"

namespace twoport::lab::paper_test {
namespace {

/// Two seeds of a case, measured once however many tests ask.
const PaperNumbers& numbers(const char* experiment, const char* method, const char* sensor = "ideal") {
  static std::map<std::string, PaperNumbers> kept;
  const std::string key = std::string{experiment} + "/" + method + "/" + sensor;
  const auto found = kept.find(key);
  if (found != kept.end()) return found->second;
  return kept[key] = measure(paper_case(experiment, "light", sensor, method), 2);
}
double share(std::uint64_t part, std::uint64_t of) {
  return static_cast<double>(part) / static_cast<double>(of);
}

constexpr const char* kExperiments[] = {"point", "slide", "curved"};
constexpr const char* kSensors[] = {"ideal", "encoder"};

// ---- the paper's claims

TEST(Paper, WithoutControlTheWallMakesEnergyAndRattles) {
  for (const char* experiment : kExperiments) {
    const PaperNumbers& n = numbers(experiment, "none");
    // Reported: -0.120 to -0.125 J, 2.0 mm deep, in contact 36 % of the time. The limit cycle does not depend on how it
    // began, only when: 20 %.
    EXPECT_NEAR(n.min_energy_j, -0.125, 0.2 * 0.125) << experiment;
    EXPECT_NEAR(n.max_depth_m, 2.0e-3, 0.2 * 2.0e-3) << experiment;
    EXPECT_NEAR(share(n.contact_ticks, n.ticks), 0.36, 0.05) << experiment;
    EXPECT_NEAR(numbers(experiment, "none", "encoder").min_energy_j, -0.075, 0.3 * 0.075) << experiment;
  }
}

TEST(Paper, AxesShareTheEnergyAsTheirChoiceHasItButTheSumIsThePorts) {
  const PaperNumbers &slide = numbers("slide", "none"), &point = numbers("point", "none");
  for (const PaperNumbers* n : {&slide, &point}) {
    const auto& e = n->axis_energy_j;
    EXPECT_NEAR(e[0] + e[1] + e[2], n->energy_j, 1e-12);  // sums of some 1e4 terms of 1e-4 J: rounding
  }
  // Nothing tangential acts on the frictionless wall: sliding changes the axes, not the sum.
  EXPECT_NEAR(slide.energy_j, point.energy_j, 1e-9);
  EXPECT_GT(std::abs(slide.axis_energy_j[0] - point.axis_energy_j[0]), 1e-3);
}

TEST(Paper, DampingAlongTheVelocityTurnsTheForceAndSlidingMoreThanPressing) {
  const PaperNumbers &point = numbers("point", "classic"), &slide = numbers("slide", "classic"),
                     &curved = numbers("curved", "classic");
  // Reported 10.8, 30.1 and 29.3 deg rms. The share of ticks on which it acts is chaotic: a factor 2, and 20 %.
  EXPECT_GT(point.direction_deg.rms(), 0.5 * 10.8);
  EXPECT_LT(point.direction_deg.rms(), 2.0 * 10.8);
  EXPECT_NEAR(slide.direction_deg.rms(), 30.1, 6.0);
  EXPECT_NEAR(curved.direction_deg.rms(), 29.3, 6.0);
  EXPECT_GT(slide.direction_deg.rms(), 2.0 * point.direction_deg.rms());
  EXPECT_NEAR(slide.tip_n.rms(), 0.129, 0.2 * 0.129);
  EXPECT_NEAR(curved.tip_n.rms(), 0.127, 0.2 * 0.127);
  const PaperNumbers &rough_point = numbers("point", "classic", "encoder"),
                     &rough_slide = numbers("slide", "classic", "encoder");
  EXPECT_GT(rough_slide.direction_deg.rms(), 2.0 * rough_point.direction_deg.rms());
}

TEST(Paper, DampingAlongTheForceNeverTurnsIt) {
  for (const char* experiment : kExperiments) {
    for (const char* sensor : kSensors) {
      for (const char* method : {"projected", "projected reference"}) {
        const PaperNumbers& n = numbers(experiment, method, sensor);
        // A scalar times a vector: one rounding per component, 1e-16 of it.
        EXPECT_LT(n.direction_deg.max, 1e-12) << experiment << sensor << method;
        EXPECT_LT(n.tip_n.max, 1e-14) << experiment << sensor << method;
        EXPECT_EQ(n.pulling_ticks, 0U) << experiment << sensor << method;
      }
    }
  }
  // Against the true wall an encoder sees the normal of where it believes to be: 15 um of 60 mm is 0.014 deg.
  EXPECT_LT(numbers("curved", "projected").normal_direction_deg.max, 1e-12);
  EXPECT_LT(numbers("curved", "projected", "encoder").normal_direction_deg.max, 0.03);
  EXPECT_GT(numbers("curved", "projected", "encoder").normal_direction_deg.max, 0.003);
}

TEST(Paper, PointAndSlideAreTheSameToADampingAlongTheForce) {
  // Along the normal nothing knows of the sliding: rounding, grown by four seconds of a switching loop.
  EXPECT_NEAR(numbers("slide", "projected").min_energy_j, numbers("point", "projected").min_energy_j, 1e-7);
}

TEST(Paper, ControlKeepsThePortPassiveToATenthOfAMillijoule) {
  for (const char* experiment : kExperiments) {
    for (const char* method : {"classic", "projected"}) {
      const double worst = numbers(experiment, method).min_energy_j;
      // Reported -6.1e-5 to -1.2e-4 J: what one interval makes before the next can repay it. A factor 2.
      EXPECT_GT(worst, -2.4e-4) << experiment << method;
      EXPECT_LT(worst, -3.0e-5) << experiment << method;
    }
  }
}

// ---- what the literal equations do

TEST(Paper, TheLiteralEquationsPullTheHandIn) {
  const PaperNumbers &literal = numbers("slide", "projected literal"), &capped = numbers("slide", "projected");
  // Reported: 18 % of contact ticks pull, and more energy made than with the cap.
  EXPECT_NEAR(share(literal.pulling_ticks, literal.contact_ticks), 0.18, 0.06);
  EXPECT_LT(literal.min_energy_j, 2.0 * capped.min_energy_j);
  EXPECT_GT(literal.max_correction_n, 8.5);  // from pushing to pulling at the device's limit
  EXPECT_GT(share(literal.saturated_ticks, literal.contact_ticks), 0.01);
  const PaperNumbers& encoder = numbers("slide", "projected literal", "encoder");
  EXPECT_GT(share(encoder.pulling_ticks, encoder.contact_ticks), 0.3);  // reported 0.49
  EXPECT_LT(encoder.min_energy_j, -2e-3);                               // reported -7.7e-3
}

TEST(Paper, TheRectangleOfEquationTwoSeesNothing) {
  const PaperNumbers &blind = numbers("slide", "projected eq. 2"), &none = numbers("slide", "none");
  EXPECT_LT(blind.min_energy_j, 0.9 * none.min_energy_j);
}

// ---- what the paper leaves open

TEST(Paper, ReferenceEnergyFollowsTheIdealSpring) {
  for (const char* experiment : kExperiments) {
    const PaperNumbers& n = numbers(experiment, "projected reference");
    EXPECT_GE(n.min_energy_j, -1e-6) << experiment;
    EXPECT_GE(n.min_surplus_j, -1e-6) << experiment;  // reported -6.9e-8
    EXPECT_LT(n.max_correction_n, 2.0 * 0.105) << experiment;
    // α = K T/2 = 1.25 N s/m, and the repayment of what the prediction missed: reported 2.4.
    EXPECT_GT(n.max_gain_n_s_per_m, 1.25) << experiment;
    EXPECT_LT(n.max_gain_n_s_per_m, 2.5) << experiment;
    EXPECT_LT(n.mean_correction_n, 0.012) << experiment;  // reported 0.012, and 0.046 for the projection alone
  }
  // No cap is needed with an ideal sensor.
  EXPECT_EQ(numbers("slide", "projected reference uncapped").max_correction_n,
            numbers("slide", "projected reference").max_correction_n);
  // With an encoder it is: the observed energy is wrong by up to K q²/2 a count.
  EXPECT_LT(numbers("slide", "projected reference uncapped", "encoder").min_energy_j, -1e-3);
  EXPECT_GT(numbers("slide", "projected reference", "encoder").min_energy_j, -1e-5);
}

TEST(Paper, FrictionHidesEnergyFromOneAccountAndNotFromTwo) {
  const PaperNumbers &none = numbers("friction", "none"), &total = numbers("friction", "projected reference total"),
                     &apart = numbers("friction", "projected reference");
  EXPECT_GE(total.min_energy_j, -1e-6);                    // passive, says the sum,
  EXPECT_LT(total.min_normal_energy_j, -0.05);             // but the wall gives away as much
  EXPECT_NEAR(total.max_depth_m, none.max_depth_m, 2e-4);  // and rattles as without control
  EXPECT_NEAR(total.max_depth_m, 2.04e-3, 0.2 * 2.04e-3);  // reported
  EXPECT_GE(apart.min_normal_energy_j, -1e-6);             // reported -7e-8
  EXPECT_LT(apart.max_depth_m, 0.67e-3);                   // reported
  EXPECT_LT(apart.speed_m_per_s.rms(), 0.135);             // reported; sliding alone is 0.111
}

TEST(Paper, TheAdmittanceIsTheDual) {
  const std::vector<AdmittanceRun> runs = admittance_runs();
  ASSERT_EQ(runs.size(), 3U);
  EXPECT_GT(runs[0].stopped_at_s, 0.0) << "b = 0.5 < k T/2 = 1.25 N s/m and nothing bounds it";
  for (std::size_t i : {1U, 2U}) {
    EXPECT_EQ(runs[i].stopped_at_s, 0.0) << runs[i].method;
    EXPECT_GT(runs[i].min_energy_j, -1e-3) << runs[i].method;
    EXPECT_LT(runs[i].most_speed_m_per_s, 0.5) << runs[i].method;
  }
  EXPECT_GT(runs[1].direction_deg.rms(), 5.0);
  EXPECT_LT(runs[2].direction_deg.max, 1e-12);
}

TEST(Paper, NoFrameIsBetterThanAnother) {
  for (const FrameCheck& f : frame_checks()) {
    EXPECT_LT(f.energy_per_tick_frames, 1e-12) << f.method;
    // A force E/(T v) magnifies rounding of E, 1e-19 J, by 1/(T v); the cap ends it at 10 N s/m · v: 5e-8 N.
    EXPECT_LT(f.force_per_tick_frames, 1e-7) << f.method;
    // Fed back through a switching loop for four seconds.
    EXPECT_LT(f.energy_turned_world, 1e-6) << f.method;
    EXPECT_LT(f.path_turned_world_m, 1e-6) << f.method;
  }
}

// ---- the command's own

TEST(Paper, CarriesTheScenesThatStandInTheirFolder) {
  for (const char* name : {"point", "slide", "curved", "friction"}) {
    const Scene mine = paper_scene(paper_case(name, "light", "ideal", "projected reference"), 1);
    const Scene theirs = load_scene(TWOPORT_SCENES "/paper/" + std::string{name} + ".textproto");
    EXPECT_EQ(mine.name, theirs.name);
    EXPECT_EQ(scene_digest(mine), scene_digest(theirs));
  }
}

TEST(Paper, RefusesNamesThatItDoesNotKnow) {
  EXPECT_THROW(static_cast<void>(paper_case("slide", "light", "ideal", "magic")), ConfigError);
  EXPECT_THROW(static_cast<void>(paper_case("slide", "light", "perfect", "none")), ConfigError);
  EXPECT_THROW(static_cast<void>(paper_case("slide", "iron", "ideal", "none")), ConfigError);
  EXPECT_THROW(static_cast<void>(paper_case("slide sideways", "light", "ideal", "none")), ConfigError);
  EXPECT_THROW(static_cast<void>(paper_scene({"tunnel", "light", "ideal", "none", {}}, 1)), ConfigError);
}

// ---- the pictures

using Eigen::Vector2d;
using test::Box;
using test::DrawnShape;
using test::Points;

/// All figures, made once.
const std::vector<Picture>& pictures() {
  static const std::vector<Picture> all = [] {
    std::vector<Picture> made;
    for (const PaperFigure& figure : paper_figures()) made.push_back(figure.make());
    return made;
  }();
  return all;
}
const Picture& picture(const std::string& name) {
  return *std::find_if(pictures().begin(), pictures().end(), [&](const Picture& p) { return p.name == name; });
}
/// What gnuplot makes of a picture; nothing where it is not installed.
std::vector<DrawnShape> shapes(const Picture& p) {
  const test::Folder folder;
  const std::string said = draw(p, folder / ".");
  if (said.find("gnuplot is not installed") != said.npos) return {};
  EXPECT_EQ(said.find("gnuplot failed"), said.npos) << said;
  const std::vector<DrawnShape> drawn = test::shapes_of(test::read_text(folder / (p.name + ".svg")));
  EXPECT_FALSE(drawn.empty()) << p.name;
  return drawn;
}
Points corners(const Series& s) {
  Points all;
  for (const std::vector<double>& row : s.rows) all.emplace_back(row[0], row[1]);
  return all;
}
bool encloses(const Points& polygon, const Vector2d& p) {
  bool inside = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Vector2d &a = polygon[i], &b = polygon[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
      inside = !inside;
  }
  return inside;
}
double length(const Points& line) {
  double sum = 0.0;
  for (std::size_t i = 1; i < line.size(); ++i) sum += (line[i] - line[i - 1]).norm();
  return sum;
}
bool has_ends(const Scale& s) {
  return std::isfinite(s.low) && std::isfinite(s.high);
}

TEST(PaperFigures, TheWallIsWhereTheForceIs) {
  for (const auto& [name, experiment, methods] :
       {std::tuple<const char*, const char*, std::vector<std::string>>{"fig7", "slide", {"none"}},
        {"fig8", "point", {"classic", "projected"}},
        {"fig9", "slide", {"classic", "projected"}}}) {
    for (std::size_t i = 0; i < methods.size(); ++i) {
      const Panel& panel = picture(name).panels[i];
      const Points wall = corners(panel.series[0]);
      int ticks_in_contact = 0, ticks_free = 0;
      for (const Row<3>& r : record(paper_case(experiment, "light", "ideal", methods[i]), 1)) {
        const Vector2d x = 1e3 * r.master_x.translation().head<2>();
        if (x.cwiseAbs().maxCoeff() > panel.x.high) continue;
        const bool pushes = r.master_f_wanted.squared_norm() > 0.0;
        ASSERT_EQ(encloses(wall, x), pushes) << name << ", t = " << r.t_s << ", at " << x.transpose();
        ++(pushes ? ticks_in_contact : ticks_free);
      }
      EXPECT_GT(ticks_in_contact, 1000) << name;
      EXPECT_GT(ticks_free, 0) << name;
    }
  }
  // Figs. 4 and 6 have the same wall, and their force is perpendicular to it.
  for (const Panel& panel : picture("fig4_6").panels) {
    const Points wall = corners(panel.series[0]), like = corners(picture("fig9").panels[0].series[0]);
    ASSERT_EQ(wall.size(), like.size());
    for (std::size_t i = 0; i < wall.size(); ++i)
      EXPECT_LT((wall[i] / panel.x.high - like[i] / 70.0).norm(), 1e-12) << wall[i].transpose();
    const Series& force =
        *std::find_if(panel.series.begin(), panel.series.end(), [](const Series& s) { return s.name == "f_VR"; });
    const Vector2d f{force.rows[0][2], force.rows[0][3]}, surface = (wall[1] - wall[0]).normalized();
    EXPECT_GT(f.norm(), 1.0);
    EXPECT_LT(std::abs(f.dot(surface)), 1e-12);
  }
}

TEST(PaperFigures, ShowAllThatTheyDrawWithinTheirAxes) {
  for (const Picture& p : pictures())
    for (const Panel& panel : p.panels)
      for (const Series& s : panel.series)
        for (const std::vector<double>& row : s.rows) {
          if (std::isnan(row[0])) continue;
          const std::size_t dimensions = panel.z ? 3 : 2;
          const Scale* scales[] = {&panel.x, &panel.y, panel.z ? &*panel.z : nullptr};
          for (std::size_t i = 0; i < dimensions; ++i) {
            if (!has_ends(*scales[i])) continue;
            // An arrow with its tip.
            for (std::size_t tip = 0; tip < (row.size() > dimensions ? 2U : 1U); ++tip) {
              const double at = row[i] + (tip == 0 ? 0.0 : row[dimensions + i]);
              ASSERT_GE(at, scales[i]->low) << p.name << ": " << scales[i]->label.words;
              ASSERT_LE(at, scales[i]->high) << p.name << ": " << scales[i]->label.words;
            }
          }
        }
}

TEST(PaperFigures, AreDrawnByGnuplotAsTheirDataAre) {
  constexpr double kPixel = 0.2;  // rounding, in gnuplot and in the border
  int compared = 0;
  for (const Picture& p : pictures()) {
    if (p.panels[0].z) continue;
    const std::vector<DrawnShape> drawn = shapes(p);
    if (drawn.empty()) GTEST_SKIP() << "gnuplot is not installed";
    const std::vector<Box> axes = test::axes_in(drawn);
    ASSERT_EQ(axes.size(), p.panels.size()) << p.name;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      const Panel& panel = p.panels[i];
      if (!has_ends(panel.x) || !has_ends(panel.y)) continue;
      for (const Series& s : panel.series) {
        if (s.look == Look::words) continue;
        const bool arrows = s.look == Look::arrows || s.look == Look::strokes;
        Points expected;
        const auto expect = [&](double x, double y) {
          const Vector2d size = axes[i].high - axes[i].low;
          expected.emplace_back(axes[i].low.x() + (x - panel.x.low) / (panel.x.high - panel.x.low) * size.x(),
                                axes[i].high.y() - (y - panel.y.low) / (panel.y.high - panel.y.low) * size.y());
        };
        for (const std::vector<double>& row : s.rows) {
          expect(row[0], row[1]);
          if (arrows) expect(row[0] + row[2], row[1] + row[3]);
        }
        test::Near of_data{kPixel}, of_picture{kPixel};
        for (const Vector2d& x : expected) of_data.add(x);
        const std::string which = p.name + ": " + s.name + " " + s.colour;
        // A shape belongs to the panel in which it has a point; those of the legend, above, to none.
        for (const DrawnShape& shape : drawn) {
          if (shape.colour != test::colour_in_svg(s.colour)) continue;
          if (std::none_of(shape.points.begin(), shape.points.end(),
                           [&](const Vector2d& x) { return axes[i].contains(x, kPixel); }))
            continue;
          for (const Vector2d& x : shape.points) {
            of_picture.add(x);
            // An arrow's head has corners of its own.
            ASSERT_TRUE(arrows || of_data.has(x)) << which << ": drawn at " << x.transpose();
          }
        }
        for (const Vector2d& x : expected)
          ASSERT_TRUE(of_picture.has(x)) << which << ": not drawn at " << x.transpose();
        ++compared;
      }
    }
  }
  EXPECT_EQ(compared, 55);
}

TEST(PaperFigures, NothingHidesThePathOnTheCurvedWallAndThePageHasRoomForIt) {
  const Picture& p = picture("fig10");
  const std::vector<DrawnShape> drawn = shapes(p);
  if (drawn.empty()) GTEST_SKIP() << "gnuplot is not installed";
  // Seen from the direction that the panel names, in a unit that is not known.
  const double tilt = p.panels[0].view_deg.first * std::numbers::pi / 180.0,
               turn = p.panels[0].view_deg.second * std::numbers::pi / 180.0;
  const Series& path = p.panels[0].series[1];
  Points expected, found;
  for (const std::vector<double>& x : path.rows) {
    const double right = std::cos(turn) * x[0] + std::sin(turn) * x[1],
                 back = std::cos(turn) * x[1] - std::sin(turn) * x[0];
    expected.emplace_back(right, -std::cos(tilt) * back - std::sin(tilt) * x[2]);
  }
  double drawn_length = 0.0;
  Box page;  // of 720 x 520 pixels for the panel, and what is around it
  page.add({0.0, 0.0});
  page.add({850.0, 656.0});
  for (const DrawnShape& shape : drawn) {
    for (const Vector2d& x : shape.points) ASSERT_TRUE(page.contains(x, -5.0)) << x.transpose();
    // Longer than what stands for it in the legend.
    if (shape.colour != test::colour_in_svg(path.colour) || shape.points.size() < 3) continue;
    found.insert(found.end(), shape.points.begin(), shape.points.end());
    drawn_length += length(shape.points);
  }
  ASSERT_FALSE(found.empty());
  const Vector2d of_expected = test::box_of(expected).high - test::box_of(expected).low,
                 of_found = test::box_of(found).high - test::box_of(found).low;
  const double unit = of_found.x() / of_expected.x();
  EXPECT_GT(unit, 3.0);  // pixels in a millimetre: large enough to be seen
  EXPECT_NEAR(of_found.y(), unit * of_expected.y(), 1.0);
  EXPECT_NEAR(drawn_length, unit * length(expected), 0.02 * drawn_length);
}

TEST(Paper, IsOneCommand) {
  const test::Folder folder;
  test::Process p = test::finished({TWOPORT_LAB, "paper", "--out", folder / "paper"});
  ASSERT_EQ(p.wait(), test::exited(0)) << p.err();
  EXPECT_EQ(p.out().find("gnuplot failed"), std::string::npos) << p.out();
  const std::string table = test::read_text(folder / "paper/table.txt");
  EXPECT_NE(p.out().find(table), std::string::npos);
  const bool drawn = p.out().find("gnuplot is not installed") == std::string::npos;
  for (const PaperFigure& figure : paper_figures()) {
    for (const char* ending : {".dat", ".gp"})
      EXPECT_GT(std::filesystem::file_size(folder / ("paper/" + figure.name + ending)), 100U) << figure.name;
    for (const char* ending : {".png", ".svg"})
      if (drawn) {
        EXPECT_GT(std::filesystem::file_size(folder / ("paper/" + figure.name + ending)), 10'000U) << figure.name;
      }
  }
  const std::string csv = test::read_text(folder / "paper/figures.csv");
  EXPECT_EQ(static_cast<std::size_t>(test::count(csv, "\n")), paper_cases().size() + 1);
}

TEST(Paper, AsksForWhatItNeeds) {
  const auto refused = [](std::vector<std::string> more, const char* words) {
    more.insert(more.begin(), {TWOPORT_LAB, "paper"});
    test::Process p = test::finished(more);
    EXPECT_EQ(p.wait(), test::exited(2)) << p.err();
    EXPECT_NE(p.err().find(words), std::string::npos) << p.err();
  };
  refused({}, "--out is missing: ");
  refused({"--out", "/proc/paper"}, "--out /proc/paper: cannot be created");
  refused({"--out", "x", "--jobs", "0"}, "--jobs is 0; it must be at least 1");
}

TEST(Paper, TableHasALineForEachCaseAndSaysWhatIsKnown) {
  PaperTable table;
  for (const PaperCase& c : paper_cases()) table.results.push_back({c, {}});
  const std::string csv = paper_csv(table);
  EXPECT_EQ(static_cast<std::size_t>(std::count(csv.begin(), csv.end(), '\n')), table.results.size() + 1);
  EXPECT_EQ(paper_reported(paper_case("slide", "light", "ideal", "classic")).min_energy_j, -1.2e-4);
  EXPECT_TRUE(std::isnan(paper_reported(paper_case("slide", "firm", "ideal", "classic")).min_energy_j));
  EXPECT_NE(paper_text(table).find("Summary\n  Without"), std::string::npos);
  EXPECT_THROW(static_cast<void>(table.at("slide", "light", "ideal", "magic")), ConfigError);
}

}  // namespace
}  // namespace twoport::lab::paper_test
