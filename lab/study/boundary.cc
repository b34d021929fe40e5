#include "lab/study/boundary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/text.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"

namespace twoport::lab {
namespace {

/// The value halfway, in the logarithm where that exists.
double between(double low, double high, double part) {
  if (low * high > 0.0) return low * std::pow(high / low, part);
  return low + part * (high - low);
}

/// Short to write, and off by no more than a tenth of the tolerance.
double rounded(double value, double tolerance) {
  const int digits = std::clamp(2 + static_cast<int>(std::ceil(-std::log10(tolerance))), 1, 17);
  return std::stod(fmt::format("{:.{}g}", value, digits));
}

double number(const std::string& whole, std::string_view text) {
  const std::optional<double> value = number_from<double>(text);
  if (!value || !std::isfinite(*value))
    throw ConfigError{fmt::format("{}: \"{}\" is not a number; it must read PATH=LO:HI", whole, text)};
  return *value;
}

/// The scene, read once for all values that are tried.
std::string text_of(const BoundaryOptions& o) {
  return o.text ? *o.text : read_text(o.scene);
}
Scene scene_at(const SceneText& text, const Interval& vary, double value) {
  std::vector<std::string> overrides;
  for (const std::string& path : vary.paths) overrides.push_back(fmt::format("{}={}", path, value));
  return text.with(overrides);
}

}  // namespace

Interval parse_interval(const std::string& text, const std::string& option) {
  const std::string what = option + " " + text;
  const std::size_t equals = text.find('='), colon = text.find(':', equals == text.npos ? 0 : equals);
  if (equals == text.npos || equals == 0 || colon == text.npos) throw ConfigError{what + ": it must read PATH=LO:HI"};
  const std::string_view all{text};
  const Interval interval{.paths = parse_paths(text.substr(0, equals), what),
                          .low = number(what, all.substr(equals + 1, colon - equals - 1)),
                          .high = number(what, all.substr(colon + 1))};
  if (!(interval.low < interval.high))
    throw ConfigError{fmt::format("{}: LO is {}, HI is {}; LO must be < HI", what, interval.low, interval.high)};
  return interval;
}

std::string Interval::name() const {
  return fmt::format("{}", fmt::join(paths, ","));
}

namespace {

/// A search, whoever runs what it wants to know next.
class Search {
 public:
  explicit Search(const BoundaryOptions& o) : tolerance_{o.tolerance} {
    if (!(o.tolerance > 0.0 && o.tolerance < 1.0))
      throw ConfigError{fmt::format("--tolerance is {}; it must be between 0 and 1", o.tolerance)};
    const std::size_t n = static_cast<std::size_t>(2 + std::max(o.scan, 0));
    for (std::size_t i = 0; i < n; ++i) {
      const double part = static_cast<double>(i) / static_cast<double>(n - 1);
      next_.push_back(i == 0       ? o.vary.low
                      : i + 1 == n ? o.vary.high
                                   : rounded(between(o.vary.low, o.vary.high, part), tolerance_));
    }
  }

  /// The values that are to be run next; none once the search has ended.
  [[nodiscard]] const std::vector<double>& next() const { return next_; }
  /// What next() has shown, in its order.
  void take(const std::vector<Trial>& trials) {
    next_.clear();
    if (!scanned_) {
      see_scan(trials);
    } else {
      (trials.front().stable == found_.stable_at_low ? same_ : other_) = trials.front().value;
    }
    if (!changes_) return;
    found_.boundary = found_.stable_at_low ? Boundary{same_, other_} : Boundary{other_, same_};
    bisect();
    found_.open = !next_.empty();
  }
  [[nodiscard]] const BoundarySearch& found() const { return found_; }

 private:
  void see_scan(const std::vector<Trial>& scan) {
    scanned_ = true;
    const Trial &first = scan.front(), &last = scan.back();
    const auto change =
        std::find_if(scan.begin(), scan.end(), [&](const Trial& t) { return t.stable != first.stable; });
    found_.stable_at_low = first.stable;
    changes_ = first.stable != last.stable;
    if (changes_) {
      same_ = std::prev(change)->value, other_ = change->value;
    } else if (change != scan.end()) {
      found_.disagreement = change->value;
    }
  }
  void bisect() {
    if (other_ - same_ > tolerance_ * std::max(std::abs(same_), std::abs(other_))) {
      const double middle = between(same_, other_, 0.5), shorter = rounded(middle, tolerance_);
      const double value = same_ < shorter && shorter < other_ ? shorter : middle;
      if (same_ < value && value < other_) next_.push_back(value);
    }
  }

