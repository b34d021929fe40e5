#include "lab/paper.h"

#include <fmt/format.h>

#include <numbers>
#include <utility>

#include "common/base/check.h"
#include "common/base/normal.h"
#include "common/passivity/passivated.h"
#include "common/record/metrics.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {
namespace {

using Eigen::Vector3d;
constexpr double kDegree = 180.0 / std::numbers::pi;

constexpr std::pair<const char*, const char*> kScenes[] = {
#include "lab/paper_scenes.inc"
};

using Set = std::vector<std::string>;
const std::vector<std::pair<std::string, Set>>& methods() {
  static const auto all = [] {
    const auto passivity = [](const Set& fields) {
      Set set;
      for (const std::string& field : fields) set.push_back("control.passivity." + field);
      return set;
    };
    // The paper's equations have no bounds; each next line of a pair restores one addition.
    const Set paper = {"reference_energy=false", "predict=false", "unilateral=false"};
    const auto with = [&](Set set, const Set& more) {
      set.insert(set.end(), more.begin(), more.end());
      return passivity(set);
    };
    return std::vector<std::pair<std::string, Set>>{
        {"none", with(paper, {"method=NONE"})},
        {"classic literal", with(paper, {"method=CLASSIC", "max_gain=1e18"})},
        {"projected literal", with(paper, {"method=FORCE_PROJECTED", "max_gain=1e18"})},
        {"projected eq. 2", with(paper, {"method=FORCE_PROJECTED", "max_gain=1e18", "observer=RECTANGLE"})},
        {"classic", with(paper, {"method=CLASSIC"})},
        {"projected no clamp", with(paper, {"method=FORCE_PROJECTED"})},
        {"projected", passivity({"reference_energy=false", "predict=false"})},
        {"projected predict", passivity({"reference_energy=false"})},
        {"classic reference", passivity({"method=CLASSIC"})},
        {"projected reference no prediction", passivity({"predict=false"})},
        {"projected reference", {}},
        {"projected reference uncapped", passivity({"max_gain=1e18"})},
        {"projected reference total", passivity({"accounts=TOTAL"})},
    };
  }();
  return all;
}

Set look_up(const std::vector<std::pair<std::string, Set>>& all, const char* what, const std::string& name) {
  std::vector<std::string> known;
  for (const auto& [each, set] : all) {
    if (each == name) return set;
    known.push_back(each);
  }
  throw ConfigError{fmt::format("{} is {}; it must be one of {}", what, name, fmt::join(known, ", "))};
}

Set hand(const std::string& name) {
  const auto of = [](const char* mass, const char* damping, const char* stiffness) {
    const std::string path = "operator.hand.";
    return Set{path + "mass_kg=" + mass, path + "damping_n_s_per_m=" + damping,
               path + "stiffness_n_per_m=" + stiffness};
  };
  return look_up({{"light", {}}, {"medium", of("0.02", "1", "500")}, {"firm", of("0.05", "3", "800")}}, "hand", name);
}

Set sensor(const std::string& name) {
  return look_up({{"ideal", {}},
                  {"encoder",
                   {"device.position_resolution_m=30e-6", "device.velocity_estimate=FILTERED",
                    "device.velocity_filter_hz=150", "device.coulomb_friction_n=0.04"}}},
                 "sensor", name);
}

/// The first word names the scene.
Set arrival(const std::string& experiment) {
  const std::size_t space = experiment.find(' ');
  if (space == experiment.npos) return {};
  return look_up({{"gentle", {"operator.path[0].move_to.duration_s=0.3"}},
                  {"impact", {"operator.path[0].move_to.duration_s=0.1", "device.position_m=[0.00866, 0.005, 0]"}}},
                 "arrival", experiment.substr(space + 1));
}

const char* scene_text(const std::string& name) {
  for (const auto& [each, text] : kScenes)
    if (each == name) return text;
  throw ConfigError{fmt::format("no scene of the paper has the name {}", name)};
}

Surface only_surface(const Scene& scene) {
  return World{scene.environment}.surfaces.at(0);
}

template <class Visit>
void run(const Scene& scene, Visit visit) {
  make_simulation<3>(scene)->run([&](const Row<3>& row) {
    visit(row);
    return row.master_x.finite();
  });
}

}  // namespace

Scene paper_scene(const PaperCase& which, std::uint64_t seed) {
  const std::string name = which.experiment.substr(0, which.experiment.find(' '));
  Scene scene = parse_scene(scene_text(name), fmt::format("scenes/paper/{}.textproto", name), which.set);
  scene.seed = seed;
  return scene;
}

