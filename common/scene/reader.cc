#include "common/scene/reader.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/reflection.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>

#include "common/base/check.h"
#include "common/scene/text.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;
using Descriptor = pb::FieldDescriptor;

/// The value of a field as the text would hold it.
std::string text_of(const pb::Message& message, const Descriptor& field) {
  const bool list = field.is_repeated();
  std::vector<std::string> values(list ? static_cast<std::size_t>(message.GetReflection()->FieldSize(message, &field))
                                       : 1);
  for (std::size_t i = 0; i < values.size(); ++i)
    pb::TextFormat::PrintFieldValueToString(message, &field, list ? static_cast<int>(i) : -1, &values[i]);
  return list ? fmt::format("[{}]", fmt::join(values, ", ")) : values[0];
}

/// How many values it has; of no list one where it is given. `reflection` is the message's, which is slow to ask for.
int size_of(const pb::Reflection& reflection, const pb::Message& message, const Descriptor& field) {
  return field.is_repeated() ? reflection.FieldSize(message, &field) : reflection.HasField(message, &field) ? 1 : 0;
}

double length_of(const Numbers& values, std::size_t from) {
  double squares = 0.0;
  for (std::size_t i = from; i < values.size(); ++i) squares += values[i] * values[i];
  return std::sqrt(squares);
}

/// Allowed lengths of a list.
struct Lengths {
  int few, many;
  const char* more;

  [[nodiscard]] bool allow(int length) const { return length == few || length == many; }
  [[nodiscard]] std::string words() const {
    const std::string alone = fmt::format("hold {} number{}", few, few == 1 ? "" : "s");
    return few == many ? alone : fmt::format("{}, or {} {}", alone, many, more);
  }
};
Lengths lengths_of(schema::List kind, int dof) {
  const int axes = dof == 1 ? 1 : 3;
  switch (kind) {
    case schema::POSE:
      return {axes, dof == 6 ? 7 : axes, "with the attitude w x y z"};
    case schema::TWIST:
      return {axes, dof == 6 ? 6 : axes, "with the rotation"};
    case schema::IN_SPACE:
      return {3, 3, ""};
    case schema::IN_PLANE:
      return {2, 2, ""};
    case schema::QUATERNION:
      return {4, 4, ""};
    case schema::MOMENTS:
      return {1, 3, "for the principal moments"};
    case schema::INERTIA:
      return {3, 6, "with xy xz yz"};
    default:
      return {axes, axes, ""};
  }
}

/// What a number must be: option must_be.
struct Range {
  double low = -std::numeric_limits<double>::max(), high = std::numeric_limits<double>::max();
  bool above_low = false, below_high = false;  ///< the end itself is not allowed
  std::string words = "a finite number";

  explicit Range(const std::string& text) {
    if (text.empty()) return;
    words = text;
    above_low = text.starts_with("> "), below_high = text.find('<') != text.npos;
    std::vector<double> ends;
    for (std::size_t at = 0; (at = text.find_first_of("-0123456789", at)) != text.npos;) {
      const auto [stop, error] = std::from_chars(text.data() + at, text.data() + text.size(), ends.emplace_back());
      at = error == std::errc{} ? static_cast<std::size_t>(stop - text.data()) : text.npos;
    }
    low = ends.at(0), high = ends.size() > 1 ? ends[1] : 1e18;
    if (ends.size() == 1) words += " and at most 1e18";
  }
  [[nodiscard]] bool holds(double v) const {
    return (above_low ? v > low : v >= low) && (below_high ? v < high : v <= high);
  }
};

/// The options of a field.
struct Rule {
  const Descriptor* field;
  Range range;
  schema::List holds;
  bool required;
  int least_dof;
  std::vector<Rule> within;  ///< of a block

  explicit Rule(const Descriptor& of)
      : field{&of},
        range{of.options().GetExtension(schema::must_be)},
        holds{of.options().GetExtension(schema::holds)},
        required{of.options().GetExtension(schema::required)},
        least_dof{of.options().GetExtension(schema::least_dof)} {}

