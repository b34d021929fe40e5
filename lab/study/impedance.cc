#include "lab/study/impedance.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>

#include "common/base/check.h"
#include "common/contact/environment.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {
namespace {

using Complex = std::complex<double>;
constexpr double kApproach = 1.0, kSettle = 1.0;  // [s]
constexpr double kFitHz = 10.0;
constexpr double kTurn = 2.0 * std::numbers::pi;

template <int N>
using Direction = Point<kAxes<N>>;

/// Where and along what the handle is perturbed.
template <int N>
struct Place {
  Direction<N> at, along;
  double amplitude_m;
  MassDamperSpring truth;
};

/// A row of the run that looks for a place.
template <int N>
struct Seen {
  Direction<N> master, robot, environment;  ///< positions; the environment's force
  double force;
  bool touching;
};

template <int N>
std::vector<Seen<N>> look(const Scene& scene) {
  std::vector<Seen<N>> rows;
  const bool rendered = scene.control.architecture == Architecture::render;
  make_simulation<N>(scene)->run([&](const Row<N>& row) {
    const Direction<N> f = row.env_f.vec().template head<kAxes<N>>();
    if (!std::isfinite(f.norm()) || row.master_x.translation().norm() > 100.0) return false;
    rows.push_back({row.master_x.translation(), rendered ? row.master_x.translation() : row.slave_x.translation(), f,
                    f.norm(), row.touching});
    return true;
  });
  return rows;
}

/// Slopes of the environment's force against position and velocity, along `n`, at `x`.
template <int N>
MassDamperSpring slopes(const Environment<N>& environment, const Direction<N>& x, const Direction<N>& n) {
  constexpr double kStep = 1e-6;  // [m], [m/s]
  const auto force = [&](double dx, double dv) {
    const Direction<N> at = x + dx * n;
    typename Velocity<N>::Vector v = Velocity<N>::Vector::Zero();
    v.template head<kAxes<N>>() = dv * n;
    if constexpr (N == 6) {
      return n.dot(
          environment.force(Position<6>{at, Eigen::Quaterniond::Identity()}, Velocity<6>{v}).vec().template head<3>());
    } else {
      return n.dot(environment.force(Position<N>{at}, Velocity<N>{v}).vec());
    }
  };
  return {.damping_n_s_per_m = (force(0, -kStep) - force(0, kStep)) / (2.0 * kStep),
          .stiffness_n_per_m = (force(-kStep, 0) - force(kStep, 0)) / (2.0 * kStep)};
}

MassDamperSpring scaled(const MassDamperSpring& z, double by) {
  return {by * z.mass_kg, by * z.damping_n_s_per_m, by * z.stiffness_n_per_m};
}

/// The robot's axis in the master's world.
template <int N>
Direction<N> in_masters_axes(const Scene& scene, const Direction<N>& n) {
  if constexpr (N == 1) {
    return n;
  } else {
    return scene.control.registration.rotation.normalized().conjugate() * n;
  }
}

template <int N>
std::vector<std::pair<std::string, Place<N>>> places(const Scene& scene, double amplitude_m) {
  const std::vector<Seen<N>> rows = look<N>(scene);
  const bool rendered = scene.control.architecture == Architecture::render;
  const double scale = rendered ? 1.0 : scene.control.force_scale * scene.control.motion_scale;
  MassDamperSpring robot;
  if (!rendered && scene.robot) robot = {scene.robot->mass_kg, scene.robot->damping_n_s_per_m, 0.0};
  const Environment<N> environment{scene.environment, scene.tool};

  // The contact: a moment at which the robot presses as it does half of the time.
  std::vector<const Seen<N>*> touching;
  for (const auto& row : rows)
    if (row.touching && (row.force > 0.0 || environment.holds())) touching.push_back(&row);
  std::vector<std::pair<std::string, Place<N>>> all;
  Direction<N> along = Direction<N>::Unit(0);
  double first_touch = std::numeric_limits<double>::infinity();
  std::optional<Place<N>> contact;
  if (!touching.empty()) {
    auto middle = touching.begin() + static_cast<std::ptrdiff_t>(touching.size() / 2);
    const Seen<N>& first = *touching.front();
    std::nth_element(touching.begin(), middle, touching.end(),
                     [](const auto* a, const auto* b) { return a->force < b->force; });
    const Seen<N>& typical = **middle;
    Direction<N> n = Direction<N>::Unit(0);  // the robot's axis, into the environment
    if (typical.force > 0.0) n = -typical.environment / typical.force;
    along = in_masters_axes<N>(scene, n);
    MassDamperSpring truth = slopes<N>(environment, typical.robot, n);
    truth.mass_kg = robot.mass_kg;
    truth.damping_n_s_per_m += robot.damping_n_s_per_m;
    double amplitude = amplitude_m;
    if (!environment.holds()) {
      first_touch = along.dot(first.master);
      amplitude = std::min(amplitude, std::abs(along.dot(typical.master) - first_touch) / 3.0);
    }
    contact = Place<N>{typical.master, along, amplitude, scaled(truth, scale)};
  }
  // Free space: where the hand is farthest from there.
  const Seen<N>* away = nullptr;
  for (const auto& row : rows)
    if (!row.touching && (away == nullptr || along.dot(row.master) < along.dot(away->master))) away = &row;
  if (away != nullptr)
    all.emplace_back(
        "free space",
        Place<N>{away->master, along, std::min(amplitude_m, std::abs(first_touch - along.dot(away->master)) / 2.0),
                 scaled(robot, scale)});
  if (contact) all.emplace_back("contact", *contact);
  return all;
}

/// Odd multiples of low_hz, as evenly spaced in ratio as they get.
std::vector<int> odd_lines(const ImpedanceOptions& o, double rate_hz) {
  const double most = std::min(o.high_hz, 0.1 * rate_hz) / o.low_hz;
  std::vector<int> odd;
  for (int i = 0; i < o.lines; ++i) {
    const double wanted = std::pow(most, i / std::max(1.0, o.lines - 1.0));
    const int line = 2 * static_cast<int>(wanted / 2.0) + 1;
    if (odd.empty() || line > odd.back()) odd.push_back(line);
  }
  return odd;
}

/// Constant speed amplitude, Schroeder's phases, largest excursion `amplitude_m`.
std::vector<MultiSineSpec::Wave> waves(const std::vector<int>& lines, double base_hz, double amplitude_m) {
  std::vector<MultiSineSpec::Wave> all;
  const double n = static_cast<double>(lines.size());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const double k = static_cast<double>(i);
    all.push_back({1.0 / lines[i], base_hz * lines[i], -std::numbers::pi * k * (k + 1.0) / n});
  }
  double largest = 0.0;
  for (int i = 0; i < 4096; ++i) {
    double x = 0.0;
    for (const auto& w : all)
      x += w.amplitude_m *
           (std::sin(kTurn * w.frequency_hz / base_hz * i / 4096.0 + w.phase_rad) - std::sin(w.phase_rad));
    largest = std::max(largest, std::abs(x));
  }
  for (auto& w : all) w.amplitude_m *= amplitude_m / largest;
  return all;
}