  double tolerance_, same_ = 0.0, other_ = 0.0;
  bool scanned_ = false, changes_ = false;
  std::vector<double> next_;
  BoundarySearch found_;
};

/// The trials of scenes with these values.
std::vector<Trial> tried(const std::vector<Scene>& scenes, const std::vector<double>& values, const BoundaryOptions& o,
                         LaneUse& use) {
  std::vector<const Scene*> all;
  for (const Scene& scene : scenes) all.push_back(&scene);
  std::vector<Trial> trials(values.size());
  use.add(run_many(all, {.lanes = o.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop, .robot = o.robot},
                   [&](std::size_t i, const Summary& s) {
                     const Summary both = with_verdict_of_both(s);
                     trials[i] = {values[i], both.stable(), both.verdict()};
                   }));
  return trials;
}

/// Values that a bisection tries after the scan, at most, where the boundary is not much nearer to 0 than the ends.
std::size_t most_bisections(const BoundaryOptions& o) {
  const double parts = static_cast<double>(1 + std::max(o.scan, 0)), low = o.vary.low, high = o.vary.high;
  const double width = low * high > 0.0 ? std::abs(std::expm1(std::log(high / low) / parts))
                                        : (high - low) / parts / std::max(std::abs(low), std::abs(high));
  return static_cast<std::size_t>(1.0 + std::max(0.0, std::ceil(std::log2(width / o.tolerance))));
}

/// Runs searches side by side, one for each text, until all have ended.
void run_all(std::vector<Search>& searches, const std::vector<SceneText>& texts, const BoundaryOptions& o, LaneUse& use,
             const std::function<void(const Trial&)>& heard_trial, const Heard& heard,
             const std::function<void()>& stepped = {}) {
  const std::size_t scan = searches.size() * searches.front().next().size();
  std::vector<std::size_t> left(searches.size(), most_bisections(o));
  Tally tally{scan + searches.size() * left.front(), heard};
  tally.expect("scan", scan, 1);
  tally.expect("bisection", searches.size() * left.front(), 1);
  for (bool scans = true;; scans = false) {
    std::vector<Scene> scenes;
    std::vector<double> values;
    for (std::size_t i = 0; i < searches.size(); ++i)
      for (const double value : searches[i].next())
        scenes.push_back(scene_at(texts[i], o.vary, value)), values.push_back(value);
    if (scenes.empty()) return;
    tally.begin(scans ? "scan" : "bisection");
    const std::vector<Trial> trials = tried(scenes, values, o, use);
    if (heard_trial) std::for_each(trials.begin(), trials.end(), heard_trial);
    auto at = trials.begin();
    std::size_t foreseen = 0;
    for (std::size_t i = 0; i < searches.size(); ++i) {
      if (searches[i].next().empty()) continue;
      const auto end = at + static_cast<std::ptrdiff_t>(searches[i].next().size());
      if (scans) foreseen += searches[i].next().size();
      if (!scans && left[i] > 0) ++foreseen, --left[i];
      searches[i].take({at, end});
      at = end;
      if (searches[i].next().empty()) tally.drop("bisection", std::exchange(left[i], 0));
    }
    tally.ran(foreseen);
    for (std::size_t i = 0; i < foreseen; ++i) tally.done();
    if (stepped) stepped();
  }
}

}  // namespace

BoundarySearch search_boundary(const BoundaryOptions& o, const std::function<void(const Trial&)>& heard_trial,
                               const Heard& heard) {
  std::vector<Search> search{Search{o}};
  const std::vector<SceneText> text{{text_of(o), o.scene, o.set}};
  for (const double end : {o.vary.low, o.vary.high})
    scene_at(text[0], o.vary, end);  // complains of an end, not of what lies between
  LaneUse use;
  run_all(search, text, o, use, heard_trial, heard);
  return search[0].found();
}

Boundary find_boundary(const BoundaryOptions& o, const std::function<void(const Trial&)>& heard_trial,
                       const Heard& heard) {
  const BoundarySearch found = search_boundary(o, heard_trial, heard);
  if (!found.boundary)
    throw ConfigError{fmt::format("{}: both ends are {}, {} and {}{}; the ends must differ", o.vary.name(),
                                  found.stable_at_low ? "stable" : "unstable", o.vary.low, o.vary.high,
                                  found.disagreement ? fmt::format(", though {} is not", *found.disagreement) : "")};
  return *found.boundary;
}

namespace {

/// The scene just beyond a boundary, without its environment.
Scene in_free_space(const SceneText& text, const BoundaryOptions& o, const Boundary& boundary) {
  Scene free = scene_at(text, o.vary, boundary.unstable);
  free.environment.clear();
  return free;
}
Decided decided_by(const Summary& in_free_space) {
  const Summary alone = with_verdict_of_both(in_free_space);
  return {alone.verdict_kind() != "UNSTABLE", alone.verdict()};
}

/// Of all boundaries that were found.
std::vector<std::optional<Decided>> what_decides(const BoundaryOptions& o, const std::vector<SceneText>& texts,
                                                 const std::vector<BoundarySearch>& found, LaneUse& use) {
  std::vector<std::optional<Decided>> decided(found.size());
  if (o.robot != nullptr) return decided;
  std::vector<Scene> scenes;
  std::vector<std::size_t> numbers;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!found[i].boundary) continue;
    scenes.push_back(in_free_space(texts[i], o, *found[i].boundary));
    numbers.push_back(i);
  }
  std::vector<const Scene*> all;
  for (const Scene& scene : scenes) all.push_back(&scene);
  use.add(run_many(all, {.lanes = o.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop},
                   [&](std::size_t i, const Summary& s) { decided[numbers[i]] = decided_by(s); }));
  return decided;
}

}  // namespace

