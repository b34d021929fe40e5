#include "lab/peers/peers.h"

#include <chrono>
#include <cmath>
#include <memory>
#include <variant>

#include "lab/peers/engine.h"
#include "sim/environment.h"

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

/// The body of a scene and what pushes it, all of it or all but the wall.
struct Setting {
  EngineBody body;
  Scene pushing;
  double rate_hz;
  int ticks;
};

std::optional<Setting> setting(const Scene& scene, bool own_contact) {
  if (scene.control.architecture != Architecture::uncontrolled || scene.dof == 3) return {};
  const WallSpec* wall = nullptr;
  for (const EnvironmentSpec& e : scene.environment) {
    if (const auto* w = std::get_if<WallSpec>(&e)) {
      if (wall != nullptr) return {};
      wall = w;
    } else if (!std::holds_alternative<SpringSpec>(e)) {
      return {};
    }
  }
  if (wall == nullptr) return {};
  const RobotSpec& robot = *scene.robot;
  if (robot.damping_n_s_per_m > 0.0) return {};
  if (scene.dof == 1 && wall->normal[0] > 0.0) return {};  // the ball's front is on the other side
  Setting s{.body = {.dof = scene.dof,
                     .mass_kg = robot.mass_kg,
                     .inertia_kg_m2 = scene.dof == 6 ? robot.inertia_kg_m2[0] : 1.0,
                     .period_s = 1.0 / scene.slave_rate_hz,
                     .x = {},
                     .v = {},
                     .half_size_m = Eigen::Vector3d::Zero(),
                     .own_contact = own_contact,
                     .normal = Eigen::Vector3d::UnitX() * -1.0,
                     .offset_m = wall->offset_m,
                     .stiffness_n_per_m = wall->material.stiffness_n_per_m,
                     .damping_n_s_per_m = wall->material.damping_n_s_per_m,
                     .friction = wall->material.friction},
            .pushing = scene,
            .rate_hz = scene.slave_rate_hz,
            .ticks = static_cast<int>(std::lround(scene.duration_s * scene.slave_rate_hz))};
  Velocity<6>::Vector v = Velocity<6>::Vector::Zero();
  for (std::size_t i = 0; i < robot.velocity_m_per_s.size(); ++i) v[static_cast<int>(i)] = robot.velocity_m_per_s[i];
  s.body.v = Velocity<6>{v};
  if (scene.dof == 6) {
    s.body.x = sim::position<6>(robot.position_m);
    s.body.normal = sim::vector<3>(wall->normal);
    for (const Numbers& p : scene.tool) s.body.half_size_m = s.body.half_size_m.cwiseMax(sim::vector<3>(p).cwiseAbs());
  } else {
    s.body.x = {{robot.position_m.empty() ? 0.0 : robot.position_m[0], 0, 0}, Eigen::Quaterniond::Identity()};
  }
  if (own_contact)
    std::erase_if(s.pushing.environment, [](const EnvironmentSpec& e) { return std::holds_alternative<WallSpec>(e); });
  return s;
}

/// Steps an engine through a scene. `at(tick)` is called before each step.
template <class At>
void play(Engine& engine, const Setting& s, const At& at) {
  if (s.body.dof == 1) {
    const sim::Environment<1> pushing{s.pushing};
    for (int k = 0; k < s.ticks; ++k) {
      at(k);
      const Position<1> x{Position<1>::Vector{engine.position()}};
      const Velocity<1> v{Velocity<1>::Vector{engine.velocity()}};
      engine.push(pushing.force(x, v)[0]);
      engine.step();
    }
  } else {
    const sim::Environment<6> pushing{s.pushing};
    const double rotational = s.pushing.robot->rotational_damping_n_m_s_per_rad;
    for (int k = 0; k < s.ticks; ++k) {
      at(k);
      const Velocity<6> v = engine.twist();
      Force<6>::Vector f = pushing.force(engine.pose(), v).vec();
      f.tail<3>() -= rotational * v.vec().tail<3>();
      engine.push(Force<6>{f});
      engine.step();
    }
  }
}

/// Force as the scene's own contact law has it at the engine's position.
Course course(Engine& engine, const Setting& s, const Scene& scene) {
  Course c;
  const auto note = [&](const Eigen::Vector3d& x, const Eigen::Vector3d& f) {
    c.slave_x.insert(c.slave_x.end(), x.data(), x.data() + 3);
    c.force.insert(c.force.end(), f.data(), f.data() + 3);
    c.master_x.insert(c.master_x.end(), 3, 0.0);
    c.energy_j.push_back(0.0);
  };
  const auto each = [&](int k, auto environment) {
    c.t_s.push_back(to_seconds(tick_time(k, s.rate_hz)).si());
    if constexpr (std::is_same_v<decltype(environment), const sim::Environment<1>*>) {
      const Position<1> x{Position<1>::Vector{engine.position()}};
      const double f = environment->force(x, Velocity<1>{Velocity<1>::Vector{engine.velocity()}})[0];
      note({x.translation()[0], 0, 0}, {f, 0, 0});
    } else {
      const Position<6> x = engine.pose();
      note(x.translation(), environment->force(x, engine.twist()).vec().template head<3>());
    }
  };
  if (s.body.dof == 1) {
    const sim::Environment<1> e{scene};
    play(engine, s, [&](int k) { each(k, &e); });
  } else {
    const sim::Environment<6> e{scene};
    play(engine, s, [&](int k) { each(k, &e); });
  }
  return c;
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
                           play(*engine, *s, [](int) {});
                           return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
                         }});
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
