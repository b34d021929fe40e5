#include "common/record/summary.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <system_error>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/coupling/layers.h"
#include "common/scene/hints.h"
#include "common/scene/source.h"

namespace twoport {

namespace pb = google::protobuf;

void describe_run(const Scene& scene, std::string_view side, Summary& s) {
  s.set_scene(scene.name);
  s.set_side(std::string{side});
  // One that is named as a transparency layer is read as POSITION_FORCE with that layer.
  std::string named =
      scene.source ? schema::Control::Architecture_Name(scene.source->message.control().architecture()) : std::string{};
  const bool of_layer = find_name(kTransparencyLayers, named) != nullptr;
  s.set_architecture(of_layer ? std::move(named) : to_string(scene.control.architecture));
  s.set_method(scene.control.method_name);
  s.set_dof(scene.coordinates());
  if (std::string claim = claim_that_holds(scene); !claim.empty()) s.set_claim(std::move(claim));
}

std::uint32_t count(std::uint64_t n) {
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(n, std::numeric_limits<std::uint32_t>::max()));
}

void set_verdict(const Verdict& verdict, Summary& s) {
  s.set_stable(verdict.stable());
  s.set_verdict(verdict.text);
  s.set_verdict_kind(std::string{to_string(verdict.kind)});
}

Packets received_packets(const PacketCounts& receiver, Rejected rejected) {
  rejected.sequence += receiver.rejected;
  Packets all;
  all.set_received(count(receiver.received));
  all.set_lost(count(receiver.lost));
  all.set_late(count(receiver.late));
  all.set_duplicated(count(receiver.duplicated));
  all.set_rejected(count(rejected.total()));
  all.set_stale(count(receiver.stale));
  rejected.each([&](const char* reason, std::uint64_t n) {
    if (n > 0) (*all.mutable_rejected_by())[reason] = count(n);
  });
  return all;
}

schema::LimitsOfPort limits_of_device(const LimitCounts& counts) {
  schema::LimitsOfPort port;
  port.set_force(counts[Limit::force]);
  port.set_force_rate(counts[Limit::force_rate]);
  port.set_power(counts[Limit::power]);
  port.set_speed(counts[Limit::speed]);
  port.set_workspace(counts[Limit::workspace]);
  port.set_pause(counts[Limit::pause]);
  return port;
}
schema::LimitsOfPort limits_of_robot(const LimitCounts& counts) {
  schema::LimitsOfPort port = limits_of_device(counts);
  port.set_set_point_step(counts[Limit::set_point_step]);
  return port;
}
schema::LimitsOfPeer limits_of_peer(const LimitCounts& counts) {
  schema::LimitsOfPeer peer;
  peer.set_motion(counts[Limit::peer_motion]);
  peer.set_force(counts[Limit::peer_force]);
  peer.set_energy(counts[Limit::peer_energy]);
  return peer;
}
schema::ClockEstimate clock_estimate(const ClockFigures& clock) {
  schema::ClockEstimate estimate;
  estimate.set_offset_ms(1e3 * clock.offset_s);
  estimate.set_bound_ms(1e3 * clock.bound_s);
  estimate.set_drift_ppm(1e6 * clock.drift);
  estimate.set_one_way_ms(1e3 * clock.one_way_s);
  if (clock.error_s) estimate.set_error_ms(1e3 * *clock.error_s);
  return estimate;
}

void say_if_coupling_feeds(Summary& s, Energy granted) {
  constexpr double kRounding = 1e-5;  // [J]
  if (s.robot_min_energy_j() < -(granted.si() + kRounding))
    s.mutable_verdict()->append(
        fmt::format("; the sampled coupling has fed the robot {:.3g} J", -s.robot_min_energy_j()));
}

void fill_gripper(const Summary& gripper, Summary& summary) {
  // Fields of the same number are the same figure; the test of the schema says so.
  schema::GripperFigures& figures = *summary.mutable_gripper();
  figures.ParsePartialFromString(gripper.SerializePartialAsString());
  figures.DiscardUnknownFields();
}

