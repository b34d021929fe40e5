#include "common/record/summary.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/scene/load.h"
#include "common/scene/scene.h"
#include "tests/support/known_numbers.h"

namespace twoport::summary_test {
namespace {

namespace pb = google::protobuf;

/// Every field different from every other, and from zero.
void fill(pb::Message& m, double& next) {
  using Field = pb::FieldDescriptor;
  const pb::Reflection& r = *m.GetReflection();
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
    const Field* field = m.GetDescriptor()->field(i);
    next += 1.0;
    switch (field->cpp_type()) {
      case Field::CPPTYPE_DOUBLE:
        r.SetDouble(&m, field, -next / 3.0);
        break;
      case Field::CPPTYPE_INT32:
        r.SetInt32(&m, field, static_cast<std::int32_t>(next));
        break;
      case Field::CPPTYPE_UINT32:
        r.SetUInt32(&m, field, 4000000000U + static_cast<std::uint32_t>(next));
        break;
      case Field::CPPTYPE_BOOL:
        r.SetBool(&m, field, true);
        break;
      case Field::CPPTYPE_STRING:
        r.SetString(&m, field, "a \"wall\"\nof " + field->name());
        break;
      case Field::CPPTYPE_MESSAGE:
        if (field->is_repeated()) break;  // a map: not among the numbers
        fill(*r.MutableMessage(&m, field), next);
        break;
      default:
        ADD_FAILURE() << field->full_name() << " is of a type without a rule";
    }
  }
}
Summary full_summary() {
  Summary s;
  double next = 0.0;
  fill(s, next);
  return s;
}

Summary described() {
  Summary s;
  describe_run(parse_scene("name: \"a wall\" dof: 3 duration_s: 1 control { passivity { method: CLASSIC } }", "x"),
               "lab", s);
  return s;
}

Summary from_json(const std::string& json) {
  Summary summary;
  const auto status = pb::util::JsonStringToMessage(json, &summary);
  EXPECT_TRUE(status.ok()) << status.ToString() << "\n" << json;
  return summary;
}

TEST(SummaryJson, ComesBackAsItWas) {
  const Summary s = full_summary();
  EXPECT_TRUE(pb::util::MessageDifferencer::Equals(from_json(to_json(s)), s)) << to_json(s);
}

TEST(SummaryJson, PrintsZerosAndFalsesOfWhatIsKnownUnderTheSchemasNames) {
  Summary s = described();
  s.set_stable(false);
  s.set_min_port_energy_j(0.0);
  s.mutable_packets()->mutable_to_slave()->set_rejected(0);
  s.mutable_rtt_ms();
  const std::string json = to_json(s);
  for (const char* said : {"\"scene\": \"a wall\"", "\"method\": \"CLASSIC\"", "\"dof\": 3", "\"stable\": false",
                           "\"min_port_energy_j\": 0", "\"verdict\": \"\"", "\"dissipated_j\": 0", "\"to_slave\": {",
                           "\"rejected\": 0", "\"rtt_ms\": {", "\"p999\": 0"})
    EXPECT_NE(json.find(said), std::string::npos) << said << " is not in " << json;
}

TEST(SummaryJson, LeavesOutWhatIsNotKnown) {
  const std::string json = to_json(described());
  for (const char* name : {"stable", "min_port_energy_j", "felt_force_error_rms_n", "muted_share", "packets", "rtt_ms",
                           "loop_lateness_us", "deadline_misses", "mode"})
    EXPECT_EQ(json.find(std::string{"\""}.append(name).append("\"")), std::string::npos) << name << " is in " << json;
}

TEST(SummaryNumbers, AreNoneWhereTheyAreNotKnown) {
  Summary s = described();
  s.mutable_packets()->mutable_to_master()->set_lost(0);
  for (const auto& [name, value] : known_numbers(s))
    EXPECT_EQ(value.has_value(), name == "dof" || name == "rate_hz" || name == "duration_s" || name == "steps" ||
                                     name == "dissipated_j" || name == "corrected_ticks" || name == "step_ns" ||
                                     name == "packets.to_master.lost")
        << name;
}

TEST(SummaryJson, WhatIsNotFiniteSurvives) {
  Summary s;
  s.set_drift_m(std::numeric_limits<double>::quiet_NaN());
  s.set_max_force_n(std::numeric_limits<double>::infinity());
  s.set_min_port_energy_j(-std::numeric_limits<double>::infinity());
  const Summary back = from_json(to_json(s));
  EXPECT_TRUE(std::isnan(back.drift_m()));
  EXPECT_EQ(back.max_force_n(), s.max_force_n());
  EXPECT_EQ(back.min_port_energy_j(), s.min_port_energy_j());
}

TEST(SummaryPackets, HoldWhatTheReceiverCountedAndNoLessThanThat) {
  const PacketCounts receiver{
      .sent = 9, .received = 1, .lost = 2, .late = 3, .duplicated = 5'000'000'000, .rejected = 40};
  const Packets all = received_packets(receiver, {.flood = 2, .malformed = 3});
  EXPECT_EQ(all.received(), 1U);
  EXPECT_EQ(all.lost(), 2U);
  EXPECT_EQ(all.late(), 3U);
  EXPECT_EQ(all.duplicated(), 4'294'967'295U);  // the largest that it can say
  EXPECT_EQ(all.rejected(), 45U);
  const std::map<std::string, std::uint32_t> by{all.rejected_by().begin(), all.rejected_by().end()};
  EXPECT_EQ(by, (std::map<std::string, std::uint32_t>{{"flood", 2}, {"malformed", 3}, {"sequence", 40}}));
}

TEST(SummaryMethod, IsTheOneThatTheNodesLookUp) {
  Scene scene = parse_scene("dof: 1 duration_s: 1", "x");
  scene.control.method_name = "OF_MY_OWN";
  Summary s;
  describe_run(scene, "lab", s);
  EXPECT_EQ(s.method(), "OF_MY_OWN");
}

TEST(SummaryNumbers, AreInTheSchemasOrderWithDottedNames) {
  const auto all = numbers(full_summary());
  std::vector<std::string> names;
  for (const auto& [name, value] : all) names.push_back(name);
  const std::vector<std::string> first(names.begin(), names.begin() + 6);
  EXPECT_EQ(first, (std::vector<std::string>{"dof", "rate_hz", "duration_s", "steps", "stable", "min_port_energy_j"}));
  const auto place = [&](const char* name) { return std::find(names.begin(), names.end(), name) - names.begin(); };
  EXPECT_LT(place("chatter_rms_n"), place("packets.to_slave.sent"));
  EXPECT_LT(place("packets.to_slave.rejected"), place("packets.to_master.sent"));
  EXPECT_LT(place("packets.to_master.rejected"), place("rtt_ms.p50"));
  EXPECT_LT(place("rtt_ms.max"), place("deadline_misses"));
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
}

TEST(SummaryNumbers, HaveTheFieldsValues) {
  const Summary s = full_summary();
  const auto all = numbers(s);
  const auto value = [&](const char* name) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.first == name; });
    return found == all.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
  };
  EXPECT_EQ(value("dof"), s.dof());
  EXPECT_EQ(value("stable"), 1.0);
  EXPECT_EQ(value("steps"), s.steps());
  EXPECT_EQ(value("drift_m"), s.drift_m());
  EXPECT_EQ(value("packets.to_master.lost"), s.packets().to_master().lost());
  EXPECT_EQ(value("rtt_ms.p99"), s.rtt_ms().p99());
  for (const auto& [name, number] : all) EXPECT_TRUE(number != 0.0) << name;
}

TEST(SummaryNames, AreThoseOfTheScene) {
  EXPECT_EQ(to_string(Architecture::render), "RENDER");
  EXPECT_EQ(to_string(Architecture::position_measured_force), "POSITION_MEASURED_FORCE");
}

}  // namespace
}  // namespace twoport::summary_test