double sinc(double x) {
  return x == 0.0 ? 1.0 : std::sin(x) / x;
}
Complex dynamic_stiffness(const MassDamperSpring& z, double omega) {
  return {z.stiffness_n_per_m - z.mass_kg * omega * omega, z.damping_n_s_per_m * omega};
}

/// Least squares of relative errors: real and imaginary part know nothing of each other.
MassDamperSpring fit(const std::vector<ImpedanceLine>& lines) {
  Eigen::Matrix2d a = Eigen::Matrix2d::Zero();
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  double ww = 0.0, wi = 0.0;
  for (const ImpedanceLine& line : lines) {
    const double size2 = line.displayed_re * line.displayed_re + line.displayed_im * line.displayed_im;
    if (line.frequency_hz > kFitHz || size2 == 0.0) continue;
    const double omega = kTurn * line.frequency_hz, w = 1.0 / size2;
    const Eigen::Vector2d row{1.0, -omega * omega};
    a += w * row * row.transpose();
    b += w * line.displayed_re * row;
    ww += w * omega * omega;
    wi += w * omega * line.displayed_im;
  }
  if (ww == 0.0) return {};
  // Scaled: k and m differ by ω².
  const double unit = std::sqrt(a(1, 1) / a(0, 0));
  Eigen::Matrix2d s = a;
  s(0, 1) /= unit, s(1, 0) /= unit, s(1, 1) /= unit * unit;
  const Eigen::Vector2d x = s.ldlt().solve(Eigen::Vector2d{b[0], b[1] / unit});
  return {.mass_kg = x[1] / unit, .damping_n_s_per_m = wi / ww, .stiffness_n_per_m = x[0]};
}

