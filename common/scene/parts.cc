#include "common/scene/parts.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <memory>

#include "common/scene/source.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;
using Field = pb::FieldDescriptor;

/// Is the field given, with another value than its default? A list is if it holds anything.
bool differs_from_default(const pb::Message& block, const Field& field) {
  const pb::Reflection& r = *block.GetReflection();
  if (field.is_repeated()) return r.FieldSize(block, &field) > 0;
  if (!r.HasField(block, &field)) return false;
  if (!field.has_default_value()) return true;
  switch (field.cpp_type()) {
    case Field::CPPTYPE_DOUBLE:
      return r.GetDouble(block, &field) != field.default_value_double();
    case Field::CPPTYPE_BOOL:
      return r.GetBool(block, &field) != field.default_value_bool();
    case Field::CPPTYPE_INT32:
      return r.GetInt32(block, &field) != field.default_value_int32();
    case Field::CPPTYPE_ENUM:
      return r.GetEnum(block, &field) != field.default_value_enum();
    default:
      return true;
  }
}

/// Is there something to leave out? A list of numbers that are all zero, or a default, is nothing.
bool says_something(const pb::Message& block, const Field& field) {
  if (!field.is_repeated()) return differs_from_default(block, field);
  const pb::Reflection& r = *block.GetReflection();
  for (int i = 0; i < r.FieldSize(block, &field); ++i)
    if (r.GetRepeatedDouble(block, &field, i) != 0.0) return true;
  return false;
}

/// Do the names have one that begins so?
bool has_beginning(std::span<const std::string> names, const std::string& with) {
  const auto at = std::lower_bound(names.begin(), names.end(), with);
  return at != names.end() && at->starts_with(with);
}

/// `path` is the block's, with a dot; afterwards that of the field that was found, if one was.
bool find_field_beyond(const pb::Message& block, std::span<const std::string> names, std::string& path) {
  const pb::Reflection& r = *block.GetReflection();
  std::vector<const Field*> given;
  r.ListFields(block, &given);
  const std::size_t length = path.size();
  for (const Field* const field : given) {
    path.resize(length);
    path += field->name();
    if (std::binary_search(names.begin(), names.end(), path) || !differs_from_default(block, *field)) continue;
    if (field->message_type() == nullptr) return true;
    path += '.';
    if (!has_beginning(names, path)) {
      path.pop_back();
      return true;
    }
    const std::size_t within = path.size();
    for (int i = 0; i < (field->is_repeated() ? r.FieldSize(block, field) : 1); ++i) {
      path.resize(within);
      const pb::Message& inner =
          field->is_repeated() ? r.GetRepeatedMessage(block, field, i) : r.GetMessage(block, field);
      if (find_field_beyond(inner, names, path)) return true;
    }
  }
  return false;
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

std::string field_beyond(const Scene& scene, std::span<const std::string> names) {
  std::string path;
  return find_field_beyond(scene.source->message, names, path) ? path : "";
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
