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

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/random.h"
#include "common/contact/environment.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"

namespace twoport::lab {
namespace {

using Complex = std::complex<double>;
constexpr double kApproach = 1.0, kSettle = 1.0;  // [s]
constexpr double kFitHz = 10.0;
constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kLeastShare = 0.01;  // of the amplitude asked for, in a place that is measured
constexpr double kNoForce = 1e-9;     // of the force of all frequencies: below this a line shows none

template <int N>
using Direction = Point<kAxes<N>>;

/// Where and along what the handle is perturbed.
template <int N>
struct Place {
  Direction<N> at, along;
  double amplitude_m;
  MassDamperSpring truth;
  bool free;
};

/// A row of the run that looks for a place.
template <int N>
struct Sample {
  Direction<N> master, robot, environment;  ///< positions; the environment's force
  double force;
  bool touching;
};

template <int N>
std::vector<Sample<N>> look(const Scene& scene) {
  std::vector<Sample<N>> rows;
  const bool rendered = scene.control.architecture == Architecture::render;
  make_simulation<N>(scene)->run([&](const Row<N>& row) {
    const Direction<N> f = row.env_f.vec().template head<kAxes<N>>();
    rows.push_back({row.master_x.translation(), rendered ? row.master_x.translation() : row.slave_x.translation(), f,
                    f.norm(), row.touching});
    return true;
  });
  return rows;
}

std::string unstable(const Scene& scene, const std::string& why) {
  return fmt::format(
      "{}: {}; the impedance of an unstable loop has no meaning: choose another control.passivity.method, a lower "
      "stiffness or a shorter delay, until twoport-lab run calls the scene stable",
      scene.name, why);
}
std::string never_coupled(const Scene& scene) {
  return scene.name +
         ": the two sides were never coupled, so no force comes back; lower the loss and the blackouts of to_slave and "
         "to_master";
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

std::string no_free_space(const Scene& scene, double distance_m, double amplitude_m) {
  return fmt::format(
      "{}: the hand is never farther than {:.3g} m from contact, too little for an excursion of {:g} m in free space; "
      "let operator.path begin farther from the environment, or give a smaller --amplitude",
      scene.name, distance_m, amplitude_m);
}

template <int N>
std::vector<std::pair<std::string, Place<N>>> places(const Scene& scene, double amplitude_m) {
  const std::vector<Sample<N>> rows = look<N>(scene);
  const bool rendered = scene.control.architecture == Architecture::render;
  const double scale = rendered ? 1.0 : scene.control.force_scale * scene.control.motion_scale;
  MassDamperSpring robot;
  if (!rendered && scene.robot) robot = {scene.robot->mass_kg, scene.robot->damping_n_s_per_m, 0.0};
  const Environment<N> environment{scene.environment, scene.tool};

  // The contact: a moment at which the robot presses as it does half of the time.
  std::vector<const Sample<N>*> touching;
  for (const auto& row : rows)
    if (row.touching && (row.force > 0.0 || environment.holds())) touching.push_back(&row);
  std::vector<std::pair<std::string, Place<N>>> all;
  Direction<N> along = Direction<N>::Unit(0);
  double first_touch = std::numeric_limits<double>::infinity();
  std::optional<Place<N>> contact;
  if (!touching.empty()) {
    auto middle = touching.begin() + static_cast<std::ptrdiff_t>(touching.size() / 2);
    const Sample<N>& first = *touching.front();
    std::nth_element(touching.begin(), middle, touching.end(),
                     [](const auto* a, const auto* b) { return a->force < b->force; });
    const Sample<N>& typical = **middle;
    Direction<N> n = Direction<N>::Unit(0);  // the robot's axis, into the environment
    if (typical.force > 0.0) n = -typical.environment / typical.force;
    along = in_masters_axes<N>(scene, n);
    MassDamperSpring truth = slopes<N>(environment, typical.robot, n);
    truth.mass_kg = robot.mass_kg;
    truth.damping_n_s_per_m += robot.damping_n_s_per_m;
    double amplitude = amplitude_m;
    if (!environment.holds()) {
      first_touch = along.dot(first.master);
      const double depth = std::abs(along.dot(typical.master) - first_touch);
      amplitude = std::min(amplitude, depth / 3.0);
      if (amplitude < kLeastShare * amplitude_m)
        throw ConfigError{
            fmt::format("{}: in contact the hand is only {:.3g} m behind the place where contact began, too little for "
                        "an excursion of {:g} m; let operator.path press deeper, or give a smaller --amplitude",
                        scene.name, depth, amplitude_m)};
    }
    contact = Place<N>{typical.master, along, amplitude, scaled(truth, scale), false};
  }
  // Free space: where the hand is farthest from there.
  const Sample<N>* away = nullptr;
  for (const auto& row : rows)
    if (!row.touching && (away == nullptr || along.dot(row.master) < along.dot(away->master))) away = &row;
  if (away != nullptr) {
    const double distance = std::abs(first_touch - along.dot(away->master));
    const double amplitude = std::min(amplitude_m, distance / 2.0);
    if (amplitude < kLeastShare * amplitude_m) throw ConfigError{no_free_space(scene, distance, amplitude_m)};
    all.emplace_back("free space", Place<N>{away->master, along, amplitude, scaled(robot, scale), true});
  }
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

/// Constant speed amplitude, random phases, largest excursion `amplitude_m`.
std::vector<MultiSineSpec::Wave> waves(const std::vector<int>& lines, double base_hz, double amplitude_m,
                                       const Random& phases) {
  std::vector<MultiSineSpec::Wave> all;
  for (const int line : lines)
    all.push_back({1.0 / line, base_hz * line, kTurn * phases.uniform(static_cast<std::uint64_t>(line))});
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

/// Spectra of whole periods, line by line.
struct Spectra {
  std::vector<std::vector<Complex>> x, f;  ///< [line][period of all realizations]
  double force2 = 0.0;                     ///< mean square of the force, constant part included [N²]
};

/// Runs one realization and appends its periods.
template <int N>
void excite(Scene scene, const Place<N>& place, const ImpedanceOptions& o, int realization,
            const std::vector<int>& lines, Spectra& spectra) {
  const double rate = scene.master_rate_hz;
  const auto period = static_cast<std::size_t>(std::lround(rate / o.low_hz));
  const double base_hz = rate / static_cast<double>(period);
  const auto periods = static_cast<std::size_t>(o.periods);
  const double excited_s = static_cast<double>((periods + 1) * period) / rate;
  const double amplitude_m = realization % 2 == 0 ? place.amplitude_m : 0.5 * place.amplitude_m;
  OperatorSpec hand;
  hand.path.push_back(MoveToSpec{{place.at.data(), place.at.data() + place.at.size()}, kApproach});
  hand.path.push_back(HoldSpec{kSettle});
  hand.path.push_back(MultiSineSpec{{place.along.data(), place.along.data() + place.along.size()},
                                    waves(lines, base_hz, amplitude_m, Random{static_cast<std::uint64_t>(realization)}),
                                    excited_s + 1.0});
  scene.operator_model = hand;
  if (scene.device) scene.device->velocity_m_per_s.clear();
  scene.seed += static_cast<std::uint64_t>(realization);
  scene.duration_s = kApproach + kSettle + excited_s;

  const auto from = static_cast<std::size_t>(std::lround((kApproach + kSettle) * rate)) + period;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    spectra.x[i].resize(spectra.x[i].size() + periods);
    spectra.f[i].resize(spectra.f[i].size() + periods);
  }
  const std::size_t first = spectra.x[0].size() - periods;
  std::size_t k = 0;
  bool coupled = false, touched = false, finite = true;
  make_simulation<N>(scene)->run([&](const Row<N>& row) {
    const std::size_t into = k++ - from;
    if (k <= from || into / period >= periods) return true;
    const double dx = place.along.dot(row.master_x.translation() - place.at);
    const double force = place.along.dot(row.master_f.vec().template head<kAxes<N>>());
    spectra.force2 += force * force / static_cast<double>(periods * period) / o.realizations;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const double turn = static_cast<double>(into % period) * lines[i] / static_cast<double>(period);
      const Complex e = std::polar(1.0 / static_cast<double>(period), -kTurn * (turn - std::floor(turn)));
      spectra.x[i][first + into / period] += dx * e;
      spectra.f[i][first + into / period] += force * e;
    }
    coupled = coupled || row.coupled;
    touched = touched || row.touching;
    return finite = std::isfinite(force);
  });
  if (!finite) throw ConfigError{unstable(scene, "it diverges while the handle is moved as the measurement asks")};
  if (!coupled) throw ConfigError{never_coupled(scene)};
  if (place.free && touched) throw ConfigError{no_free_space(scene, 2.0 * place.amplitude_m, o.amplitude_m)};
}

template <int N>
DisplayedImpedance measured(const Scene& scene, const std::string& name, const Place<N>& place,
                            const ImpedanceOptions& o) {
  const double rate = scene.master_rate_hz;
  const std::vector<int> lines = odd_lines(o, rate);
  const double base_hz = rate / static_cast<double>(std::lround(rate / o.low_hz));
  Spectra spectra;
  spectra.x.resize(lines.size());
  spectra.f.resize(lines.size());
  for (int r = 0; r < o.realizations; ++r) excite<N>(scene, place, o, r, lines, spectra);

  DisplayedImpedance out{
      .place = name, .amplitude_m = place.amplitude_m, .displayed = {}, .truth = place.truth, .lines = {}};
  out.least_coherence = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const double omega = kTurn * base_hz * lines[i], half_tick = 0.5 * omega / rate;
    Complex xf;
    double xx = 0.0, ff = 0.0;
    for (std::size_t p = 0; p < spectra.x[i].size(); ++p) {
      xf += std::conj(spectra.x[i][p]) * spectra.f[i][p];
      xx += std::norm(spectra.x[i][p]);
      ff += std::norm(spectra.f[i][p]);
    }
    const Complex shown = xf / xx * std::polar(sinc(half_tick), -half_tick),
                  truth = dynamic_stiffness(place.truth, omega);
    double coherence = std::numeric_limits<double>::quiet_NaN();
    if (spectra.force2 > 0.0) {
      const double least = kNoForce * kNoForce * spectra.force2 * static_cast<double>(spectra.f[i].size());
      coherence = ff > least ? std::norm(xf) / (xx * ff) : 0.0;
    }
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
  const Summary whole = run(scene);
  if (whole.has_coupled_share() && whole.coupled_share() == 0.0) throw ConfigError{never_coupled(scene)};
  if (whole.verdict_kind() == to_string(VerdictKind::unstable)) throw ConfigError{unstable(scene, whole.verdict())};
  return for_cartesian_dof(scene.dof, "impedance", [&]<int N>() {
    std::vector<DisplayedImpedance> all;
    for (const auto& [name, place] : places<N>(scene, options.amplitude_m))
      all.push_back(measured<N>(scene, name, place, options));
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