PaperCase paper_case(const std::string& experiment, const std::string& of_hand, const std::string& of_sensor,
                     const std::string& method) {
  PaperCase c{experiment, of_hand, of_sensor, method, arrival(experiment)};
  for (const Set& more : {hand(of_hand), sensor(of_sensor), look_up(methods(), "method", method)})
    c.set.insert(c.set.end(), more.begin(), more.end());
  return c;
}

std::vector<PaperCase> paper_cases() {
  std::vector<PaperCase> all;
  for (const char* experiment : {"point", "slide", "curved"})
    for (const char* of_sensor : {"ideal", "encoder"})
      for (const auto& [method, set] : methods())
        if (method != "projected reference total") all.push_back(paper_case(experiment, "light", of_sensor, method));
  for (const char* of_hand : {"medium", "firm"})
    for (const char* method : {"none", "classic", "projected", "projected reference"})
      all.push_back(paper_case("slide", of_hand, "ideal", method));
  for (const char* experiment : {"slide gentle", "slide impact"})
    for (const char* of_sensor : {"ideal", "encoder"})
      for (const char* method : {"none", "classic", "projected no clamp", "projected", "projected reference"})
        all.push_back(paper_case(experiment, "light", of_sensor, method));
  for (const char* of_sensor : {"ideal", "encoder"})
    for (const char* method : {"none", "classic", "projected reference total", "projected reference"})
      all.push_back(paper_case("friction", "light", of_sensor, method));
  return all;
}

void PaperNumbers::add(const PaperNumbers& o) {
  const double mine = seeds, others = o.seeds, all = mine + others;
  const auto mean = [&](double a, double b) { return (mine * a + others * b) / all; };
  min_energy_j = std::min(min_energy_j, o.min_energy_j);
  min_surplus_j = std::min(min_surplus_j, o.min_surplus_j);
  min_normal_energy_j = std::min(min_normal_energy_j, o.min_normal_energy_j);
  for (std::size_t i = 0; i < 3; ++i) {
    axis_energy_j[i] = mean(axis_energy_j[i], o.axis_energy_j[i]);
    axis_energy_at_1s_j[i] = mean(axis_energy_at_1s_j[i], o.axis_energy_at_1s_j[i]);
  }
  energy_j = mean(energy_j, o.energy_j);
  direction_deg.add(o.direction_deg);
  normal_direction_deg.add(o.normal_direction_deg);
  tip_n.add(o.tip_n);
  mean_correction_n = mean(mean_correction_n, o.mean_correction_n);
  max_correction_n = std::max(max_correction_n, o.max_correction_n);
  max_gain_n_s_per_m = std::max(max_gain_n_s_per_m, o.max_gain_n_s_per_m);
  speed_m_per_s.add(o.speed_m_per_s);
  max_depth_m = std::max(max_depth_m, o.max_depth_m);
  ticks += o.ticks;
  contact_ticks += o.contact_ticks;
  pulling_ticks += o.pulling_ticks;
  saturated_ticks += o.saturated_ticks;
  free_air_ticks += o.free_air_ticks;
  seeds += o.seeds;
}

PaperMeter::PaperMeter(const Scene& scene)
    : surface_{only_surface(scene)},
      limit_n_{scene.device && scene.device->max_force_n ? *scene.device->max_force_n
                                                         : std::numeric_limits<double>::infinity()} {
  numbers_.seeds = 1;
}

void PaperMeter::add(const Row<3>& row) {
  PaperNumbers& n = numbers_;
  const Vector3d &x = row.master_x.translation(), &v = row.master_v.vec(), &f = row.master_f.vec(),
                 &wanted = row.master_f_wanted.vec();
  const SignedDistance<3> at = signed_distance<3>(surface_.shape, x);
  if (started_) {
    const Vector3d moved = x - x_;
    axis_energy_ += f_.cwiseProduct(moved);
    normal_energy_ += f_.dot(normal_) * moved.dot(normal_);
  }
  started_ = true;
  x_ = x;
  f_ = f;
  normal_ = at.normal;
  n.min_energy_j = std::min(n.min_energy_j, row.master_energy_j);
  n.min_surplus_j = std::min(n.min_surplus_j, row.master_energy_j - surface_.potential<3>(x));
  n.min_normal_energy_j = std::min(n.min_normal_energy_j, normal_energy_);
  n.energy_j = row.master_energy_j;
  for (int i = 0; i < 3; ++i) {
    n.axis_energy_j[static_cast<std::size_t>(i)] = axis_energy_[i];
    if (row.t_s <= 1.0) n.axis_energy_at_1s_j[static_cast<std::size_t>(i)] = axis_energy_[i];
  }
  const Vector3d correction = f - wanted;
  const double size = correction.norm(), power = correction.dot(v);
  n.max_correction_n = std::max(n.max_correction_n, size);
  const bool saturated = f.norm() > limit_n_ * (1.0 - 1e-9);
  if (power > 0.0 && size > 1e-6 && !saturated)
    n.max_gain_n_s_per_m = std::max(n.max_gain_n_s_per_m, size * size / power);
  if (row.t_s < PaperNumbers::kFrom_s) return;

  ++n.ticks;
  n.speed_m_per_s.add(v.norm());
  n.max_depth_m = std::max(n.max_depth_m, -at.distance);
  if (wanted.squaredNorm() == 0.0) {
    if (size > 0.0) ++n.free_air_ticks;
    return;
  }
  ++n.contact_ticks;
  sum_correction_ += size;
  n.mean_correction_n = sum_correction_ / static_cast<double>(n.contact_ticks);
  if (f.dot(wanted) < 0.0) ++n.pulling_ticks;
  if (saturated) ++n.saturated_ticks;
  n.tip_n.add((f - f.dot(wanted) / wanted.squaredNorm() * wanted).norm());
  if (f.norm() <= PaperNumbers::kFelt) return;
  if (wanted.norm() > PaperNumbers::kFelt) n.direction_deg.add(kDegree * angle(f, wanted));
  n.normal_direction_deg.add(kDegree * angle(f, Vector3d{-at.normal}));
}

