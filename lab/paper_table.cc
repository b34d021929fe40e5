#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "lab/paper.h"

namespace twoport::lab {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr PaperReported kNothing{kNone, kNone, kNone, kNone, kNone, kNone, kNone};

struct Known {
  std::string_view experiment, sensor, method;
  PaperReported numbers;
};
constexpr Known kKnown[] = {
    {"point", "ideal", "none", {-0.125, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"point", "ideal", "classic", {-8.6e-5, 10.8, 176, 0.082, 0.53, kNone, kNone}},
    {"point", "ideal", "projected no clamp", {-7.8e-5, kNone, 180, 0, 0, kNone, 10.0 / 7400}},
    {"point", "ideal", "projected", {-9.1e-5, 0, 0, 0, 0, kNone, 0}},
    {"slide", "ideal", "none", {-0.125, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "ideal", "classic literal", {-2.5e-4, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "ideal", "projected literal", {-3.8e-4, kNone, kNone, kNone, kNone, kNone, 0.18}},
    {"slide", "ideal", "classic", {-1.2e-4, 30.1, 178, 0.129, 0.76, kNone, kNone}},
    {"slide", "ideal", "projected no clamp", {-7.8e-5, kNone, 180, 0, 0, kNone, kNone}},
    {"slide", "ideal", "projected", {-9.1e-5, 0, 0, 0, 0, 0.8, 0}},
    {"slide", "ideal", "projected predict", {-3.3e-6, 0, 0, 0, 0, 1.5, 0}},
    {"slide", "ideal", "projected reference no prediction", {-8.7e-6, 0, 0, 0, 0, kNone, 0}},
    {"slide", "ideal", "projected reference", {-6.9e-8, 0, 0, 0, 0, 0.105, 0}},
    {"slide", "ideal", "projected reference uncapped", {-6.9e-8, 0, 0, 0, 0, 0.105, 0}},
    {"curved", "ideal", "none", {-0.120, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "ideal", "classic", {-1.0e-4, 29.3, 177, 0.127, 0.73, kNone, kNone}},
    {"curved", "ideal", "projected", {-6.1e-5, 0, 0, 0, 0, kNone, 0}},
    {"point", "encoder", "none", {-0.071, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"point", "encoder", "classic", {-2.6e-5, 3.0, 20, 0.088, 0.50, kNone, kNone}},
    {"point", "encoder", "projected", {-2.4e-5, 3.5e-7, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "none", {-0.082, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "projected literal", {-7.7e-3, kNone, kNone, kNone, kNone, kNone, 0.49}},
    {"slide", "encoder", "classic", {-6.5e-5, 10.0, 168, 0.085, 0.81, kNone, kNone}},
    {"slide", "encoder", "projected", {-5.8e-5, 3.7e-7, kNone, kNone, kNone, kNone, kNone}},
    {"slide", "encoder", "projected reference uncapped", {-1.2e-2, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "encoder", "none", {-0.073, kNone, kNone, kNone, kNone, kNone, kNone}},
    {"curved", "encoder", "classic", {-1.0e-5, 10.2, 130, 0.096, 0.72, kNone, kNone}},
    {"curved", "encoder", "projected", {-1.1e-5, 4e-7, kNone, kNone, kNone, kNone, kNone}},
};

double share(std::uint64_t part, std::uint64_t of) {
  return of > 0 ? static_cast<double>(part) / static_cast<double>(of) : 0.0;
}

/// "-1.2e-04", "0", or "·" for an unknown value.
std::string small(double x) {
  if (std::isnan(x)) return "·";
  return x == 0.0 ? "0" : fmt::format("{:.1e}", x);
}
std::string plain(double x) {
  if (std::isnan(x)) return "·";
  if (x == 0.0) return "0";
  return std::abs(x) < 1e-3 ? fmt::format("{:.0e}", x) : fmt::format("{:.3g}", x);
}
std::string percent(double x) {
  return std::isnan(x) ? "·" : fmt::format("{:.1f} %", 100.0 * x);
}
std::string pair(double a, double b) {
  return fmt::format("{} / {}", plain(a), plain(b));
}

/// Cells beneath a head, each column as wide as it needs.
class TextTable {
 public:
  explicit TextTable(std::vector<std::string> head) { lines_.push_back(std::move(head)); }
  void add(std::vector<std::string> cells) { lines_.push_back(std::move(cells)); }
  [[nodiscard]] std::string text() const {
    std::vector<std::size_t> width(lines_[0].size());
    for (const auto& line : lines_)
      for (std::size_t i = 0; i < line.size(); ++i) width[i] = std::max(width[i], letters(line[i]));
    std::string out;
    for (const auto& line : lines_) {
      std::string row = " ";
      for (std::size_t i = 0; i < line.size(); ++i)
        row += fmt::format(" {}{:{}}", line[i], "", width[i] - letters(line[i]) + 1);
      row.erase(row.find_last_not_of(' ') + 1);
      out += row + "\n";
    }
    return out;
  }

 private:
  static std::size_t letters(const std::string& s) {
    return static_cast<std::size_t>(std::count_if(s.begin(), s.end(), [](char c) { return (c & 0xc0) != 0x80; }));
  }
  std::vector<std::vector<std::string>> lines_;
};

}  // namespace

PaperReported paper_reported(const PaperCase& which) {
  for (const Known& k : kKnown)
    if (which.hand == "light" && k.experiment == which.experiment && k.sensor == which.sensor &&
        k.method == which.method)
      return k.numbers;
  return kNothing;
}

const PaperNumbers& PaperTable::at(const std::string& experiment, const std::string& hand, const std::string& sensor,
                                   const std::string& method) const {
  for (const PaperResult& r : results)
    if (r.which.experiment == experiment && r.which.hand == hand && r.which.sensor == sensor &&
        r.which.method == method)
      return r.numbers;
  throw ConfigError{fmt::format("no such case: {}, {}, {}, {}", experiment, hand, sensor, method)};
}

namespace {

/// What a controller used; an encoder's velocity is another than the true one.
double gain(const PaperResult& of) {
  const bool known = of.which.sensor == "ideal" && of.which.method != "none";
  return known ? of.numbers.max_gain_n_s_per_m : kNone;
}

/// Numbers of a case as figures.csv names them.
std::vector<std::pair<const char*, double>> columns(const PaperResult& of) {
  const PaperNumbers& n = of.numbers;
  const PaperReported known = paper_reported(of.which);
  return {{"min_energy_j", n.min_energy_j},
          {"reported_min_energy_j", known.min_energy_j},
          {"min_surplus_j", n.min_surplus_j},
          {"min_normal_energy_j", n.min_normal_energy_j},
          {"energy_x_j", n.axis_energy_j[0]},
          {"energy_y_j", n.axis_energy_j[1]},
          {"energy_z_j", n.axis_energy_j[2]},
          {"energy_j", n.energy_j},
          {"energy_x_at_1s_j", n.axis_energy_at_1s_j[0]},
          {"energy_y_at_1s_j", n.axis_energy_at_1s_j[1]},
          {"energy_z_at_1s_j", n.axis_energy_at_1s_j[2]},
          {"direction_rms_deg", n.direction_deg.rms()},
          {"reported_direction_rms_deg", known.direction_rms_deg},
          {"direction_max_deg", n.direction_deg.max},
          {"reported_direction_max_deg", known.direction_max_deg},
          {"normal_direction_rms_deg", n.normal_direction_deg.rms()},
          {"normal_direction_max_deg", n.normal_direction_deg.max},
          {"tip_rms_n", n.tip_n.rms()},
          {"reported_tip_rms_n", known.tip_rms_n},
          {"tip_max_n", n.tip_n.max},
          {"reported_tip_max_n", known.tip_max_n},
          {"correction_mean_n", n.mean_correction_n},
          {"correction_max_n", n.max_correction_n},
          {"reported_correction_max_n", known.correction_max_n},
          {"max_gain_n_s_per_m", gain(of)},
          {"pulling_share", share(n.pulling_ticks, n.contact_ticks)},
          {"reported_pulling_share", known.pulling_share},
          {"saturated_share", share(n.saturated_ticks, n.contact_ticks)},
          {"contact_share", share(n.contact_ticks, n.ticks)},
          {"free_air_ticks", static_cast<double>(n.free_air_ticks)},
          {"max_depth_m", n.max_depth_m},
          {"speed_rms_m_per_s", n.speed_m_per_s.rms()}};
}

/// The paper's claims with the computed numbers, in sentences.
std::string words(const PaperTable& t) {
  const auto light = [&](const char* experiment, const char* method, const char* sensor = "ideal") -> decltype(auto) {
    return t.at(experiment, "light", sensor, method);
  };
  const PaperNumbers &none = light("slide", "none"), &point = light("point", "classic"),
                     &slide = light("slide", "classic"), &curved = light("curved", "classic"),
                     &literal = light("slide", "projected literal"), &added = light("slide", "projected reference"),
                     &eq2 = light("slide", "projected eq. 2"), &hidden = light("friction", "projected reference total"),
                     &apart = light("friction", "projected reference");
  double straightest = 0.0;
  for (const char* experiment : {"point", "slide", "curved"})
    for (const char* sensor : {"ideal", "encoder"})
      straightest = std::max(straightest, light(experiment, "projected", sensor).direction_deg.max);
  return fmt::format(
      "Summary\n"
      "  Without control the wall generates {:.3f} J in 4 s and chatters {:.1f} mm deep (Fig. 7).\n"
      "  Damping along the velocity turns the force by {:.0f} deg rms when pressing, {:.0f} when sliding, {:.0f} on a "
      "curved wall\n"
      "  (Figs. 8, 9, 11); the hand's threshold for force direction is 18 to 32 deg.\n"
      "  Damping along the force turns it by at most {:.0e} deg, with an ideal sensor and with an encoder.\n"
      "  The paper's equations without a bound pull the hand into the wall in {:.0f} % of contact; with its literal "
      "eq. (2)\n"
      "  nothing is observed and the wall generates {:.3f} J.\n"
      "  With reference energy, prediction and a force that never pulls, corrections are at most {:.3f} N, and the "
      "port energy\n"
      "  is at most {:.1e} J below that of an ideal spring.\n"
      "  Rendered friction hides {:.2f} J from one total account: the wall chatters {:.2f} mm deep. With an account "
      "for the normal\n"
      "  force the depth is {:.2f} mm.\n",
      -none.min_energy_j, 1e3 * none.max_depth_m, point.direction_deg.rms(), slide.direction_deg.rms(),
      curved.direction_deg.rms(), straightest, 100.0 * share(literal.pulling_ticks, literal.contact_ticks),
      -eq2.min_energy_j, added.max_correction_n, -added.min_surplus_j, -hidden.min_normal_energy_j,
      1e3 * hidden.max_depth_m, 1e3 * apart.max_depth_m);
}

}  // namespace

std::string paper_csv(const PaperTable& table) {
  std::string out = "experiment,hand,sensor,method,seeds";
  for (const auto& [name, value] : columns({})) out.append(1, ',').append(name);
  out += ",set\n";
  for (const PaperResult& each : table.results) {
    const auto& [c, n] = each;
    out += fmt::format("{},{},{},{},{}", c.experiment, c.hand, c.sensor, c.method, n.seeds);
    for (const auto& [name, value] : columns(each)) out += std::isnan(value) ? "," : fmt::format(",{:.9g}", value);
    out += fmt::format(",\"{}\"\n", fmt::join(c.set, " "));
  }
  return out;
}

std::string paper_text(const PaperTable& table) {
  std::string out;
  const auto experiment = [&](const char* title, const std::string& name, const std::string& sensor) {
    out += fmt::format("\n{}\n", title);
    TextTable grid{{"method", "worst port energy [J]", "reported", "direction error rms / max [deg]", "reported",
                    "tangential tip rms / max [N]", "reported", "largest correction [N]", "reported", "pulls",
                    "reported", "contact"}};
    for (const auto& [c, n] : table.results) {
      if (c.experiment != name || c.sensor != sensor || c.hand != "light") continue;
      const PaperReported known = paper_reported(c);
      grid.add({c.method, small(n.min_energy_j), small(known.min_energy_j),
                pair(n.direction_deg.rms(), n.direction_deg.max),
                pair(known.direction_rms_deg, known.direction_max_deg), pair(n.tip_n.rms(), n.tip_n.max),
                pair(known.tip_rms_n, known.tip_max_n), plain(n.max_correction_n), plain(known.correction_max_n),
                percent(share(n.pulling_ticks, n.contact_ticks)), percent(known.pulling_share),
                fmt::format("{:.0f} %", 100.0 * share(n.contact_ticks, n.ticks))});
    }
    out += grid.text();
  };
  experiment("Point contact (Fig. 8), ideal sensor", "point", "ideal");
  experiment("Surface following (Fig. 9), ideal sensor", "slide", "ideal");
  experiment("Curved wall (Figs. 10, 11), ideal sensor", "curved", "ideal");
  experiment("Point contact, encoder of 30 um, Coulomb friction 0.04 N, velocity through 150 Hz", "point", "encoder");
  experiment("Surface following, encoder", "slide", "encoder");
  experiment("Curved wall, encoder", "curved", "encoder");

  out += "\nEnergy by axis after 1 s without control (Fig. 7): the sum is physical, its parts depend on the axes [J]\n";
  TextTable axes{{"experiment", "hand", "x", "y", "z", "sum", "reported x, y, sum"}};
  const auto by_axis = [&](const char* name, const char* hand, const char* reported) {
    const auto& e = table.at(name, hand, "ideal", "none").axis_energy_at_1s_j;
    axes.add({name, hand, fmt::format("{:+.4f}", e[0]), fmt::format("{:+.4f}", e[1]), fmt::format("{:+.4f}", e[2]),
              fmt::format("{:+.4f}", e[0] + e[1] + e[2]), reported});
  };
  by_axis("point", "light", "·, ·, -0.0082");
  by_axis("slide", "light", "+0.0141, -0.0223, -0.0082");
  by_axis("slide", "medium", "·");
  by_axis("slide", "firm", "+0.038, -0.037, +0.0016");
  out += axes.text();

  out += "\nOther hands, surface following, ideal sensor\n";
  TextTable hands{{"hand", "method", "worst port energy [J]", "direction error rms / max [deg]",
                   "largest correction [N]", "deepest [mm]"}};
  for (const auto& [c, n] : table.results)
    if (c.experiment == "slide" && c.hand != "light")
      hands.add({c.hand, c.method, small(n.min_energy_j), pair(n.direction_deg.rms(), n.direction_deg.max),
                 plain(n.max_correction_n), fmt::format("{:.2f}", 1e3 * n.max_depth_m)});
  out += hands.text();

  out +=
      "\nApproach of the hand, surface following: gentle in 0.3 s, at once (as above), or with impact, from 10 mm "
      "outside in 0.1 s\n";
  TextTable arrivals{{"approach", "sensor", "method", "worst port energy [J]", "below the ideal spring [J]",
                      "direction error rms / max [deg]", "largest correction [N]", "largest gain [N s/m]", "pulls"}};
  for (const auto& [c, n] : table.results) {
    static constexpr std::string_view kShown[] = {"none", "classic", "projected no clamp", "projected",
                                                  "projected reference"};
    const bool shown = std::find(std::begin(kShown), std::end(kShown), c.method) != std::end(kShown);
    if (!c.experiment.starts_with("slide") || c.hand != "light" || !shown) continue;
    arrivals.add({c.experiment == "slide" ? "at once" : c.experiment.substr(6), c.sensor, c.method,
                  small(n.min_energy_j), small(n.min_surplus_j), pair(n.direction_deg.rms(), n.direction_deg.max),
                  plain(n.max_correction_n), plain(gain({c, n})), percent(share(n.pulling_ticks, n.contact_ticks))});
  }
  out += arrivals.text();

  out +=
      "\nFriction 0.3 rendered in the wall: one total account hides the energy of the wall, an account for the normal "
      "force does not.\nReported: 2.04 mm and 0.311 m/s with the total, 0.67 mm, 0.135 m/s and -7e-8 J with two "
      "accounts\n";
  TextTable friction{{"sensor", "method", "worst port energy [J]", "worst normal energy [J]", "deepest [mm]",
                      "speed rms [m/s]", "direction error rms / max [deg]"}};
  for (const auto& [c, n] : table.results)
    if (c.experiment == "friction")
      friction.add({c.sensor, c.method, small(n.min_energy_j), small(n.min_normal_energy_j),
                    fmt::format("{:.2f}", 1e3 * n.max_depth_m), fmt::format("{:.3f}", n.speed_m_per_s.rms()),
                    pair(n.direction_deg.rms(), n.direction_deg.max)});
  out += friction.text();

  out += "\nAdmittance causality (Fig. 2): a virtual mass with velocity as output, held by a firm grip\n";
  TextTable admittance{{"method", "worst port energy [J]", "fastest [m/s]", "velocity turned rms / max [deg]",
                        "largest correction [m/s]"}};
  for (const AdmittanceRun& r : table.admittance)
    admittance.add({r.method, small(r.min_energy_j),
                    plain(r.most_speed_m_per_s) +
                        (r.stopped_at_s > 0.0 ? fmt::format(", stopped at {:.2f} s", r.stopped_at_s) : ""),
                    pair(r.direction_deg.rms(), r.direction_deg.max), plain(r.correction_m_per_s.max)});
  out += admittance.text();

  out += "\nIndependence of the frame: surface following without tremor\n";
  TextTable frames{{"method", "new frame each tick: energy [relative]", "force [of the largest]",
                    "world turned: energy [J]", "path [m]"}};
  for (const FrameCheck& f : table.frames)
    frames.add({f.method, small(f.energy_per_tick_frames), small(f.force_per_tick_frames), small(f.energy_turned_world),
                small(f.path_turned_world_m)});
  out += frames.text();
  return out + "\n" + words(table);
}

}  // namespace twoport::lab
