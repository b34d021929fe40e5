#include <cstdio>
#include <memory>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/recording/hand.h"
#include "common/scene/blocks.h"
#include "common/scene/find.h"

namespace twoport {
namespace {

HandSpec read_hand(const Block<schema::Hand>& of) {
  return {
      .mass_kg = of->mass_kg(),
      .stiffness_n_per_m = of->stiffness_n_per_m(),
      .damping_n_s_per_m = of->damping_n_s_per_m(),
      .inertia_kg_m2 = of->inertia_kg_m2(),
      .rotational_stiffness_n_m_per_rad = of->rotational_stiffness_n_m_per_rad(),
      .rotational_damping_n_m_s_per_rad = of->rotational_damping_n_m_s_per_rad(),
      .force_n = numbers(of->force_n()),
  };
}

MoveToSpec read_move_to(const Block<schema::MoveTo>& of) {
  return {.position_m = pose(of->position_m()), .duration_s = of->duration_s()};
}

SineSpec read_sine(const Block<schema::Sine>& of) {
  const int axis = of->axis();
  if (axis < 0 || axis >= of.dof()) of.refuse(FIELD(axis), fmt::format("be 0 to {}", of.dof() - 1));
  return {.axis = axis,
          .amplitude_m = of->amplitude_m(),
          .frequency_hz = of->frequency_hz(),
          .duration_s = of->duration_s()};
}

ScrewSpec read_screw(const Block<schema::Screw>& of) {
  return {.point_m = numbers(of->point_m()),
          .axis = direction(of->axis()),
          .angle_rad = of->angle_rad(),
          .travel_m = of->travel_m(),
          .frequency_hz = of->frequency_hz(),
          .duration_s = of->duration_s()};
}

SegmentSpec read_segment(const Block<schema::Segment>& of) {
  if (of->has_hold()) return HoldSpec{of->hold().duration_s()};
  if (of->has_move_to()) return read_move_to(of.block(FIELD(move_to)));
  if (of->has_sine()) return read_sine(of.block(FIELD(sine)));
  if (!of->has_screw()) of.refuse_empty();
  return read_screw(of.block(FIELD(screw)));
}

TremorSpec read_tremor(const Block<schema::Tremor>& of) {
  const TremorSpec spec{.rms_m = of->rms_m(), .low_hz = of->low_hz(), .high_hz = of->high_hz()};
  if (!(spec.low_hz < spec.high_hz))
    of.refuse(FIELD(low_hz), fmt::format("be < {} ({})", of.path_of("high_hz"), spec.high_hz));
  return spec;
}

/// A relative path starts at the scene's folder. As long as the hand is there nothing can be recorded over the file.
RecordedHandSpec read_recording(const Block<schema::Operator>& of, bool of_gripper) {
  const std::string path = file_beside(of.context().file, of->recording());
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

}  // namespace

OperatorSpec read_operator(const Block<schema::Operator>& of, bool of_gripper) {
  OperatorSpec spec;
  if (of->has_hand()) spec.hand = read_hand(of.block(FIELD(hand)));
  for (const auto& each : of.blocks(FIELD(path))) spec.path.push_back(read_segment(each));
  if (of->has_recording()) spec.path = {read_recording(of, of_gripper)};
  if (of->has_tremor()) spec.tremor = read_tremor(of.block(FIELD(tremor)));
  return spec;
}

}  // namespace twoport