PaperNumbers measure(const PaperCase& which, int seeds) {
  PaperNumbers all;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Scene scene = paper_scene(which, static_cast<std::uint64_t>(seed));
    PaperMeter meter{scene};
    run(scene, [&](const Row<3>& row) { meter.add(row); });
    all.add(meter.numbers());
  }
  return all;
}

std::vector<Row<3>> record(const PaperCase& which, std::uint64_t seed) {
  std::vector<Row<3>> rows;
  run(paper_scene(which, seed), [&](const Row<3>& row) { rows.push_back(row); });
  return rows;
}

// ---- the other causality
namespace {

/// A mass in admittance causality: driven by the mean force of the interval that has ended, it answers the velocity to
/// hold in the next.
class VirtualMass {
 public:
  using In = Force<3>;
  using Out = Velocity<3>;
  explicit VirtualMass(double mass_kg) : mass_kg_{mass_kg} {}
  Out step(const In& mean_force, Seconds dt) noexcept {
    momentum_ += mean_force.vec() * dt.si();
    return last_ = Out{momentum_ / mass_kg_};
  }
  [[nodiscard]] const Out& last() const { return last_; }

 private:
  double mass_kg_;
  Vector3d momentum_ = Vector3d::Zero();
  Out last_;
};

AdmittanceRun admittance_run(const std::string& name, const ControllerOptions& options) {
  // A firm grip, so that the loop is the wall's dual in numbers too: unstable below b = k T/2 = 1.25 N s/m.
  constexpr double kMass = 0.085, kStiffness = 5000.0, kDamping = 0.5, kEnd_s = 4.0, kTooFast = 5.0;
  const Seconds dt{1.0 / 2000.0};
  const Vector3d along{-0.5, 0.5 * std::numbers::sqrt3, 0.0};
  Passivated<VirtualMass> tool{VirtualMass{kMass}, options};
  const auto intended = [&](double t) -> Vector3d { return 0.05 * std::sin(std::numbers::pi * t) * along; };

  AdmittanceRun run;
  run.method = name;
  Vector3d x = Vector3d::Zero();
  Force<3> mean_force;
  double energy = 0.0;
  for (int k = 0; k * dt.si() < kEnd_s; ++k) {
    const Velocity<3> v = tool.step(mean_force, dt);
    // While v is held the hand's force is linear in time: its mean is exact, and so is the energy.
    const Vector3d from = intended(k * dt.si()), to = intended((k + 1) * dt.si());
    const Vector3d next = x + v.vec() * dt.si();
    mean_force = Force<3>{kStiffness * 0.5 * (from + to - x - next) + kDamping * ((to - from) / dt.si() - v.vec())};
    energy += (dot(mean_force, v) * dt).si();
    x = next;
    run.min_energy_j = std::min(run.min_energy_j, energy);
    run.most_speed_m_per_s = std::max(run.most_speed_m_per_s, v.vec().norm());
    const Vector3d asked = tool.element().last().vec();
    run.correction_m_per_s.add((v.vec() - asked).norm());
    if (asked.norm() > 0.01 && v.vec().norm() > 0.01) run.direction_deg.add(kDegree * angle(v.vec(), asked));
    if (v.vec().norm() > kTooFast) {
      run.stopped_at_s = k * dt.si();
      break;
    }
  }
  return run;
}

}  // namespace

