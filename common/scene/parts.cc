#include "common/scene/parts.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <memory>

#include "common/scene/source.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;
using Field = pb::FieldDescriptor;

/// Is there something to leave out? A list of numbers that are all zero, or a default, is nothing.
bool says_something(const pb::Message& block, const Field& field) {
  const pb::Reflection& r = *block.GetReflection();
  if (field.is_repeated()) {
    for (int i = 0; i < r.FieldSize(block, &field); ++i)
      if (r.GetRepeatedDouble(block, &field, i) != 0.0) return true;
    return false;
  }
  if (!r.HasField(block, &field)) return false;
  if (field.cpp_type() == Field::CPPTYPE_DOUBLE) return r.GetDouble(block, &field) != field.default_value_double();
  if (field.cpp_type() == Field::CPPTYPE_ENUM) return r.GetEnum(block, &field) != field.default_value_enum();
  return true;
}

/// "environment[0]" is the wall there.
std::string kind_of(const pb::Message& element) {
  const pb::Descriptor& block = *element.GetDescriptor();
  const Field* const kind = block.oneof_decl_count() == 0
                                ? nullptr
                                : element.GetReflection()->GetOneofFieldDescriptor(element, block.oneof_decl(0));
  return kind ? "." + kind->name() : "";
}

void find_parts(const pb::Message& block, const ScenePart& at, std::vector<ScenePart>& all) {
  const pb::Reflection& r = *block.GetReflection();
  for (int i = 0; i < block.GetDescriptor()->field_count(); ++i) {
    const Field& field = *block.GetDescriptor()->field(i);
    const bool removable = field.options().GetExtension(schema::removable), holds_blocks = field.message_type();
    const auto add = [&](const pb::Message* inner, int element, const std::string& name, const std::string& kind) {
      ScenePart part{at.path + name + kind, at.way};
      part.way.emplace_back(i, element);
      if (removable) all.push_back(part);
      part.path = at.path + name + ".";
      if (inner != nullptr) find_parts(*inner, part, all);
    };
    if (field.message_type() == schema::Gripper::descriptor()) continue;
    if (field.is_repeated() && holds_blocks) {
      for (int k = 0; k < r.FieldSize(block, &field); ++k) {
        const pb::Message& inner = r.GetRepeatedMessage(block, &field, k);
        add(&inner, k, fmt::format("{}[{}]", field.name(), k), kind_of(inner));
      }
    } else if (holds_blocks ? r.HasField(block, &field) : removable && says_something(block, field)) {
      add(holds_blocks ? &r.GetMessage(block, &field) : nullptr, -1, field.name(), "");
    }
  }
}

/// Of what stands in `block`; `at`: its path, with a dot.
std::string field_beyond(const pb::Message& block, const std::string& at, const std::set<std::string>& names) {
  const pb::Reflection& r = *block.GetReflection();
  std::vector<const Field*> given;
  r.ListFields(block, &given);
  for (const Field* const field : given) {
    std::string path = at + field->name();
    if (names.contains(path)) continue;
    const auto within = names.lower_bound(path + ".");
    if (field->message_type() == nullptr || within == names.end() || !within->starts_with(path + ".")) return path;
    for (int i = 0; i < (field->is_repeated() ? r.FieldSize(block, field) : 1); ++i) {
      const bool list = field->is_repeated();
      const pb::Message& inner = list ? r.GetRepeatedMessage(block, field, i) : r.GetMessage(block, field);
      if (std::string found = field_beyond(inner, path + ".", names); !found.empty()) return found;
    }
  }
  return {};
}

void remove(pb::Message& whole, const ScenePart& part) {
  pb::Message* block = &whole;
  for (std::size_t i = 0; i < part.way.size(); ++i) {
    const pb::Reflection& r = *block->GetReflection();
    const auto [number, element] = part.way[i];
    const Field* const field = block->GetDescriptor()->field(number);
    if (i + 1 < part.way.size()) {
      block = element < 0 ? r.MutableMessage(block, field) : r.MutableRepeatedMessage(block, field, element);
    } else if (element < 0) {
      r.ClearField(block, field);
    } else {
      for (int k = element; k + 1 < r.FieldSize(*block, field); ++k) r.SwapElements(block, field, k, k + 1);
      r.RemoveLast(block, field);
    }
  }
}

}  // namespace

std::string field_beyond(const Scene& scene, const std::set<std::string>& names) {
  return field_beyond(scene.source->message, "", names);
}

std::vector<ScenePart> removable_parts(const Scene& scene) {
  std::vector<ScenePart> all;
  find_parts(scene.source->message, {}, all);
  return all;
}

Scene without(const Scene& scene, const std::vector<ScenePart>& parts) {
  const auto source = std::make_shared<SceneSource>(*scene.source);
  // From the last: what a block holds before the block, and no index moves before its turn.
  for (auto part = parts.rbegin(); part != parts.rend(); ++part) remove(source->message, *part);
  Scene rest = read_scene(source);
  rest.duration_s = scene.duration_s;
  rest.expect = scene.expect;
  return rest;
}

}  // namespace twoport