std::optional<Decided> what_decides(const BoundaryOptions& o, const Boundary& boundary) {
  if (o.robot != nullptr) return std::nullopt;
  return decided_by(
      run(in_free_space({text_of(o), o.scene, o.set}, o, boundary), {.verdict = o.verdict, .stop = o.stop}));
}

BoundaryCurve boundary_curve(const BoundaryOptions& o, const Axis& along, const Heard& heard,
                             const std::function<void(const BoundaryCurve&)>& coarse) {
  refuse_overlap(along, o.vary.paths, "--along");
  BoundaryCurve curve{.scene = {}, .along = along, .vary = o.vary, .found = {}, .decided = {}, .use = {}};
  // A scene that is wrong is found before anything runs.
  const std::string text = text_of(o);
  std::vector<SceneText> texts;
  std::vector<Search> searches;
  for (const std::string& value : along.values) {
    BoundaryOptions at = o;
    along.append_overrides(at.set, value);
    texts.emplace_back(text, o.scene, at.set);
    searches.emplace_back(at);
    for (const double end : {o.vary.low, o.vary.high}) curve.scene = scene_at(texts.back(), o.vary, end).name;
  }

  try {
    run_all(searches, texts, o, curve.use, {}, heard, [&] {
      curve.found.clear();
      for (const Search& search : searches) curve.found.push_back(search.found());
      if (coarse) coarse(curve);
    });
    curve.decided = what_decides(o, texts, curve.found, curve.use);
  } catch (const Stopped&) {
    curve.stopped = true;
  }
  return curve;
}

Table to_table(const BoundaryCurve& curve) {
  Table table;
  table.columns = curve.along.paths;
  table.columns.insert(table.columns.end(), curve.vary.paths.begin(), curve.vary.paths.end());
  table.columns.insert(table.columns.end(), {"note", "decides"});
  for (std::size_t i = 0; i < curve.found.size(); ++i) {
    const BoundarySearch& at = curve.found[i];
    Values& row = table.rows.emplace_back(curve.along.paths.size(), Value{curve.along.values[i]});
    row.insert(row.end(), curve.vary.paths.size(), at.boundary ? Value{at.boundary->stable} : Value{});
    std::string note = at.stable_at_low ? "" : "stable from here up";
    if (!at.boundary) note = fmt::format("{} at both ends", at.stable_at_low ? "stable" : "unstable");
    if (at.disagreement) note += fmt::format(" but not at {}", *at.disagreement);
    if (at.open) note += fmt::format("{}stopped: unstable at {}", note.empty() ? "" : ", ", at.boundary->unstable);
    row.emplace_back(std::move(note));
    const bool known = !curve.decided.empty() && curve.decided[i];
    row.emplace_back(!known ? std::string{} : curve.decided[i]->by_contact ? "contact" : "free space");
  }
  return table;
}

}  // namespace twoport::lab