std::vector<AdmittanceRun> admittance_runs() {
  constexpr double kLeak = 0.5 / 2000.0 / 0.085;  // T/(2m), the dual of K T/2
  const auto options = [](Method method) {
    return ControllerOptions{.method = method, .max_gain = 4.0 * kLeak, .unilateral = true, .predict = true};
  };
  return {admittance_run("none", options(Method::none)), admittance_run("classic", options(Method::classic)),
          admittance_run("projected", options(Method::force_projected))};
}

// ---- frames
namespace {

/// The i-th of uniformly distributed attitudes.
Eigen::Quaterniond random_turn(const Random& random, std::uint64_t i) {
  return Eigen::Quaterniond{normal(random, i, 0), normal(random, i, 1), normal(random, i, 2), normal(random, i, 3)}
      .normalized();
}

void turn(Numbers& n, const Eigen::Quaterniond& q) {
  const Vector3d v = q * vector<3>(n);
  n = {v.x(), v.y(), v.z()};
}

Scene turned(Scene scene, const Eigen::Quaterniond& q) {
  turn(scene.device->position_m, q);
  for (SegmentSpec& segment : scene.operator_model->path) {
    if (auto* move = std::get_if<MoveToSpec>(&segment)) turn(move->position_m, q);
    if (auto* screw = std::get_if<ScrewSpec>(&segment)) turn(screw->point_m, q), turn(screw->axis, q);
  }
  for (EnvironmentSpec& e : scene.environment)
    if (auto* surface = std::get_if<Surface>(&e))
      if (auto* wall = std::get_if<Wall>(&surface->shape)) wall->normal = q * wall->normal;
  return scene;
}

}  // namespace

std::vector<FrameCheck> frame_checks() {
  std::vector<FrameCheck> all;
  const Random random{1};
  std::uint64_t turns = 0;
  for (const char* method : {"none", "classic", "projected", "projected reference"}) {
    // Without tremor, which depends on the axes.
    PaperCase which = paper_case("slide", "light", "ideal", method);
    which.set.push_back("operator.tremor.rms_m=0");
    const Scene scene = paper_scene(which, 1);
    FrameCheck check;
    check.method = method;

    // The same motion, observed and controlled in a new frame at each tick.
    const std::vector<Row<3>> rows = record(which, 1);
    const Seconds dt{1.0 / scene.rate_hz};
    const Surface surface = only_surface(scene);
    double energy[2] = {0.0, 0.0}, most_energy = 0.0, most_force = 0.0;
    Vector3d held = Vector3d::Zero();
    for (std::size_t k = 1; k < rows.size(); ++k) {
      const Vector3d x = rows[k].master_x.translation(), moved = x - rows[k - 1].master_x.translation();
      const Vector3d &wanted = rows[k].master_f_wanted.vec(), &v = rows[k].master_v.vec();
      const Eigen::Quaterniond q[2] = {Eigen::Quaterniond::Identity(), random_turn(random, turns++)};
      Vector3d out[2];
      for (int i = 0; i < 2; ++i) {
        energy[i] += (q[i] * held).dot(q[i] * moved);
        const double u = scene.control.reference_energy ? surface.potential<3>(x) : 0.0,
                     next = scene.control.reference_energy ? surface.potential<3>(x + v * dt.si()) : 0.0;
        const auto part =
            passivity_controller(Force<3>{q[i] * wanted}, Velocity<3>{q[i] * v},
                                 Budget{Energy{energy[i] - u}, Energy{next - u}}, scene.control.controller, dt);
        out[i] = q[i].conjugate() * part.out.vec();
      }
      held = out[0];
      most_energy = std::max(most_energy, std::abs(energy[0]));
      check.energy_per_tick_frames = std::max(check.energy_per_tick_frames, std::abs(energy[1] - energy[0]));
      most_force = std::max(most_force, out[0].norm());
      check.force_per_tick_frames = std::max(check.force_per_tick_frames, (out[1] - out[0]).norm());
    }
    check.energy_per_tick_frames /= most_energy;
    check.force_per_tick_frames /= most_force;

    const Eigen::Quaterniond q = random_turn(random, turns++);
    std::vector<Row<3>> there;
    run(turned(scene, q), [&](const Row<3>& row) { there.push_back(row); });
    for (std::size_t k = 0; k < rows.size(); ++k) {
      check.energy_turned_world =
          std::max(check.energy_turned_world, std::abs(there[k].master_energy_j - rows[k].master_energy_j));
      check.path_turned_world_m =
          std::max(check.path_turned_world_m,
                   (q.conjugate() * there[k].master_x.translation() - rows[k].master_x.translation()).norm());
    }
    all.push_back(check);
  }
  return all;
}

}  // namespace twoport::lab
