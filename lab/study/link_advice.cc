#include "lab/study/link_advice.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/text.h"

namespace twoport::lab {
namespace {

constexpr double kLongestPlayout_ms = 2000.0;
// A robot that presses goes on doing so that long after its master has died.
constexpr double kLongestHold_s = 1.0;

/// Where the round trip comes from: "12.1 ms there (least) + 9 ms of playout".
std::string part(const LinkAdvice::Way& way, const char* name) {
  const double least_ms = 1e3 * way.figures.least_s;
  if (way.playout_ms > 0.0)
    return fmt::format("{:.1f} ms {} at least + {:g} ms of playout", least_ms, name, way.playout_ms);
  return fmt::format("{:.1f} ms {} in the median", least_ms + 1e3 * way.figures.jitter_p50_s, name);
}

/// One place with what the advice says of the link.
Map map_of(const LinkTrace& link, const LinkAdvice& advice, MapOptions options, const Heard& heard) {
  options.set.insert(options.set.end(), {fmt::format("control.release_after_s={}", advice.release_after_s),
                                         fmt::format("control.hold_after_s={}", advice.hold_after_s),
                                         fmt::format("control.passivity.round_trip_ms={}", advice.round_trip_ms()),
                                         fmt::format("to_slave.playout_ms={}", advice.to_slave.playout_ms),
                                         fmt::format("to_master.playout_ms={}", advice.to_master.playout_ms)});
  options.round_trips_ms = {advice.round_trip_ms()};
  options.losses = {0.0};
  options.bursts_packets = {1.0};
  options.link = &link;
  return make_map(options, heard);
}

double best_error_n(const Map& map) {
  const std::size_t best = best_of(standings(map, 0));
  return best < map.methods.size() ? map.at(best, 0).error_n.mean : std::numeric_limits<double>::infinity();
}
std::string in_words(double error_n) {
  return std::isfinite(error_n) ? fmt::format("an error of {:.2g} N", error_n) : "no method that holds";
}

/// Which parts of the trace were played, and why.
std::string played(const LinkTrace& link, const std::vector<LinkPart>& parts) {
  if (parts.size() == 1 && parts[0].why.empty())
    return fmt::format("played: all {:.1f} s of the trace, in a loop", duration_s(link));
  std::vector<std::string> words;
  for (const LinkPart& part : parts) words.push_back(fmt::format("from {:.1f} s on, {}", part.from_s, part.why));
  return fmt::format("played, of {:.1f} s, as long as the scene lasts: {}", duration_s(link), fmt::join(words, "; "));
}

std::string of_passivity(const LinkAdvice& a) {
  const std::size_t plus = a.method.find('+');
  return plus == a.method.npos ? fmt::format("method: {} ", a.method)
                               : fmt::format("layer: {} ", a.method.substr(plus + 1));
}
std::string transparency_of(const LinkAdvice& a) {
  const std::size_t plus = a.method.find('+');
  return plus == a.method.npos ? "" : a.method.substr(0, plus);
}

}  // namespace

double LinkAdvice::longest_silence_s() const {
  return std::max(to_slave.figures.longest_silence_s(), to_master.figures.longest_silence_s());
}

LinkAdvice advise(const DirectionFigures& to_slave, const DirectionFigures& to_master) {
  const auto way = [](const DirectionFigures& f) {
    const double playout_ms = std::min(std::ceil(1e3 * f.jitter_p99_s - 1e-9), kLongestPlayout_ms);
    return LinkAdvice::Way{f, f.jitter_p99_s < 1e-3 ? 0.0 : playout_ms};
  };
  LinkAdvice a{.to_slave = way(to_slave), .to_master = way(to_master), .method = {}, .why = {}};
  a.hold_after_s = std::clamp(0.05 * std::ceil(4.0 * a.longest_silence_s() / 0.05 - 1e-9), 0.1, kLongestHold_s);
  const double wait_s = std::max(a.hold_after_s, 1e-3 * std::max(a.to_slave.playout_ms, a.to_master.playout_ms));
  a.release_after_s = std::max(1.0, 2.0 * wait_s);
  return a;
}

LinkAdvice recommend(const LinkTrace& link, MapOptions options, const Heard& heard) {
  LinkAdvice advice = advise(figures_of(link.to_slave), figures_of(link.to_master));
  const bool twice = advice.to_slave.playout_ms > 0.0 || advice.to_master.playout_ms > 0.0;
  double before_s = 0.0;  // the first map took so long
  const auto tell = [&](Progress p) {
    const double spent_s = p.spent_s;
    if (before_s > 0.0) p.done += p.count, p.spent_s += before_s;
    if (twice && before_s == 0.0 && p.left_s) *p.left_s += *p.left_s + spent_s;
    if (twice) p.count *= 2;
    if (p.done == p.count / 2) before_s = std::max(before_s, spent_s);
    if (heard) heard(p);
  };
  Map map = map_of(link, advice, options, tell);
  std::string playout = "no playout_ms: 99 % of the packets are within a millisecond of the fastest";
  if (twice) {
    LinkAdvice without = advice;
    without.to_slave.playout_ms = without.to_master.playout_ms = 0.0;
    Map other = map_of(link, without, options, tell);
    const double error_n = best_error_n(map), error_without_n = best_error_n(other);
    const bool drop = error_without_n <= error_n;
    playout = fmt::format(
        "{}: with {:g} ms to_slave and {:g} ms to_master, in which 99 % of the packets arrive, {}; without, {}",
        drop ? "no playout_ms" : "playout_ms", advice.to_slave.playout_ms, advice.to_master.playout_ms,
        in_words(error_n), in_words(error_without_n));
    if (drop) advice = std::move(without), map = std::move(other);
  }
  const Recommendation found = recommend(standings(map, 0));
  advice.method = found.method;
  advice.initial_energy_j = map.initial_energy_j[0];
  advice.why = {
      fmt::format("{}: {}", found.method, found.why),
      played(link, map.parts),
      fmt::format("round_trip_ms {:.1f} = {} + {}", advice.round_trip_ms(), part(advice.to_slave, "there"),
                  part(advice.to_master, "back")),
      playout,
      fmt::format("hold_after_s {:g}: four times the longest silence, {:.1f} ms, at least 0.1 and at most {:g}{}",
                  advice.hold_after_s, 1e3 * advice.longest_silence_s(), kLongestHold_s,
                  advice.longest_silence_s() > kLongestHold_s
                      ? ": in such an outage the robot is held, then let go, and coupled anew"
                      : ""),
      "initial_energy_j: what the hand may get at most beyond what it has put in, by the rule for this round trip"};
  if (const double spacing_s = std::max(advice.to_slave.figures.spacing_s, advice.to_master.figures.spacing_s);
      spacing_s > kSparse_s)
    advice.why.push_back(fmt::format(
        "the rows are {:.2g} s apart: what is shorter than two rows, an outage or a change of delay, is not "
        "in them; measure at the rate of the scene",
        spacing_s));
  return advice;
}

std::string to_text(const LinkAdvice& a) {
  std::string text;
  for (const std::string& sentence : a.why) text += fmt::format("# {}\n", sentence);
  if (a.method == "none") return text;
  text += "control {\n";
  text += fmt::format("  hold_after_s: {:g}\n", a.hold_after_s);
  if (a.release_after_s != 1.0) text += fmt::format("  release_after_s: {:g}\n", a.release_after_s);
  if (const std::string layer = transparency_of(a); !layer.empty())
    text += fmt::format("  transparency {{ layer: {} }}\n", layer);
  text += fmt::format("  passivity {{ {}initial_energy_j: {:.4g} round_trip_ms: {:.1f} }}\n}}\n", of_passivity(a),
                      a.initial_energy_j, a.round_trip_ms());
  for (const auto& [name, way] : {std::pair{"to_slave", &a.to_slave}, {"to_master", &a.to_master}})
    if (way->playout_ms > 0.0) text += fmt::format("{} {{ playout_ms: {:g} }}\n", name, way->playout_ms);
  return text;
}

std::string to_json(const LinkAdvice& a) {
  const std::string layer = transparency_of(a);
  std::string passivity;
  if (!layer.empty()) {
    passivity = fmt::format("\"layer\": {}, ", json_string(a.method.substr(layer.size() + 1)));
  } else {
    passivity = fmt::format("\"method\": {}, ", json_string(a.method));
  }
  std::string ways;
  for (const auto& [name, way] : {std::pair{"to_slave", &a.to_slave}, {"to_master", &a.to_master}})
    if (way->playout_ms > 0.0) ways += fmt::format(", \"{}\": {{\"playout_ms\": {:g}}}", name, way->playout_ms);
  std::vector<std::string> why;
  for (const std::string& sentence : a.why) why.push_back(json_string(sentence));
  const std::string scene = fmt::format(
      "\"scene\": {{\"control\": {{\"hold_after_s\": {:g}, \"release_after_s\": {:g}{}, \"passivity\": "
      "{{{}\"initial_energy_j\": {:.4g}, \"round_trip_ms\": {:.1f}}}}}{}}},\n ",
      a.hold_after_s, a.release_after_s,
      layer.empty() ? "" : fmt::format(", \"transparency\": {{\"layer\": {}}}", json_string(layer)), passivity,
      a.initial_energy_j, a.round_trip_ms(), ways);
  return fmt::format("{{\n {}\"why\": [\n  {}],\n \"link\": {{\"to_slave\": {},\n  \"to_master\": {}}}\n}}\n",
                     a.method == "none" ? "" : scene, fmt::join(why, ",\n  "), to_json(a.to_slave.figures),
                     to_json(a.to_master.figures));
}

std::string to_json(const DirectionFigures& f) {
  return fmt::format(
      "{{\"received\": {}, \"lost\": {}, \"late\": {}, \"duplicated\": {}, \"loss\": {:.6f}, \"burst_packets\": "
      "{:.2f}, \"jitter_ms\": {{\"p50\": {:.3f}, \"p99\": {:.3f}, \"max\": {:.3f}}}, \"longest_gap_ms\": {:.3f}}}",
      f.received, f.lost, f.late, f.duplicated, f.loss(), f.burst_packets, 1e3 * f.jitter_p50_s, 1e3 * f.jitter_p99_s,
      1e3 * f.jitter_max_s, 1e3 * f.longest_gap_s);
}

}  // namespace twoport::lab
