#include <google/protobuf/descriptor.h>

#include <algorithm>

#include "common/base/text.h"
#include "common/scene/blocks.h"
#include "proto/summary.pb.h"

namespace twoport {
namespace {

/// The numbers of a summary, nested ones with dots.
void add_number_names(const google::protobuf::Descriptor& block, const std::string& prefix,
                      std::vector<std::string>& names) {
  using Field = google::protobuf::FieldDescriptor;
  for (int i = 0; i < block.field_count(); ++i) {
    const Field& field = *block.field(i);
    if (field.message_type())
      add_number_names(*field.message_type(), prefix + field.name() + ".", names);
    else if (field.cpp_type() != Field::CPPTYPE_STRING)
      names.push_back(prefix + field.name());
  }
}

/// Those that a bound may name.
std::vector<std::string> number_names() {
  std::vector<std::string> names;
  add_number_names(*schema::Summary::descriptor(), "", names);
  std::erase(names, "stable");
  return names;
}

std::vector<Bound> read_bounds(const std::vector<Block<schema::Bound>>& blocks) {
  static const std::vector<std::string> known = number_names();
  std::vector<Bound> bounds;
  for (const auto& of : blocks) {
    const std::string key = of->key();
    if (key == "stable") of.refuse(FIELD(key), "be a number of the summary; `expect { stable: ... }` is for that one");
    if (std::find(known.begin(), known.end(), key) == known.end())
      of.refuse(FIELD(key), fmt::format("be a number of the summary; the nearest are {}",
                                        fmt::join(nearest_names(key, known, 3), ", ")));
    bounds.push_back({key, of->value()});
  }
  return bounds;
}

}  // namespace

ExpectSpec read_expect(const Block<schema::Expect>& of) {
  ExpectSpec spec;
  if (of->has_stable()) spec.stable = of->stable();
  spec.at_least = read_bounds(of.blocks(FIELD(at_least)));
  spec.at_most = read_bounds(of.blocks(FIELD(at_most)));
  for (const auto& each : of.blocks(FIELD(of_method))) {
    if (!each->has_method() || !each->has_verdict()) each.fail("expect.of_method needs a method and a verdict");
    spec.of_method.push_back(
        {schema::Passivity::Method_Name(each->method()), schema::MethodVerdict::Verdict_Name(each->verdict())});
  }
  return spec;
}

}  // namespace twoport
