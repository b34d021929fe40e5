#include "lab/peers/peers.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <variant>

#include "common/contact/environment.h"
#include "common/record/run_judge.h"
#include "lab/engine/tail_judge.h"
#include "lab/mechanical_energy.h"
#include "lab/run.h"

namespace twoport::lab {
namespace {

using Make = std::unique_ptr<Engine> (*)(const EngineBody&);
struct Library {
  const char *name, *package;
  Make make;
};
constexpr Library kLibraries[] = {
#ifdef TWOPORT_ODE
    {"ODE", "libode-dev", ode},
#else
    {"ODE", "libode-dev", nullptr},
#endif
#ifdef TWOPORT_BULLET
    {"Bullet", "libbullet-dev", bullet},
#else
    {"Bullet", "libbullet-dev", nullptr},
#endif
#ifdef TWOPORT_MUJOCO
    {"MuJoCo", "libmujoco-dev", mujoco},
#else
    {"MuJoCo", "libmujoco-dev", nullptr},
#endif
};

/// The body of a scene and the forces on it, all or all except the wall's.
struct Setting {
  EngineBody body;
  Scene pushing;
  double rate_hz;
  int ticks;
  double stiffness_n_per_m = 0.0, damping_n_s_per_m = 0.0, pull_n = 0.0;  ///< dof 1: of all springs

