#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "common/base/check.h"
#include "common/coupling/layers.h"
#include "common/record/summary.h"

namespace twoport {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

Figure::Figure(std::string name, Path path) : name_{std::move(name)}, path_{std::move(path)} {}

void Figure::add(const Descriptor& of, const std::string& prefix, const Path& path, std::vector<Figure>& all) {
  for (int i = 0; i < of.field_count(); ++i) {
    const FieldDescriptor& field = *of.field(i);
    if (field.is_repeated() || field.cpp_type() == FieldDescriptor::CPPTYPE_STRING) continue;
    Path longer = path;
    longer.push_back(&field);
    if (field.message_type()) {
      add(*field.message_type(), prefix + field.name() + ".", longer, all);
    } else {
      all.push_back(Figure{prefix + field.name(), std::move(longer)});
    }
  }
}

const std::vector<Figure>& Figure::all() {
  static const std::vector<Figure> every = [] {
    std::vector<Figure> figures;
    add(*schema::Summary::descriptor(), "", {}, figures);
    for (const LayerFigure& each : kLayerFigures)
      if (schema::Summary::descriptor()->FindFieldByName(std::string{each.name}) == nullptr)
        figures.push_back(Figure{std::string{each.name}, {}});
    return figures;
  }();
  return every;
}

const Figure* Figure::find(std::string_view name) {
  const auto found = std::find_if(all().begin(), all().end(), [&](const Figure& f) { return f.name_ == name; });
  return found == all().end() ? nullptr : &*found;
}

const Figure& Figure::named(std::string_view name) {
  if (const Figure* found = find(name)) return *found;
  throw ConfigError{"no number \"" + std::string{name} + "\" in a summary"};
}

std::optional<double> Figure::known_of(const schema::Summary& summary) const {
  if (path_.empty()) {
    const auto& means = summary.layer_figures().mean();
    const auto found = means.find(name_);
    return found == means.end() ? std::nullopt : std::optional{found->second};
  }
  const Message* of = &summary;
  for (const FieldDescriptor* field : path_) {
    const auto& reflection = *of->GetReflection();
    if (field->has_presence() && !reflection.HasField(*of, field)) return std::nullopt;
    switch (field->cpp_type()) {
      case FieldDescriptor::CPPTYPE_MESSAGE:
        of = &reflection.GetMessage(*of, field);
        break;
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return reflection.GetDouble(*of, field);
      case FieldDescriptor::CPPTYPE_INT32:
        return reflection.GetInt32(*of, field);
      case FieldDescriptor::CPPTYPE_UINT32:
        return reflection.GetUInt32(*of, field);
      case FieldDescriptor::CPPTYPE_BOOL:
        return reflection.GetBool(*of, field) ? 1.0 : 0.0;
      default:
        throw ConfigError{"summary: " + field->full_name() +
                          " is of a type without a rule here: " + field->cpp_type_name()};
    }
  }
  return std::nullopt;
}

double Figure::of(const schema::Summary& summary) const {
  return known_of(summary).value_or(std::numeric_limits<double>::quiet_NaN());
}

void set_layer_figure(schema::Summary& s, std::string_view name, double value) {
  if (const FieldDescriptor* field = schema::Summary::descriptor()->FindFieldByName(std::string{name})) {
    s.GetReflection()->SetDouble(&s, field, value);
  } else {
    (*s.mutable_layer_figures()->mutable_mean())[std::string{name}] = value;
  }
}

}  // namespace twoport
