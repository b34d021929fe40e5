#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "lab/plot/picture.h"
#include "lab/study/grid.h"

namespace twoport::lab {
namespace {

using Replacement = std::pair<std::string_view, std::string_view>;

/// Takes the unit off the end of a name.
std::string take_unit(std::string& name) {
  static constexpr Replacement kUnits[] = {{"_n_m_s_per_rad", "N m s/rad"},
                                           {"_n_m_per_rad", "N m/rad"},
                                           {"_n_s_per_m", "N s/m"},
                                           {"_n_per_m", "N/m"},
                                           {"_rad_per_s", "rad/s"},
                                           {"_m_per_s", "m/s"},
                                           {"_kg_m2", "kg m²"},
                                           {"_n_m", "N m"},
                                           {"_rad", "rad"},
                                           {"_deg", "deg"},
                                           {"_kg", "kg"},
                                           {"_hz", "Hz"},
                                           {"_ms", "ms"},
                                           {"_us", "µs"},
                                           {"_j", "J"},
                                           {"_n", "N"},
                                           {"_m", "m"},
                                           {"_s", "s"}};
  for (const auto& [ending, unit] : kUnits)
    if (name.size() > ending.size() && name.ends_with(ending)) {
      name.resize(name.size() - ending.size());
      return std::string{unit};
    }
  return "";
}

bool take_ending(std::string& name, std::string_view ending) {
  if (!name.ends_with(ending)) return false;
  name.resize(name.size() - ending.size());
  return true;
}

std::string spaced(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

/// Takes the index off "wall[2]"; -1 where there is none.
int take_index(std::string& component) {
  const std::size_t bracket = component.find('[');
  if (bracket == component.npos) return -1;
  const int index = std::atoi(component.c_str() + bracket + 1);
  component.resize(bracket);
  return index;
}

/// The parts of a path's label.
struct PathWords {
  std::string stem;       ///< "delay"
  std::string direction;  ///< "to the slave", or empty
  std::string unit;
  [[nodiscard]] std::string text() const { return direction.empty() ? stem : stem + " " + direction; }
};

PathWords words_of(const std::string& path) {
  // What is clear from the rest, or said otherwise, is left out.
  static constexpr Replacement kBlocks[] = {{"control", ""},
                                            {"operator", ""},
                                            {"environment", ""},
                                            {"passivity", "controller"},
                                            {"virtual_coupling", "coupling"},
                                            {"force_sensor", "force sensor"}};
  static constexpr Replacement kWhole[] = {{"control.passivity.method", "passivity control"},
                                           {"control.passivity.max_gain", "largest gain of the controller"},
                                           {"rate_hz", "sampling rate"},
                                           {"simulation.substeps", "substeps a tick"}};
  PathWords w;
  const std::vector<std::string_view> all = parts_of(path, '.');
  std::vector<std::string> parts{all.begin(), all.end()};
  std::string leaf = parts.back();
  parts.pop_back();
  const int axis = take_index(leaf);
  w.unit = take_unit(leaf);
  for (const auto& [whole, words] : kWhole)
    if (path == whole) {
      w.stem = words;
      return w;
    }
  std::string number;
  for (std::string& part : parts) {
    const int index = take_index(part);
    if (part == "to_slave" || part == "to_master") {
      w.direction = part == "to_slave" ? "to the slave" : "to the master";
      continue;
    }
    if (part == "robot" && &part != &parts.back()) continue;  // the robot's force sensor
    std::string words = spaced(part);
    for (const auto& [block, instead] : kBlocks)
      if (part == block) words = instead;
    if (index > 0) number = fmt::format("no. {} ", index + 1);  // of environment[1].wall: the wall's
    if (!words.empty()) w.stem += words + " " + std::exchange(number, "");
  }
  w.stem += spaced(leaf);
  if (axis >= 0) w.stem += fmt::format(", axis {}", axis);
  return w;
}

}  // namespace

std::string Label::text() const {
  return unit.empty() ? words : fmt::format("{} [{}]", words, unit);
}

Label label_of_paths(const std::vector<std::string>& paths) {
  std::vector<PathWords> all;
  for (const std::string& path : paths) all.push_back(words_of(path));
  const PathWords& first = all.front();
  const auto each = [&](auto test) { return std::all_of(all.begin(), all.end(), test); };
  const bool one_stem = each([&](const PathWords& w) { return w.stem == first.stem; });
  if (one_stem && all.size() == 2 && !first.direction.empty() && !all[1].direction.empty())
    return {first.stem + " each way", first.unit};
  const bool one_unit = each([&](const PathWords& w) { return w.unit == first.unit; });
  Label label{.words = "", .unit = one_unit ? first.unit : ""};
  for (const PathWords& w : all) {
    if (!label.words.empty()) label.words += " and ";
    label.words += one_unit ? w.text() : Label{w.text(), w.unit}.text();
  }
  return label;
}

Label label_of_figure(std::string_view key) {
  static constexpr Replacement kWhole[] = {{"rtt", "round-trip time"},
                                           {"steps", "ticks"},
                                           {"min_observed_energy", "least energy that the observer saw"},
                                           {"hand_min_energy", "least energy through the hand's port"},
                                           {"two_port_min_energy", "least energy through both ports of the link"},
                                           {"robot_min_energy", "least energy into the robot's coupling"},
                                           {"energy_owed", "undissipated deficit"},
                                           {"dissipated", "energy dissipated by the controllers"},
                                           {"packets.to_slave", "packets to the slave"},
                                           {"packets.to_master", "packets to the master"}};
  std::string name{key}, ending;
  if (take_ending(name, "_sd")) ending = ", standard deviation over the seeds";
  if (take_ending(name, "_worst")) ending = ", worst seed";
  const std::size_t dot = name.rfind('.');
  if (dot != name.npos) {
    ending = ", " + name.substr(dot + 1) + ending;
    name.resize(dot);
  }
  Label label{.words = "", .unit = take_unit(name)};
  if (take_ending(name, "_rms")) ending = ", rms" + ending;
  if (take_ending(name, "_max")) ending = ", largest" + ending;
  const auto whole =
      std::find_if(std::begin(kWhole), std::end(kWhole), [&](const Replacement& r) { return r.first == name; });
  if (whole != std::end(kWhole)) {
    label.words = whole->second;
  } else if (name.starts_with("min_")) {
    label.words = "least " + spaced(name.substr(4));
  } else if (name.starts_with("max_")) {
    label.words = "largest " + spaced(name.substr(4));
  } else {
    label.words = spaced(name);
  }
  label.words += ending;
  return label;
}

}  // namespace twoport::lab