  /// Force in one degree of freedom, hand-written: an engine's time does not include our environment code.
  [[nodiscard]] double push(double x, double v) const {
    double f = pull_n - stiffness_n_per_m * x - damping_n_s_per_m * v;
    if (const double depth = body.offset_m + x; !body.own_contact && depth > 0.0)
      f -= std::max(0.0, body.stiffness_n_per_m * depth + body.damping_n_s_per_m * v);
    return f;
  }
};

std::optional<Setting> setting(const Scene& scene, bool own_contact) {
  if (scene.control.architecture != Architecture::uncontrolled) return {};
  const World world{scene.environment};
  if (world.surfaces.size() != 1) return {};
  const bool walled = std::holds_alternative<Wall>(world.surfaces[0].shape);
  if (!walled && own_contact) return {};
  const Wall wall = walled ? std::get<Wall>(world.surfaces[0].shape) : Wall{Eigen::Vector3d::UnitX(), 0.0};
  const Material& material = world.surfaces[0].material;
  const RobotSpec& robot = *scene.robot;
  if (robot.damping_n_s_per_m > 0.0 || (scene.dof == 3 && own_contact)) return {};
  if (scene.dof == 1 && (!walled || wall.normal[0] > 0.0)) return {};  // the ball's front is on the other side
  Setting s{.body = {.dof = scene.dof,
                     .mass_kg = robot.mass_kg,
                     .inertia_kg_m2 = scene.dof == 6 ? robot.inertia_kg_m2[0] : 1.0,
                     .period_s = 1.0 / scene.slave_rate_hz,
                     .x = {},
                     .v = {},
                     .half_size_m = Eigen::Vector3d::Zero(),
                     .own_contact = own_contact,
                     .normal = Eigen::Vector3d::UnitX() * -1.0,
                     .offset_m = wall.offset_m,
                     .stiffness_n_per_m = material.stiffness_n_per_m,
                     .damping_n_s_per_m = material.damping_n_s_per_m,
                     .friction = material.friction},
            .pushing = scene,
            .rate_hz = scene.slave_rate_hz,
            .ticks = static_cast<int>(std::lround(scene.duration_s * scene.slave_rate_hz))};
  Velocity<6>::Vector v = Velocity<6>::Vector::Zero();
  for (std::size_t i = 0; i < robot.velocity_m_per_s.size(); ++i) v[static_cast<int>(i)] = robot.velocity_m_per_s[i];
  s.body.v = Velocity<6>{v};
  if (scene.dof == 3) {
    if (!robot.position_m.empty())
      s.body.x = {position<3>(robot.position_m).translation(), Eigen::Quaterniond::Identity()};
    s.body.half_size_m.setConstant(kBallRadius);
  } else if (scene.dof == 6) {
    s.body.x = position<6>(robot.position_m);
    s.body.normal = wall.normal;
    for (const Eigen::Vector3d& p : scene.tool) s.body.half_size_m = s.body.half_size_m.cwiseMax(p.cwiseAbs());
  } else {
    s.body.x = {{robot.position_m.empty() ? 0.0 : robot.position_m[0], 0, 0}, Eigen::Quaterniond::Identity()};
  }
  if (scene.dof == 1)
    for (const Spring& spring : world.springs) {
      s.stiffness_n_per_m += spring.stiffness_n_per_m;
      s.damping_n_s_per_m += spring.damping_n_s_per_m;
      s.pull_n += spring.stiffness_n_per_m * spring.anchor_m[0];
    }
  if (own_contact)
    std::erase_if(s.pushing.environment, [](const EnvironmentSpec& e) { return std::holds_alternative<Surface>(e); });
  return s;
}

/// Steps an engine through ticks of a scene. `at(tick)` is called before each step.
template <class At>
void play(Engine& engine, const Setting& s, int from, int until, const At& at) {
  if (s.body.dof == 1) {
    for (int k = from; k < until; ++k) {
      at(k);
      engine.push(s.push(engine.position(), engine.velocity()));
      engine.step();
    }
  } else if (s.body.dof == 3) {
    const Environment<3> pushing{s.pushing.environment};
    for (int k = from; k < until; ++k) {
      at(k);
      Force<6>::Vector f = Force<6>::Vector::Zero();
      f.head<3>() = pushing
                        .force(Position<3>{engine.pose().translation()},
                               Velocity<3>{Velocity<3>::Vector{engine.twist().vec().head<3>()}})
                        .vec();
      engine.push(Force<6>{f});
      engine.step();
    }
  } else {
    const Environment<6> pushing{s.pushing.environment, s.pushing.tool};
    const double rotational = s.pushing.robot->rotational_damping_n_m_s_per_rad;
    for (int k = from; k < until; ++k) {
      at(k);
      const Velocity<6> v = engine.twist();
      Force<6>::Vector f = pushing.force(engine.pose(), v).vec();
      f.tail<3>() -= rotational * v.vec().tail<3>();
      engine.push(Force<6>{f});
      engine.step();
    }
  }
}

/// The same with a row of each tick, and the energy held [J]: env_f is that of the scene's contact law at the engine's position.
template <int N, class Look>
void play_rows(Engine& engine, const Setting& s, const Scene& scene, int from, int until, const Look& look) {
  const Environment<N> environment{scene.environment, scene.tool};
  play(engine, s, from, until, [&](int k) {
    Row<N> row;
    row.t_s = to_seconds(tick_time(k, s.rate_hz)).si();
    if constexpr (N == 1) {
      row.slave_x = Position<1>{Position<1>::Vector{engine.position()}};
      row.slave_v = Velocity<1>{Velocity<1>::Vector{engine.velocity()}};
    } else if constexpr (N == 3) {
      row.slave_x = Position<3>{engine.pose().translation()};
      row.slave_v = Velocity<3>{Velocity<3>::Vector{engine.twist().vec().template head<3>()}};
    } else {
      row.slave_x = engine.pose();
      row.slave_v = engine.twist();
    }
    row.env_f = environment.force(row.slave_x, row.slave_v);
    look(row, mechanical_energy(scene.robot, environment, row.slave_x, row.slave_v).si());
  });
}

Course course(Engine& engine, const Setting& s, const Scene& scene) {
  Course c;
  for_cartesian_dof(scene.dof, "peers", [&]<int N>() {
    play_rows<N>(engine, s, scene, 0, s.ticks, [&](const Row<N>& row, double energy_j) {
      c.t_s.push_back(row.t_s);
      for (int i = 0; i < 3; ++i) {
        c.slave_x.push_back(i < row.slave_x.translation().size() ? row.slave_x.translation()[i] : 0.0);
        c.force.push_back(i < N ? row.env_f.vec()[i] : 0.0);
      }
      c.energy_j.push_back(energy_j);
    });
  });
  c.master_x.assign(c.slave_x.size(), 0.0);
  c.felt = c.force;
  return c;
}

/// Goes on after the scene's end where our runs do, and is judged as they are.
std::string verdict(Engine& engine, const Setting& s, const Scene& scene, VerdictFrom from) {
  return for_cartesian_dof(scene.dof, "peers", [&]<int N>() {
    RunJudge<N> run{{.rate_hz = s.rate_hz,
                     .duration_s = scene.duration_s,
                     .quiet_from_s = 0.0,
                     .coarse = is_coarse(scene),
                     .trends = from == VerdictFrom::plain}};
    play_rows<N>(engine, s, scene, 0, s.ticks, [&](const Row<N>& row, double) { run.add(row); });
    if (from == VerdictFrom::plain || run.diverged()) return std::string{to_string(run.verdict().kind)};
    const MotionScale scale = run.scale();
    TailJudge<N> tail{scene, scale, Energy{0.0}, false};
    int ticks = 0;
    do {
      const int until = static_cast<int>(tail.stage_ends());
      play_rows<N>(engine, s, scene, s.ticks + ticks, s.ticks + until, [&](const Row<N>& row, double held_j) {
        const typename TailJudge<N>::Tick tick{.v = RunJudge<N>::velocities(row),
                                               .energies = {held_j, held_j, 0.0, 0.0},
                                               .events = RunJudge<N>::events(row)};
        if (!tail.diverged() && tail.see(tick)) tail.add(tick);
      });
      ticks = until;
    } while (!tail.decide());
    return std::string{to_string(tail.verdict().kind)};
  });
}

}  // namespace

std::vector<Peer> peers_for(const Scene& scene) {
  std::vector<Peer> all;
  for (const Library& library : kLibraries)
    for (const bool own_contact : {false, true}) {
      if (library.make == nullptr) continue;
      const std::optional<Setting> s = setting(scene, own_contact);
      if (!s) continue;
      all.push_back({.name = std::string{library.name} + (own_contact ? ", its own contact" : ", pushed"),
                     .course = [s, scene, make = library.make] { return course(*make(s->body), *s, scene); },
                     .seconds =
                         [s, make = library.make] {
                           const auto engine = make(s->body);
                           const auto start = std::chrono::steady_clock::now();
                           play(*engine, *s, 0, s->ticks, [](int) {});
                           return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
                         },
                     .verdict = [s, scene, make = library.make](
                                    VerdictFrom from) { return verdict(*make(s->body), *s, scene, from); }});
    }
  return all;
}

std::vector<std::string> absent_peers() {
  std::vector<std::string> all;
  for (const Library& library : kLibraries)
    if (library.make == nullptr) all.push_back(std::string{library.name} + " (" + library.package + ")");
  return all;
}

}  // namespace twoport::lab
