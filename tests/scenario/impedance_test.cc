#include "lab/study/impedance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "tests/support/folder.h"
#include "tests/support/process.h"

namespace twoport::lab::impedance_test {
namespace {

using Complex = std::complex<double>;
constexpr double kRate = 1000.0;

std::vector<DisplayedImpedance> of(const std::string& scene) {
  return displayed_impedance(parse_scene("duration_s: 2 rate_hz: 1000 " + scene, "impedance"));
}
Complex displayed(const ImpedanceLine& line) {
  return {line.displayed_re, line.displayed_im};
}
/// 1e-6 of the value: what is left after whole periods is the start, which dies out, and rounding.
void expect_near(const Complex& a, const Complex& b, double hz, double tolerance = 1e-6) {
  EXPECT_LT(std::abs(a - b), tolerance * std::abs(b)) << hz << " Hz: " << a << ", theory " << b;
}

TEST(Impedance, OfASpringRenderedIsTheSpringHalfATickLate) {
  const double k = 800.0, b = 3.0;
  const auto all = of(R"(dof: 1 device { mass_kg: 0.1 } control { architecture: RENDER passivity { method: NONE } }
                         environment { spring { stiffness_n_per_m: 800 damping_n_s_per_m: 3 anchor_m: [0] } })");
  ASSERT_EQ(all.size(), 1u);
  EXPECT_EQ(all[0].place, "contact");
  for (const ImpedanceLine& line : all[0].lines) {
    const double omega = 2.0 * std::numbers::pi * line.frequency_hz, half = 0.5 * omega / kRate;
    const Complex held = std::polar(std::sin(half) / half, -half);
    expect_near(displayed(line), Complex{k, b * omega} * held, line.frequency_hz);
    EXPECT_NEAR(line.true_re, k, 1e-6 * k);
    EXPECT_NEAR(line.true_im, b * omega, 1e-6 * k);
    EXPECT_NEAR(line.coherence, 1.0, 1e-9);
  }
  // The series of e^{-jωT/2} sinc(ωT/2) to second order; the next term is (ωT)²/6, 7e-4 at 10 Hz.
  const double t = 1.0 / kRate;
  EXPECT_NEAR(all[0].displayed.stiffness_n_per_m, k, 1e-5 * k);
  EXPECT_NEAR(all[0].displayed.damping_n_s_per_m, b - 0.5 * k * t, 7e-4 * b);
  EXPECT_NEAR(all[0].displayed.mass_kg, k * t * t / 6.0 - 0.5 * b * t, 1e-5);
}

TEST(Impedance, OfARobotInFreeSpaceIsItsMassBehindItsCoupling) {
  // One tick each way, force doubled. S = s_f C Z/(C + Z) with the coupling's C = K + jωB and the robot's Z = -mω² + jωb.
  const auto all = of(R"(dof: 1 control { force_scale: 2 passivity { method: NONE }
                           virtual_coupling { stiffness_n_per_m: 4000 damping_n_s_per_m: 40 } }
                         robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
                         operator { path { hold { duration_s: 1 } } })");
  ASSERT_EQ(all.size(), 1u);
  EXPECT_EQ(all[0].place, "free space");
  EXPECT_DOUBLE_EQ(all[0].truth.mass_kg, 1.0);
  EXPECT_DOUBLE_EQ(all[0].truth.damping_n_s_per_m, 4.0);
  for (const ImpedanceLine& line : all[0].lines) {
    if (line.frequency_hz > 10.0) continue;
    const double omega = 2.0 * std::numbers::pi * line.frequency_hz;
    const Complex c{4000.0, 40.0 * omega}, z{-0.5 * omega * omega, 2.0 * omega};
    // A tick each way and half a tick of hold on either side, less the tick by which the coupling is ahead: 2 ms.
    const double late = std::arg(displayed(line) / (2.0 * c * z / (c + z)));
    EXPECT_NEAR(std::abs(displayed(line)), std::abs(2.0 * c * z / (c + z)), 0.02 * std::abs(displayed(line)));
    EXPECT_NEAR(late, -2e-3 * omega, 0.3e-3 * omega) << line.frequency_hz;
  }
  EXPECT_NEAR(all[0].displayed.mass_kg, 1.0, 0.1);
  EXPECT_GT(all[0].least_coherence, 1.0 - 1e-6);
}

TEST(Impedance, OfAWallIsTakenWhileItTouches) {
  const auto all = of(R"(dof: 3
    operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
               path { move_to { position_m: [0.03, 0, 0] duration_s: 1 } } }
    device { mass_kg: 0.075 damping_n_s_per_m: 0.05 }
    control { virtual_coupling { stiffness_n_per_m: 2000 damping_n_s_per_m: 20 } passivity { method: NONE } }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
    environment { wall { normal: [-1, 0, 0] offset_m: -0.01 stiffness_n_per_m: 3000 damping_n_s_per_m: 5 } })");
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].place, "free space");
  EXPECT_EQ(all[1].place, "contact");
  EXPECT_NEAR(all[1].truth.stiffness_n_per_m, 3000.0, 1.0);
  EXPECT_NEAR(all[1].truth.damping_n_s_per_m, 7.0, 0.01);
  // Coupling and wall in series.
  EXPECT_NEAR(all[1].displayed.stiffness_n_per_m, 1200.0, 30.0);
  EXPECT_GT(all[1].least_coherence, 0.9999);
  EXPECT_LT(std::abs(all[0].displayed.stiffness_n_per_m), 1.0);
}

TEST(Impedance, OfADelayedLinkUnderAControllerIsNeitherTrueNorCoherent) {
  const auto all = displayed_impedance(load_scene(
      TWOPORT_SCENES "/demo.textproto", std::vector<std::string>{"control.passivity.method=FORCE_PROJECTED"}));
  ASSERT_EQ(all.size(), 2u);
  EXPECT_LT(all[1].displayed.stiffness_n_per_m, 0.5 * all[1].truth.stiffness_n_per_m);
  EXPECT_LT(all[1].least_coherence, 0.99);
}

