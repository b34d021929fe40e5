#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "common/base/vector.h"
#include "common/scene/scene.h"
#include "lab/study/chart.h"

namespace twoport::lab {

/// One rigid body in another engine's world, and a half space for contact.
struct EngineBody {
  int dof;  ///< 1: along x, a ball that touches at its front; 3, 6: a box, which a point mass does not turn
  double mass_kg, inertia_kg_m2, period_s;
  Position<6> x;
  Velocity<6> v;
  Eigen::Vector3d half_size_m;  ///< of the box
  // The engine's own contact; without it all forces are pushed.
  bool own_contact;
  Eigen::Vector3d normal;
  double offset_m, stiffness_n_per_m, damping_n_s_per_m, friction;
};

/// Front of the ball in 1 DoF, which is the body's position [m]: its centre is one radius behind.
inline constexpr double kBallRadius = 0.01;

class Engine {
 public:
  virtual ~Engine() = default;
  // dof 1
  [[nodiscard]] virtual double position() const = 0;
  [[nodiscard]] virtual double velocity() const = 0;
  virtual void push(double force_n) = 0;
  // dof 6
  [[nodiscard]] virtual Position<6> pose() const = 0;
  [[nodiscard]] virtual Velocity<6> twist() const = 0;
  virtual void push(const Force<6>& wrench) = 0;

  virtual void step() = 0;
};

// Each is null if its library was missing at build time.
std::unique_ptr<Engine> ode(const EngineBody& body);
std::unique_ptr<Engine> bullet(const EngineBody& body);
std::unique_ptr<Engine> mujoco(const EngineBody& body);

/// A scene computed by other engines: a robot alone on one wall and springs, with one degree of freedom, or with six a
/// box with contacts at its corners. Each engine twice: pushed by all forces of the environment at its state, once per
/// step; and with its own contact for the wall. A point mass in three degrees of freedom, or with another shape than a
/// wall: pushed only. Empty for other scenes.
std::vector<Peer> peers_for(const Scene& scene);

/// Engines that were missing at build time, with Debian's package names.
std::vector<std::string> absent_peers();

}  // namespace twoport::lab