std::string to_json(const Summary& summary) {
  pb::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto status = pb::util::MessageToJsonString(summary, &json, options);
  if (!status.ok()) throw ConfigError{"summary: cannot be written as JSON: " + status.ToString()};
  return json;
}

void leave_summary(const Summary& summary, const std::string& folder) {
  const std::string json = to_json(summary);
  if (folder.empty()) {
    if (std::fputs(json.c_str(), stdout) < 0 || std::fflush(stdout) != 0)
      throw IoError{"the summary cannot be written to stdout: " + std::generic_category().message(errno)};
    return;
  }
  try {
    write_whole(folder + "/summary.json", json);
  } catch (const std::exception&) {
    std::fputs(json.c_str(), stdout);
    throw;
  }
}

std::vector<std::pair<std::string, double>> numbers(const Summary& summary) {
  std::vector<std::pair<std::string, double>> all;
  for (const Figure& figure : Figure::all()) all.emplace_back(figure.name(), figure.of(summary));
  return all;
}

std::vector<std::pair<std::string, std::string>> texts(const Summary& s) {
  return {{"scene", s.scene()},
          {"architecture", s.architecture()},
          {"method", s.method()},
          {"verdict_kind", s.verdict_kind()},
          {"verdict", s.verdict()}};
}

std::vector<std::string> violations(const ExpectSpec& expect, const Summary& summary) {
  std::vector<std::string> found;
  const bool undecided = summary.verdict_kind() == to_string(VerdictKind::undecided);
  // A scene that expects nothing does not expect this.
  if (undecided && summary.has_coupled_at_end() && !summary.coupled_at_end())
    found.push_back(summary.verdict());
  else if (expect.stable && !summary.has_stable())
    found.push_back(fmt::format("stable is not known of this run, expected {}", *expect.stable));
  else if (expect.stable && undecided)
    found.push_back(fmt::format("stable is undecided, expected {}: {}", *expect.stable, summary.verdict()));
  else if (expect.stable && *expect.stable != summary.stable())
    found.push_back(fmt::format("stable is {}, expected {}{}", summary.stable(), *expect.stable,
                                summary.verdict().empty() ? "" : ": " + summary.verdict()));
  if (expect.stable == true && summary.gripper().has_stable() && !summary.gripper().stable())
    found.push_back(fmt::format("gripper.stable is false, expected stable true: {}", summary.gripper().verdict()));

  for (const MethodVerdict& each : expect.of_method)
    if (each.method == summary.method() && each.verdict_kind != summary.verdict_kind())
      found.push_back(fmt::format("verdict_kind with {} is {}, expected {}: {}", each.method, summary.verdict_kind(),
                                  each.verdict_kind, summary.verdict()));

  const auto check = [&](const Bound& bound, const char* side, double sign, const char* missed) {
    const Figure* const figure = Figure::find(bound.key);
    if (figure == nullptr) throw ConfigError{fmt::format("expect: no number \"{}\" in a summary", bound.key)};
    const std::optional<double> known = figure->known_of(summary);
    if (!known) {
      found.push_back(fmt::format("{} is not known of this run, expected {} {:.9g}", bound.key, side, bound.value));
      return;
    }
    const double value = *known;
    if (sign * value >= sign * bound.value) return;
    std::string sentence = fmt::format("{} is {:.9g}, expected {} {:.9g}", bound.key, value, side, bound.value);
    if (!std::isnan(value)) sentence += fmt::format(": {} by {:.9g}", missed, sign * (bound.value - value));
    found.push_back(std::move(sentence));
  };
  for (const Bound& bound : expect.at_least) check(bound, "at least", 1.0, "short");
  for (const Bound& bound : expect.at_most) check(bound, "at most", -1.0, "over");
  return found;
}

}  // namespace twoport