/// A spring on the device, with other properties of the device.
double coherence_with(const std::string& device) {
  const auto all = of("dof: 1 device { mass_kg: 0.1 damping_n_s_per_m: 1 " + device + R"( }
    control { architecture: RENDER passivity { method: NONE } }
    environment { spring { stiffness_n_per_m: 800 anchor_m: [0] } })");
  EXPECT_EQ(all.size(), 1u);
  return all.at(0).least_coherence;
}

TEST(Impedance, IsCoherentWhereTheForceIsLinearInTheMotion) {
  EXPECT_GT(coherence_with(""), 0.999);
  EXPECT_GT(coherence_with("max_force_n: 1"), 0.999);               // of 0.8 N
  EXPECT_GT(coherence_with("position_resolution_m: 1e-7"), 0.999);  // of 1 mm
}

TEST(Impedance, IsLessCoherentTheLessLinearTheForceIs) {
  // 0.8 N is the largest that the spring asks for.
  const double little = coherence_with("max_force_n: 0.5"), more = coherence_with("max_force_n: 0.2");
  EXPECT_LT(little, 0.99);
  EXPECT_LT(more, 0.9);
  EXPECT_LT(more, little);
  // A coarse encoder: the lines up to 10 Hz share 1 mm.
  const double fine = coherence_with("position_resolution_m: 1e-4"),
               coarse = coherence_with("position_resolution_m: 1e-3");
  EXPECT_LT(fine, 0.99);
  EXPECT_LT(coarse, fine);
  // A force that does not change at all: the handle stays within one step of the encoder.
  const auto still = of(R"(dof: 1 device { mass_kg: 0.1 damping_n_s_per_m: 1 position_resolution_m: 0.01 }
                           operator { path { hold { duration_s: 1 } } }
                           control { architecture: RENDER passivity { method: NONE } }
                           environment { spring { stiffness_n_per_m: 800 anchor_m: [0.005] } })");
  ASSERT_EQ(still.size(), 1u);
  EXPECT_EQ(still[0].least_coherence, 0.0);
}

/// What is said of a scene that cannot be measured.
std::string refused(const std::string& scene) {
  try {
    of(scene);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "measured";
}
void expect_words(const std::string& said, const std::vector<std::string>& words) {
  for (const std::string& each : words) EXPECT_NE(said.find(each), std::string::npos) << said;
  EXPECT_EQ(said.find('\n'), std::string::npos) << said;
}
/// A hand presses a wall, `distance` away, over a link.
std::string press(const std::string& distance, const std::string& more) {
  return R"(dof: 1
    operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
               path { move_to { position_m: [0.03] duration_s: 1 } } }
    device { mass_kg: 0.075 damping_n_s_per_m: 0.05 }
    control { virtual_coupling { stiffness_n_per_m: 2000 damping_n_s_per_m: 20 } passivity { method: NONE } }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
    environment { wall { normal: [-1] offset_m: )" +
         distance + " stiffness_n_per_m: 3000 damping_n_s_per_m: 5 } } " + more;
}

TEST(Impedance, OfAnUnstableSceneIsRefused) {
  expect_words(refused(R"(dof: 1 device { mass_kg: 0.1 position_m: [0.001] }
                          control { architecture: RENDER passivity { method: NONE } }
                          environment { spring { stiffness_n_per_m: 5000 anchor_m: [0] } })"),
               {"impedance: ", "unstable loop", "control.passivity.method", "stiffness", "twoport-lab run"});
}

TEST(Impedance, OfAHandThatIsNeverFreeIsRefused) {
  expect_words(refused(press("0", "")), {"impedance: ", "free space", "0.001 m", "operator.path", "--amplitude"});
  EXPECT_EQ(refused(press("-0.01", "")), "measured");
}

TEST(Impedance, OfSidesThatNeverMeetIsRefused) {
  for (const char* silent : {"to_slave { loss: 1 }", "to_master { loss: 1 }"})
    expect_words(refused(press("-0.01", silent)), {"impedance: ", "never coupled", "loss", "to_slave", "to_master"});
}

TEST(Impedance, NeedsAMasterPort) {
  EXPECT_THROW(static_cast<void>(of("dof: 1 control { architecture: UNCONTROLLED } robot { mass_kg: 1 }")),
               ConfigError);
}

TEST(Impedance, ThatIsRefusedIsOneSentenceAndNoTable) {
  const test::Folder folder;
  test::Process lab{
      {TWOPORT_LAB, "impedance", TWOPORT_SCENES "/held_spring_unstable.textproto", "--out", folder / "out"}};
  EXPECT_EQ(lab.wait(), test::exited(2));
  EXPECT_EQ(lab.out(), "");
  expect_words(lab.err().substr(0, lab.err().find('\n')), {"twoport-lab: held spring, unstable: ", "unstable loop"});
  EXPECT_FALSE(std::filesystem::exists(folder / "out/table.csv"));
}

TEST(Impedance, IsATableAndAPicture) {
  const test::Folder folder;
  test::Process lab{{TWOPORT_LAB, "impedance", TWOPORT_SCENES "/one_axis_wall.textproto", "--out", folder / "out"}};
  EXPECT_EQ(lab.wait(), test::exited(0)) << lab.err();
  EXPECT_NE(lab.out().find("stiffness [N/m]"), std::string::npos) << lab.out();
  EXPECT_NE(test::read_text(folder / "out/table.csv").find("contact,"), std::string::npos);
}

}  // namespace
}  // namespace twoport::lab::impedance_test