template <int N>
DisplayedImpedance perturbed(Scene scene, const std::string& name, const Place<N>& place, const ImpedanceOptions& o) {
  const double rate = scene.master_rate_hz, period_s = 1.0 / o.low_hz;
  const auto period = static_cast<std::size_t>(std::lround(period_s * rate));
  const double base_hz = rate / static_cast<double>(period);
  const std::vector<int> lines = odd_lines(o, rate);
  const double shaken_s = (o.periods + 1) * static_cast<double>(period) / rate;
  OperatorSpec hand;
  hand.path.push_back(MoveToSpec{{place.at.data(), place.at.data() + place.at.size()}, kApproach});
  hand.path.push_back(HoldSpec{kSettle});
  hand.path.push_back(MultiSineSpec{{place.along.data(), place.along.data() + place.along.size()},
                                    waves(lines, base_hz, place.amplitude_m),
                                    shaken_s + 1.0});
  scene.operator_model = hand;
  if (scene.device) scene.device->velocity_m_per_s.clear();
  scene.duration_s = kApproach + kSettle + shaken_s;

  // Line by line and period by period.
  const auto from = static_cast<std::size_t>(std::lround((kApproach + kSettle) * rate)) + period;
  const auto periods = static_cast<std::size_t>(o.periods);
  std::vector<Complex> x(lines.size() * periods), f(x.size());
  std::size_t k = 0;
  make_simulation<N>(scene)->run([&](const Row<N>& row) {
    const std::size_t into = k++ - from;
    if (k <= from || into / period >= periods) return true;
    const double dx = place.along.dot(row.master_x.translation() - place.at);
    const double force = place.along.dot(row.master_f.vec().template head<kAxes<N>>());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const double turn = static_cast<double>(into % period) * lines[i] / static_cast<double>(period);
      const Complex e = std::polar(1.0, -kTurn * (turn - std::floor(turn)));
      x[i * periods + into / period] += dx * e;
      f[i * periods + into / period] += force * e;
    }
    return std::isfinite(force);
  });

  DisplayedImpedance out{
      .place = name, .amplitude_m = place.amplitude_m, .displayed = {}, .truth = place.truth, .lines = {}};
  out.least_coherence = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const double omega = kTurn * base_hz * lines[i], half_tick = 0.5 * omega / rate;
    Complex xf;
    double xx = 0.0, ff = 0.0;
    for (std::size_t p = i * periods; p < (i + 1) * periods; ++p) {
      xf += std::conj(x[p]) * f[p];
      xx += std::norm(x[p]);
      ff += std::norm(f[p]);
    }
    const Complex shown = xf / xx * std::polar(sinc(half_tick), -half_tick),
                  truth = dynamic_stiffness(place.truth, omega);
    const double coherence = ff > 0.0 ? std::norm(xf) / (xx * ff) : std::numeric_limits<double>::quiet_NaN();
    out.lines.push_back({base_hz * lines[i], shown.real(), shown.imag(), truth.real(), truth.imag(), coherence});
    if (base_hz * lines[i] <= kFitHz) out.least_coherence = std::fmin(out.least_coherence, coherence);
  }
  out.displayed = fit(out.lines);
  return out;
}

}  // namespace

std::vector<DisplayedImpedance> displayed_impedance(const Scene& scene, const ImpedanceOptions& options) {
  if (scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{scene.name + ": control.architecture is UNCONTROLLED, which has no master port"};
  return dispatch_dof(scene, [&]<int N>() {
    std::vector<DisplayedImpedance> all;
    for (const auto& [name, place] : places<N>(scene, options.amplitude_m))
      all.push_back(perturbed<N>(scene, name, place, options));
    return all;
  });
}

std::string to_csv(const std::vector<DisplayedImpedance>& all) {
  std::string csv =
      "place,frequency_hz,displayed_re_n_per_m,displayed_im_n_per_m,true_re_n_per_m,true_im_n_per_m,coherence\n";
  for (const DisplayedImpedance& each : all)
    for (const ImpedanceLine& l : each.lines)
      csv += fmt::format("{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n", each.place, l.frequency_hz, l.displayed_re,
                         l.displayed_im, l.true_re, l.true_im, l.coherence);
  return csv;
}

std::string to_text(const std::vector<DisplayedImpedance>& all) {
  std::string text = fmt::format("{:<12}{:<18}{:>14}{:>14}\n", "", "", "displayed", "true");
  for (const DisplayedImpedance& z : all) {
    const auto row = [&](const char* what, double MassDamperSpring::*figure) {
      text += fmt::format("{:<12}{:<18}{:>14.4g}{:>14.4g}\n", z.place, what, z.displayed.*figure, z.truth.*figure);
    };
    row("mass [kg]", &MassDamperSpring::mass_kg);
    row("damping [N s/m]", &MassDamperSpring::damping_n_s_per_m);
    row("stiffness [N/m]", &MassDamperSpring::stiffness_n_per_m);
    text += std::isnan(z.least_coherence)
                ? fmt::format("{:<12}no force is displayed\n", z.place)
                : fmt::format("{:<12}{:<18}{:>14.4f}\n", z.place, "least coherence", z.least_coherence);
  }
  return text;
}

}  // namespace twoport::lab
