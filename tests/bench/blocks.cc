// Cost of a tick of the blocks of a scene in six degrees of freedom, and of other engines that are installed, in one run; one thread, ns,
// the least of five rounds in turn.
//
//   bench_blocks [SCENES]   the folder of scenes, scenes unless given

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "common/method/render/god_object.h"
#include "common/scene/load.h"
#include "lab/peers/peers.h"
#include "sim/sim_robot.h"

namespace {

using namespace twoport;
using Eigen::Vector3d;

struct Block {
  std::string what;
  std::function<double()> round;  ///< ns of a tick
  double least = std::numeric_limits<double>::infinity();
};

template <class Tick>
double ns_of(int ticks, Tick tick) {
  const auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < ticks; ++k) tick(k);
  return std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / ticks;
}

/// n points 1 cm apart on the underside of a tool.
std::vector<Vector3d> underside(int n) {
  const int side = static_cast<int>(std::ceil(std::sqrt(n)));
  std::vector<Vector3d> points;
  for (int i = 0; i < n; ++i)
    points.push_back({0.01 * (i % side - 0.5 * (side - 1)), 0.01 * (i / side - 0.5 * (side - 1)), -0.02});
  return points;
}

/// 1 kg on a rough plane, pressed with 10 N and pushed to and fro along it.
double body_on_plane(int points, const char* integrator) {
  std::string text = fmt::format(
      "dof: 6 duration_s: 1 control {{ architecture: UNCONTROLLED }} simulation {{ integrator: {} }} robot {{ mass_kg: "
      "1 "
      "inertia_kg_m2: [2e-3, 2e-3, 2e-3] position_m: [0, 0, 0.02] }} environment {{ wall {{ normal: [0, 0, 1] "
      "stiffness_n_per_m: {} damping_n_s_per_m: {} friction: 0.3 }} }} tool {{ ",
      integrator, 8e4 / points, 200.0 / points);
  for (const Vector3d& p : underside(points))
    text += fmt::format("contact_point {{ position_m: [{}, {}, {}] }} ", p.x(), p.y(), p.z());
  sim::SimRobot<6> robot{parse_scene(text + "}", "bench"), Seconds{5e-4}};
  return ns_of(points > 8 ? 400 : 2000, [&](int k) {
    Force<6>::Vector f;
    f << 4 * std::sin(0.01 * k), 1, -10, 0, 0, 0;
    robot.actuate({.f = Force<6>{f}, .x_d = {}, .v_d = {}});
    robot.move();
  });
}
double tumbling(const char* integrator) {
  sim::SimRobot<6> robot{
      parse_scene(fmt::format("dof: 6 duration_s: 1 control {{ architecture: UNCONTROLLED }} simulation "
                              "{{ integrator: {} }} robot {{ mass_kg: 1 inertia_kg_m2: [1e-3, 2e-3, "
                              "2.6e-3] velocity_m_per_s: [0, 0, 0, 1, 15, 1] }}",
                              integrator),
                  "bench"),
      Seconds{5e-4}};
  return ns_of(20'000, [&](int) { robot.move(); });
}
double rendered(int points) {
  const Environment<6> environment{{Surface{Wall{Vector3d::UnitZ(), 0}, {1000, 0, 0, 0}}}, underside(points)};
  double sum = 0.0;
  const double ns = ns_of(200'000 / points, [&](int k) {
    const Position<6> x{Vector3d{0, 0, 0.019 - 1e-9 * k}, Eigen::Quaterniond::Identity()};
    sum += environment.force(x, Velocity<6>{})[2];
  });
  return std::isfinite(sum) ? ns : -1.0;
}
double god_object() {
  const Environment<6> environment{{Surface{Box{{0, 0, -0.05}, {0.05, 0.05, 0.05}}, {1, 0, 0, 0}}}, underside(8)};
  GodObject<6> proxy{{.stiffness_n_per_m = 2000,
                      .damping_n_s_per_m = 0,
                      .rotational_stiffness_n_m_per_rad = 4,
                      .rotational_damping_n_m_s_per_rad = 0},
                     environment};
  const auto at = [](double x, double z) { return Position<6>{Vector3d{x, 0, z}, Eigen::Quaterniond::Identity()}; };
  for (int k = 0; k <= 400; ++k) proxy.follow(at(0, 0.03 - 1e-4 * 0.4 * k));
  return ns_of(5000, [&](int k) { proxy.follow(at(5e-3 * std::sin(1e-3 * k), 0.014)); });
}

}  // namespace

int main(int argc, char** argv) {
  const std::string scenes = argc > 1 ? argv[1] : "scenes";
  std::vector<Block> lines;
  for (const char* integrator : {"EXACT", "DORMAND_PRINCE"}) {
    lines.push_back({fmt::format("body tumbling at 15 rad/s, {}", integrator), [=] { return tumbling(integrator); }});
    for (const int n : {1, 8, 48, 300})
      lines.push_back({fmt::format("body on a rough plane, {} points, {}", n, integrator),
                       [=] { return body_on_plane(n, integrator); }});
  }
  const Scene box = load_scene(scenes + "/chart/box_on_plane.textproto");
  for (const char* integrator : {"EXACT", "DORMAND_PRINCE"})
    lines.push_back({fmt::format("box_on_plane, 8 points, {}", integrator), [=] {
                       const std::string set[] = {fmt::format("simulation.integrator={}", integrator)};
                       sim::SimRobot<6> robot{load_scene(scenes + "/chart/box_on_plane.textproto", set), Seconds{5e-4}};
                       return ns_of(2000, [&](int) { robot.move(); });
                     }});
  for (const lab::Peer& peer : lab::peers_for(box))
    lines.push_back({"box_on_plane, 8 points, " + peer.name, [=] { return 1e9 * peer.seconds() / 2000; }});
  for (const int n : {1, 8, 48, 300})
    lines.push_back({fmt::format("force of a plane on {} points", n), [=] { return rendered(n); }});
  lines.push_back({"god-object, sliding, box of 8 points on a box", god_object});
  const Scene arm = load_scene(scenes + "/arm_on_plate.textproto");
  lines.push_back({"arm of seven joints on a plate, 2 kHz", [&] {
                     sim::SimRobot<6> robot{arm, Seconds{5e-4}};
                     return ns_of(2000, [&](int) { robot.move(); });
                   }});
  for (int round = 0; round < 5; ++round)
    for (Block& line : lines) line.least = std::min(line.least, line.round());
  for (const Block& line : lines) fmt::print("{:58} {:10.0f}\n", line.what, line.least);
  for (const std::string& absent : lab::absent_peers()) fmt::print("absent: {}\n", absent);
}
