#include "common/scene/summary.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <system_error>

#include "common/base/check.h"
#include "proto/scene.pb.h"
#include "proto/summary.pb.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

void put(const Packets& from, schema::Packets& to) {
  const auto& [sent, received, lost, late, duplicated, rejected] = from;
  to.set_sent(sent);
  to.set_received(received);
  to.set_lost(lost);
  to.set_late(late);
  to.set_duplicated(duplicated);
  to.set_rejected(rejected);
}

void put(const Percentiles& from, schema::Percentiles& to) {
  const auto& [p50, p99, p999, max] = from;
  to.set_p50(p50);
  to.set_p99(p99);
  to.set_p999(p999);
  to.set_max(max);
}

schema::Summary to_message(const Summary& from) {
  schema::Summary to;
  to.set_scene(from.scene);
  to.set_side(from.side);
  to.set_architecture(from.architecture);
  to.set_method(from.method);
  to.set_dof(from.dof);
  to.set_rate_hz(from.rate_hz);
  to.set_duration_s(from.duration_s);
  to.set_steps(from.steps);
  to.set_stable(from.stable);
  to.set_verdict(from.verdict);
  to.set_min_port_energy_j(from.min_port_energy_j);
  to.set_initial_energy_j(from.initial_energy_j);
  to.set_min_observed_energy_j(from.min_observed_energy_j);
  to.set_energy_owed_j(from.energy_owed_j);
  to.set_dissipated_j(from.dissipated_j);
  to.set_position_error_rms_m(from.position_error_rms_m);
  to.set_drift_m(from.drift_m);
  to.set_force_error_rms_n(from.force_error_rms_n);
  to.set_force_direction_error_max_deg(from.force_direction_error_max_deg);
  to.set_force_direction_error_rms_deg(from.force_direction_error_rms_deg);
  to.set_chatter_rms_n(from.chatter_rms_n);
  to.set_max_force_n(from.max_force_n);
  to.set_contact_s(from.contact_s);
  to.set_correction_max_n(from.correction_max_n);
  to.set_corrected_ticks(from.corrected_ticks);
  put(from.to_slave, *to.mutable_packets()->mutable_to_slave());
  put(from.to_master, *to.mutable_packets()->mutable_to_master());
  put(from.rtt_ms, *to.mutable_rtt_ms());
  put(from.loop_lateness_us, *to.mutable_loop_lateness_us());
  to.set_deadline_misses(from.deadline_misses);
  to.set_step_ns(from.step_ns);
  to.set_mode(from.mode);
  to.set_reconnects(from.reconnects);
  return to;
}

void collect(const pb::Message& from, const std::string& prefix, std::vector<std::pair<std::string, double>>& into) {
  using Field = pb::FieldDescriptor;
  const pb::Descriptor& descriptor = *from.GetDescriptor();
  const pb::Reflection& reflection = *from.GetReflection();
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const Field* field = descriptor.field(i);
    const std::string name = prefix + field->name();
    switch (field->cpp_type()) {
      case Field::CPPTYPE_DOUBLE:
        into.emplace_back(name, reflection.GetDouble(from, field));
        break;
      case Field::CPPTYPE_INT32:
        into.emplace_back(name, reflection.GetInt32(from, field));
        break;
      case Field::CPPTYPE_UINT32:
        into.emplace_back(name, reflection.GetUInt32(from, field));
        break;
      case Field::CPPTYPE_BOOL:
        into.emplace_back(name, reflection.GetBool(from, field) ? 1.0 : 0.0);
        break;
      case Field::CPPTYPE_MESSAGE:
        collect(reflection.GetMessage(from, field), name + ".", into);
        break;
      case Field::CPPTYPE_STRING:
        break;
      default:
        throw ConfigError{fmt::format("summary: no rule for {} of type {}", name, field->cpp_type_name())};
    }
  }
}

}  // namespace

std::string to_string(Architecture architecture) {
  return schema::Control::Architecture_Name(static_cast<schema::Control::Architecture>(architecture));
}
std::string to_string(Method method) {
  return schema::Passivity::Method_Name(static_cast<schema::Passivity::Method>(method));
}

Packets packets(std::uint64_t sent, const PacketCounts& receiver, std::uint64_t rejected) {
  const auto count = [](std::uint64_t n) { return static_cast<std::uint32_t>(n); };
  return {.sent = count(sent),
          .received = count(receiver.received),
          .lost = count(receiver.lost),
          .late = count(receiver.late),
          .duplicated = count(receiver.duplicated),
          .rejected = count(rejected)};
}

std::string to_json(const Summary& summary) {
  pb::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.always_print_primitive_fields = true;
  options.preserve_proto_field_names = true;
  std::string json;
  const auto status = pb::util::MessageToJsonString(to_message(summary), &json, options);
  if (!status.ok()) throw ConfigError{fmt::format("summary: cannot be written as JSON: {}", status.ToString())};
  return json;
}

void write_whole(const std::string& path, const std::string& text) {
  const std::string beside = path + ".partial";
  std::FILE* file = std::fopen(beside.c_str(), "w");
  bool whole = file != nullptr && std::fwrite(text.data(), 1, text.size(), file) == text.size();
  if (file != nullptr && std::fclose(file) != 0) whole = false;
  if (whole && std::rename(beside.c_str(), path.c_str()) == 0) return;
  const int error = errno;
  if (file != nullptr) std::remove(beside.c_str());
  throw ConfigError{fmt::format("{}: cannot be written: {}", path, std::generic_category().message(error))};
}

std::vector<std::pair<std::string, double>> numbers(const Summary& summary) {
  std::vector<std::pair<std::string, double>> all;
  collect(to_message(summary), "", all);
  return all;
}

std::vector<std::pair<std::string, std::string>> words(const Summary& s) {
  return {{"scene", s.scene}, {"architecture", s.architecture}, {"method", s.method}, {"verdict", s.verdict}};
}

std::vector<std::string> broken_promises(const ExpectSpec& expect, const Summary& summary) {
  std::vector<std::string> broken;
  if (expect.stable && *expect.stable != summary.stable)
    broken.push_back(fmt::format("stable is {}, promised {}{}", summary.stable, *expect.stable,
                                 summary.verdict.empty() ? "" : ": " + summary.verdict));

  const auto all = numbers(summary);
  const auto check = [&](const Bound& bound, const char* side, double sign, const char* missed) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.first == bound.key; });
    if (found == all.end()) throw ConfigError{fmt::format("expect: no number \"{}\" in a summary", bound.key)};
    const double value = found->second;
    if (sign * value >= sign * bound.value) return;
    std::string sentence = fmt::format("{} is {:.9g}, promised {} {:.9g}", bound.key, value, side, bound.value);
    if (!std::isnan(value)) sentence += fmt::format(": {} by {:.9g}", missed, sign * (bound.value - value));
    broken.push_back(std::move(sentence));
  };
  for (const Bound& bound : expect.at_least) check(bound, "at least", 1.0, "short");
  for (const Bound& bound : expect.at_most) check(bound, "at most", -1.0, "over");
  return broken;
}

}  // namespace twoport
