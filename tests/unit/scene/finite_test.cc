#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "proto/scene.pb.h"
#include "tests/unit/scene/scenes.h"

namespace twoport::test::finite_test {
namespace {

/// The path of every floating-point number that the blocks present in `block` have room for.
void collect_numbers(const google::protobuf::Message& block, const std::string& prefix,
                     std::vector<std::string>& paths) {
  using Field = google::protobuf::FieldDescriptor;
  const auto& descriptor = *block.GetDescriptor();
  const auto& reflection = *block.GetReflection();
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const Field* field = descriptor.field(i);
    const std::string path = prefix + field->name();
    // In place of what the full scene has, and tested in tests/arm; servo in tests/method/own_hardware_test.cc.
    if (field->name().starts_with("principal_") || field->name().starts_with("joint_")) continue;
    if (const std::string name = field->name();
        name == "arm" || name == "finger" || name == "object" || name == "servo")
      continue;
    const int size = field->is_repeated() ? reflection.FieldSize(block, field) : 0;
    if (field->cpp_type() == Field::CPPTYPE_DOUBLE) {
      EXPECT_TRUE(!field->is_repeated() || size > 0) << path << " is not in the full scene";
      paths.push_back(field->is_repeated() ? path + "[0]" : path);
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE && field->is_repeated()) {
      EXPECT_GT(size, 0) << path << " is not in the full scene";
      for (int k = 0; k < size; ++k)
        collect_numbers(reflection.GetRepeatedMessage(block, field, k), path + "[" + std::to_string(k) + "].", paths);
    } else if (field->cpp_type() == Field::CPPTYPE_MESSAGE) {
      if (!field->containing_oneof()) {
        // Refused with a schedule, as the full scene has; refused_gripper_test.cc has a gripper's numbers.
        EXPECT_TRUE(reflection.HasField(block, field) || field->name() == "gripper")
            << path << " is not in the full scene";
      }
      if (reflection.HasField(block, field)) collect_numbers(reflection.GetMessage(block, field), path + ".", paths);
    }
  }
}

/// Adds the blocks of single layers.
void add_blocks_of_layers(google::protobuf::Message& of) {
  const auto& descriptor = *of.GetDescriptor();
  for (int i = 0; i < descriptor.field_count(); ++i)
    if (descriptor.field(i)->message_type() != nullptr) of.GetReflection()->MutableMessage(&of, descriptor.field(i));
}

// Also finds a number of the schema that nobody reads.
TEST(Scene, RefusesEveryNumberThatIsNotFinite) {
  schema::Scene message;
  ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(kTurning, &message));
  for (auto* of : {message.mutable_control()->mutable_schedule(0)->mutable_passivity(),
                   message.mutable_control()->mutable_passivity()})
    add_blocks_of_layers(*of);
  for (auto* of : {message.mutable_control()->mutable_schedule(0)->mutable_transparency(),
                   message.mutable_control()->mutable_transparency()})
    add_blocks_of_layers(*of);
  std::vector<std::string> paths;
  collect_numbers(message, "", paths);
  EXPECT_GT(paths.size(), 100U);
  for (const std::string& path : paths)
    for (const char* value : {"nan", "inf"}) {
      const std::string named = path.ends_with("[0]") ? path.substr(0, path.size() - 3) : path;
      EXPECT_TRUE(says(error_of(kTurning, {path + "=" + value}), {": " + named + " is ", value, "finite number"}))
          << path;
    }
}

}  // namespace
}  // namespace twoport::test::finite_test