  /// What the field must be, given or not.
  [[nodiscard]] std::string words(int dof) const {
    return field->is_repeated() ? lengths_of(holds, dof).words() : "be " + range.words;
  }
};
std::vector<Rule> rules_of(const pb::Descriptor& block) {
  std::vector<Rule> all;
  for (int i = 0; i < block.field_count(); ++i) {
    Rule rule{*block.field(i)};
    const pb::Descriptor* const inner = rule.field->message_type();
    if (inner == schema::Gripper::descriptor()) continue;  // a scene of its own, with dof 1
    if (inner != nullptr) rule.within = rules_of(*inner);
    const bool number = rule.field->cpp_type() == Descriptor::CPPTYPE_DOUBLE;
    if (number || rule.field->options().HasExtension(schema::must_be) || rule.required || rule.least_dof > 0 ||
        !rule.within.empty())
      all.push_back(std::move(rule));
  }
  return all;
}
/// Made once for a kind of block.
const std::vector<Rule>& rules(const pb::Descriptor& block) {
  static std::mutex mutex;
  static std::map<const pb::Descriptor*, std::vector<Rule>> known;
  const std::lock_guard lock{mutex};
  const auto [at, is_new] = known.try_emplace(&block);
  if (is_new) at->second = rules_of(block);
  return at->second;
}

/// Checks blocks within each other.
class Check {
 public:
  /// Where a block stands. Paths are made for errors only.
  struct Place {
    const Place* outer = nullptr;
    std::string_view name{};
    int index = -1;
  };

  Check(const Context& context, std::string path) : context_{context}, path_{std::move(path)} {}

  void block(const pb::Message& message, const std::vector<Rule>& rules, const Place& place) const {
    const pb::Reflection& reflection = *message.GetReflection();
    for (const Rule& rule : rules) {
      const Descriptor* const field = rule.field;
      const bool list = field->is_repeated();
      const int size = size_of(reflection, message, *field);
      if (size == 0) {
        if (rule.required) fail(place, rule, "{} is missing; it must {}", rule.words(context_.dof));
        continue;
      }
      if (context_.dof < rule.least_dof) refuse_dof(place, rule);
      if (list && field->cpp_type() == Descriptor::CPPTYPE_DOUBLE) {
        numbers(message, rule, place);
      } else if (field->cpp_type() == Descriptor::CPPTYPE_DOUBLE) {
        number(message, reflection.GetDouble(message, field), rule, place);
      } else if (field->cpp_type() == Descriptor::CPPTYPE_INT32) {
        number(message, reflection.GetInt32(message, field), rule, place);
      } else if (list) {
        for (int i = 0; i < size; ++i)
          block(reflection.GetRepeatedMessage(message, field, i), rule.within, {&place, field->name(), i});
      } else if (field->message_type() != nullptr) {
        block(reflection.GetMessage(message, field), rule.within, {&place, field->name()});
      }
    }
  }

