#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <bit>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/coupling/claim.h"
#include "common/scene/source.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;
using Field = pb::FieldDescriptor;

/// FNV-1a, 64 bits, over bytes in a fixed order, so that it is the same on every machine.
class Digest {
 public:
  void add(std::uint64_t bits) {
    for (int byte = 0; byte < 8; ++byte) value_ = (value_ ^ ((bits >> (8 * byte)) & 0xff)) * 0x100000001b3;
  }
  /// The field's value; all of a block.
  void add(const pb::Message& message, const Field& field) {
    const pb::Reflection& r = *message.GetReflection();
    if (field.is_repeated()) {
      const int size = r.FieldSize(message, &field);
      add(static_cast<std::uint64_t>(size));
      for (int i = 0; i < size; ++i) add(r.GetRepeatedDouble(message, &field, i));
    } else if (const pb::Descriptor* const block = field.message_type()) {
      for (int i = 0; i < block->field_count(); ++i) add(r.GetMessage(message, &field), *block->field(i));
    } else if (!r.HasField(message, &field) && !field.has_default_value()) {
      add(~std::uint64_t{0});  // differs from every value
    } else if (field.cpp_type() == Field::CPPTYPE_DOUBLE) {
      add(r.GetDouble(message, &field));
    } else if (field.cpp_type() == Field::CPPTYPE_BOOL) {
      add(static_cast<std::uint64_t>(r.GetBool(message, &field)));
    } else if (field.cpp_type() == Field::CPPTYPE_ENUM) {
      add(static_cast<std::uint64_t>(r.GetEnumValue(message, &field)));
    } else {
      add(static_cast<std::uint64_t>(r.GetInt32(message, &field)));
    }
  }
  [[nodiscard]] std::uint64_t value() const { return value_; }

 private:
  void add(double number) { add(std::bit_cast<std::uint64_t>(number + 0.0)); }  // -0 is 0
  std::uint64_t value_ = 0xcbf29ce484222325;
};

/// A field with option shared, and the way to it.
struct Shared {
  std::string path;
  std::vector<const Field*> within;  ///< the blocks, outermost first
  const Field* field;

  [[nodiscard]] std::uint64_t digest(const pb::Message& whole) const {
    const pb::Message* block = &whole;
    for (const Field* each : within) block = &block->GetReflection()->GetMessage(*block, each);
    Digest one;
    one.add(*block, *field);
    return one.value();
  }
};
void find_shared(const pb::Descriptor& block, const Shared& at, std::vector<Shared>& all) {
  for (int i = 0; i < block.field_count(); ++i) {
    Shared each{at.path + block.field(i)->name(), at.within, block.field(i)};
    if (each.field->options().GetExtension(schema::shared)) {
      all.push_back(std::move(each));
    } else if (each.field->message_type() && !each.field->is_repeated() &&
               each.field->message_type() != schema::Gripper::descriptor()) {
      each.path += '.';
      each.within.push_back(each.field);
      find_shared(*each.field->message_type(), each, all);
    }
  }
}
std::vector<Shared> find_shared(const pb::Descriptor& block) {
  std::vector<Shared> all;
  find_shared(block, {}, all);
  return all;
}

/// The values that hold where the text states none.
void complete(schema::Control& stated, const ControlOptions& control) {
  schema::Passivity& passivity = *stated.mutable_passivity();
  schema::Passivity::Method method{};
  // A pair that has a name is that method, whichever was stated.
  if (schema::Passivity::Method_Parse(control.method_name, &method)) {
    passivity.set_method(method);
    passivity.clear_layer();
    stated.mutable_transparency()->clear_layer();
  } else {
    schema::Transparency::Layer transparency{};
    schema::PassivityLayer::Name layer{};
    schema::Transparency::Layer_Parse(control.transparency, &transparency);
    schema::PassivityLayer::Name_Parse(control.passivity, &layer);
    stated.mutable_transparency()->set_layer(transparency);
    passivity.set_layer(layer);
  }
  passivity.set_accounts(static_cast<schema::Passivity::Accounts>(control.accounts));
  passivity.clear_initial_energy_j();
  if (!account_is_of_master(control)) passivity.set_initial_energy_j(control.initial_energy.si());
}

std::uint64_t digest_of(const std::vector<SharedField>& fields) {
  Digest all;
  for (const SharedField& each : fields) all.add(each.digest);
  return all.value();
}

std::vector<SharedField> fields_of(const schema::Scene& message) {
  static const std::vector<Shared> shared = find_shared(*schema::Scene::descriptor());
  std::vector<SharedField> fields;
  for (const Shared& each : shared) fields.push_back({each.path, each.digest(message)});
  return fields;
}

/// Of a gripper's coupling; method and rates are the scene's.
std::uint64_t gripper_digest(const schema::Gripper& stated, const Scene& gripper) {
  static const std::vector<Shared> shared = find_shared(*schema::Gripper::descriptor());
  schema::Gripper message = stated;
  message.clear_initial_energy_j();
  if (!account_is_of_master(gripper.control)) message.set_initial_energy_j(gripper.control.initial_energy.si());
  Digest all;
  for (const Shared& each : shared) all.add(each.digest(message));
  return all.value();
}

}  // namespace

std::uint64_t scene_digest(const Scene& scene) {
  return digest_of(shared_fields(scene));
}

std::vector<SharedField> shared_fields(const Scene& scene) {
  schema::Scene message = scene.source ? scene.source->message : schema::Scene{};
  message.set_dof(scene.coordinates());
  message.set_master_rate_hz(scene.master_rate_hz);
  message.set_slave_rate_hz(scene.slave_rate_hz);
  const std::vector<schema::Control> then = scheduled(message.control());
  complete(*message.mutable_control(), scene.control);
  std::vector<SharedField> fields = fields_of(message);
  // What is switched to, each as a scene of its own; when is the master's own.
  Digest switches;
  for (std::size_t i = 0; i < then.size(); ++i) {
    *message.mutable_control() = then[i];
    complete(*message.mutable_control(), scene.schedule[i].control);
    switches.add(digest_of(fields_of(message)));
  }
  fields.push_back({"control.schedule", switches.value()});
  Digest metric;
  for (const double each : scene.control.joint_scale) metric.add(std::bit_cast<std::uint64_t>(each));
  if (scene.joints > 0) fields.push_back({"space: the follower's joints", metric.value()});
  fields.push_back({"gripper", scene.gripper ? gripper_digest(message.gripper(), *scene.gripper) : 0});
  return fields;
}

}  // namespace twoport
