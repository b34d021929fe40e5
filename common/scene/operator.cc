#include <cstdio>
#include <filesystem>
#include <memory>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/recording/hand.h"
#include "common/scene/gripper_operator.h"

namespace twoport {
namespace {

HandSpec read_hand(const Block<schema::Hand>& of) {
  of.only_with_rotation(FIELD(inertia_kg_m2), FIELD(rotational_stiffness_n_m_per_rad),
                        FIELD(rotational_damping_n_m_s_per_rad));
  return {
      .mass_kg = of.number(FIELD(mass_kg), kNotNegative),
      .stiffness_n_per_m = of.number(FIELD(stiffness_n_per_m), kNotNegative),
      .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
      .inertia_kg_m2 = of.number(FIELD(inertia_kg_m2), kNotNegative),
      .rotational_stiffness_n_m_per_rad = of.number(FIELD(rotational_stiffness_n_m_per_rad), kNotNegative),
      .rotational_damping_n_m_s_per_rad = of.number(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
      .force_n = of.list(FIELD(force_n), of.context().twist()),
  };
}

MoveToSpec read_move_to(const Block<schema::MoveTo>& of) {
  return {.position_m = pose(of, FIELD(position_m)), .duration_s = of.required(FIELD(duration_s), kSpan)};
}

SineSpec read_sine(const Block<schema::Sine>& of) {
  const int axis = of.integer(FIELD(axis));
  if (axis < 0 || axis >= of.dof()) of.refuse(FIELD(axis), fmt::format("be 0 to {}", of.dof() - 1));
  return {.axis = axis,
          .amplitude_m = of.required(FIELD(amplitude_m), kFinite),
          .frequency_hz = of.required(FIELD(frequency_hz), kPositive),
          .duration_s = of.required(FIELD(duration_s), kSpan)};
}

ScrewSpec read_screw(const Block<schema::Screw>& of) {
  return {.point_m = of.list(FIELD(point_m), of.context().point()),
          .axis = direction(of, FIELD(axis)),
          .angle_rad = of.number(FIELD(angle_rad), kFinite),
          .travel_m = of.number(FIELD(travel_m), kFinite),
          .frequency_hz = of.required(FIELD(frequency_hz), kPositive),
          .duration_s = of.required(FIELD(duration_s), kSpan)};
}

SegmentSpec read_segment(const Block<schema::Segment>& of) {
  if (of.has(FIELD(hold))) return HoldSpec{of.block(FIELD(hold)).required(FIELD(duration_s), kSpan)};
  if (of.has(FIELD(move_to))) return read_move_to(of.block(FIELD(move_to)));
  if (of.has(FIELD(sine))) return read_sine(of.block(FIELD(sine)));
  if (!of.has(FIELD(screw))) of.refuse_empty();
  if (of.dof() == 1) of.fail(fmt::format("{} is given, but dof is 1; a screw needs dof 3 or 6", of.path_of("screw")));
  return read_screw(of.block(FIELD(screw)));
}

TremorSpec read_tremor(const Block<schema::Tremor>& of) {
  const TremorSpec spec{.rms_m = of.required(FIELD(rms_m), kNotNegative),
                        .low_hz = of.number(FIELD(low_hz), kNotNegative),
                        .high_hz = of.number(FIELD(high_hz), kRate)};
  if (!(spec.low_hz < spec.high_hz))
    of.refuse(FIELD(low_hz), fmt::format("be < {} ({})", of.path_of("high_hz"), spec.high_hz));
  return spec;
}

/// A relative path starts at the scene's folder. As long as the hand is there nothing can be recorded over the file.
RecordedHandSpec read_recording(const Block<schema::Operator>& of, bool of_gripper) {
  const std::filesystem::path folder = std::filesystem::path{of.context().file}.parent_path();
  const std::string path = (folder / of.text(FIELD(recording))).string();
  RecordedHand read;
  try {
    read = read_recorded_hand(path, of_gripper);
  } catch (const ConfigError& e) {
    of.fail(fmt::format("{}: {}", of.path_of("recording"), e.what()));
  }
  if (read.dof != of.dof()) of.refuse(FIELD(recording), fmt::format("be of dof {}, and is of {}", of.dof(), read.dof));
  const double end_s = read.t_s.back();
  std::shared_ptr<std::FILE> file{std::fopen(path.c_str(), "rb"), [](std::FILE* f) {
                                    if (f != nullptr) std::fclose(f);
                                  }};
  if (file) take_shared(file.get());
  return {{new RecordedHand{std::move(read)}, [file](const RecordedHand* hand) { delete hand; }}, end_s};
}

OperatorSpec read_whole_operator(const Block<schema::Operator>& of, bool of_gripper) {
  OperatorSpec spec;
  if (of.has(FIELD(hand))) spec.hand = read_hand(of.block(FIELD(hand)));
  for (const auto& each : of.blocks(FIELD(path))) spec.path.push_back(read_segment(each));
  if (of.has(FIELD(recording))) spec.path = {read_recording(of, of_gripper)};
  if (of.has(FIELD(tremor))) spec.tremor = read_tremor(of.block(FIELD(tremor)));
  return spec;
}

}  // namespace

OperatorSpec read_operator(const Block<schema::Operator>& of) {
  return read_whole_operator(of, false);
}
OperatorSpec read_gripper_operator(const Block<schema::Operator>& of) {
  return read_whole_operator(of, true);
}

}  // namespace twoport
