#include "common/scene/reader.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cmath>

#include "common/base/check.h"
#include "common/scene/text.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

/// The value of a field as the text would hold it.
std::string text_of(const pb::Message& message, const pb::FieldDescriptor& field) {
  const bool list = field.is_repeated();
  std::vector<std::string> values(list ? static_cast<std::size_t>(message.GetReflection()->FieldSize(message, &field))
                                       : 1);
  for (std::size_t i = 0; i < values.size(); ++i)
    pb::TextFormat::PrintFieldValueToString(message, &field, list ? static_cast<int>(i) : -1, &values[i]);
  return list ? fmt::format("[{}]", fmt::join(values, ", ")) : values[0];
}

double length_of(const double* values, std::size_t count) {
  double squares = 0.0;
  for (std::size_t i = 0; i < count; ++i) squares += values[i] * values[i];
  return std::sqrt(squares);
}

}  // namespace

std::string Count::words() const {
  const std::string alone = fmt::format("hold {} number{}", few, few == 1 ? "" : "s");
  return few == many ? alone : fmt::format("{}, or {} {}", alone, many, more);
}

std::string AnyBlock::path_of(std::string_view name) const {
  return path_.empty() ? std::string{name} : fmt::format("{}.{}", path_, name);
}

void AnyBlock::fail(const std::string& words) const {
  throw ConfigError{fmt::format("{}: {}", context_.file, words)};
}

void AnyBlock::refuse_field(std::string_view name, const std::string& words) const {
  const pb::FieldDescriptor& field = *message_.GetDescriptor()->FindFieldByName(std::string{name});
  fail(fmt::format("{} is {}; it must {}", path_of(name), text_of(message_, field), words));
}

void AnyBlock::refuse_missing(std::string_view name, std::string_view words) const {
  fail(fmt::format("{} is missing; it must {}", path_of(name), words));
}

void AnyBlock::refuse_without_rotation(std::string_view name) const {
  fail(fmt::format("{} is given, but applies to dof 6 only; dof is {}", path_of(name), dof()));
}

void AnyBlock::refuse_empty() const {
  fail(fmt::format("{} is empty; it must hold one of {}", path_, field_names(*message_.GetDescriptor())));
}

double AnyBlock::checked(std::string_view name, double value, const Rule& rule) const {
  for (const Rule& each : {kFinite, rule})
    if (!each.holds(value)) refuse_field(name, each.words);
  return value;
}

Numbers AnyBlock::checked(std::string_view name, Numbers values, const Count& count) const {
  const auto length = static_cast<int>(values.size());
  if (length != 0 && length != count.few && length != count.many) refuse_field(name, count.words());
  if (!std::all_of(values.begin(), values.end(), kFinite.holds)) refuse_field(name, "hold finite numbers");
  return values;
}

Numbers normalized(Numbers values) {
  const double longest = std::abs(
      *std::max_element(values.begin(), values.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  if (longest == 0.0) return {};
  for (double& v : values) v /= longest;  // its square may exceed the range of a double
  const double length = length_of(values.data(), values.size());
  for (double& v : values) v /= length;
  return values;
}

double normalize_attitude(Numbers& pose) {
  if (pose.size() != 7) return 1.0;
  const double length = length_of(pose.data() + 3, 4);
  for (std::size_t i = 3; i < 7; ++i) pose[i] /= length;
  return length;
}

}  // namespace twoport