 private:
  void number(const pb::Message& message, double value, const Rule& rule, const Place& place) const {
    if (!std::isfinite(value)) refuse(message, rule, place, "be a finite number");
    if (!rule.range.holds(value)) refuse(message, rule, place, "be " + rule.range.words);
  }
  void numbers(const pb::Message& message, const Rule& rule, const Place& place) const {
    const auto list = message.GetReflection()->GetRepeatedFieldRef<double>(message, rule.field);
    const Numbers values{list.begin(), list.end()};
    const Lengths lengths = lengths_of(rule.holds, context_.dof);
    if (rule.holds != schema::ANY && !lengths.allow(static_cast<int>(values.size())))
      refuse(message, rule, place, lengths.words());
    if (!std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); }))
      refuse(message, rule, place, "hold finite numbers");
    if (!std::all_of(values.begin(), values.end(), [&](double v) { return rule.range.holds(v); }))
      refuse(message, rule, place, (rule.range.low < 0.0 ? "have coordinates " : "hold numbers ") + rule.range.words);
    if (rule.holds == schema::DIRECTION && std::all_of(values.begin(), values.end(), [](double v) { return v == 0.0; }))
      refuse(message, rule, place, "not be zero: it is a direction");
    const bool unit = rule.holds == schema::QUATERNION, posed = rule.holds == schema::POSE && values.size() == 7;
    if (!unit && !posed) return;
    if (const double length = length_of(values, posed ? 3 : 0); !(std::abs(length - 1.0) <= 1e-3))
      refuse(message, rule, place,
             unit ? "be of length 1"
                  : fmt::format("end in a unit quaternion w x y z, whose length is 1 and not {:.9g}", length));
  }

  [[noreturn]] void fail(const Place& place, const Rule& rule, const char* words, const auto&... values) const {
    context_.fail(fmt::format(fmt::runtime(words), path_of(place, rule.field->name()), values...));
  }
  [[noreturn]] void refuse(const pb::Message& message, const Rule& rule, const Place& place,
                           const std::string& words) const {
    fail(place, rule, "{} is {}; it must {}", text_of(message, *rule.field), words);
  }
  [[noreturn]] void refuse_dof(const Place& place, const Rule& rule) const {
    if (rule.least_dof == 6) fail(place, rule, "{} is given, but applies to dof 6 only; dof is {}", context_.dof);
    fail(place, rule, "{} is given, but dof is 1; a {} needs dof 3 or 6", rule.field->name());
  }
  [[nodiscard]] std::string path_of(const Place& place, std::string_view name) const {
    std::string path{name};
    for (const Place* each = &place; each->outer != nullptr; each = each->outer)
      path = fmt::format("{}{}.{}", each->name, each->index < 0 ? "" : fmt::format("[{}]", each->index), path);
    return path_.empty() ? path : fmt::format("{}.{}", path_, path);
  }

  const Context& context_;
  std::string path_;
};

}  // namespace

void Context::fail(const std::string& words) const {
  throw ConfigError{fmt::format("{}: {}", file, words)};
}

std::string AnyBlock::path_of(std::string_view name) const {
  return path_.empty() ? std::string{name} : fmt::format("{}.{}", path_, name);
}

void AnyBlock::refuse_field(std::string_view name, std::string_view words) const {
  const Descriptor& field = *message_.GetDescriptor()->FindFieldByName(std::string{name});
  fail(fmt::format("{} is {}; it must {}", path_of(name), text_of(message_, field), words));
}

bool AnyBlock::has_field(std::string_view name) const {
  return size_of(*message_.GetReflection(), message_, *message_.GetDescriptor()->FindFieldByName(std::string{name})) >
         0;
}

void AnyBlock::require_field(std::string_view name, std::string_view words) const {
  if (has_field(name)) return;
  const Rule rule{*message_.GetDescriptor()->FindFieldByName(std::string{name})};
  fail(fmt::format("{} is missing; it must {}", path_of(name), words.empty() ? rule.words(dof()) : words));
}

void AnyBlock::check_length(std::string_view name, int length, int wanted) const {
  if (const Lengths lengths{wanted, wanted, ""}; length != 0 && !lengths.allow(length))
    refuse_field(name, lengths.words());
}

void AnyBlock::refuse_empty() const {
  fail(fmt::format("{} is empty; it must hold one of {}", path_, field_names(*message_.GetDescriptor())));
}

void AnyBlock::check_fields() const {
  Check{context_, path_}.block(message_, rules(*message_.GetDescriptor()), {});
}

Numbers direction(const List& list) {
  Numbers values = numbers(list);
  const double longest = std::abs(
      *std::max_element(values.begin(), values.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  for (double& v : values) v /= longest;  // its square may exceed the range of a double
  const double length = length_of(values, 0);
  for (double& v : values) v /= length;
  return values;
}

Numbers pose(const List& list) {
  Numbers values = numbers(list);
  if (values.size() != 7) return values;
  const double length = length_of(values, 3);
  for (std::size_t i = 3; i < 7; ++i) values[i] /= length;
  return values;
}

Eigen::Quaterniond attitude(const List& list) {
  return list.empty() ? Eigen::Quaterniond::Identity()
                      : Eigen::Quaterniond{list[0], list[1], list[2], list[3]}.normalized();
}

}  // namespace twoport
