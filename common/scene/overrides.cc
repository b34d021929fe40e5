#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <algorithm>
#include <charconv>
#include <memory>
#include <string_view>
#include <vector>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/scene/load.h"
#include "common/scene/source.h"
#include "common/scene/text.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

/// What a field may hold, for error sentences.
std::string allowed(const pb::FieldDescriptor& field, bool element) {
  const auto one = [&]() -> std::string {
    switch (field.cpp_type()) {
      case pb::FieldDescriptor::CPPTYPE_DOUBLE:
        return "a number";
      case pb::FieldDescriptor::CPPTYPE_INT32:
        return "an integer";
      case pb::FieldDescriptor::CPPTYPE_UINT64:
        return "an integer >= 0";
      case pb::FieldDescriptor::CPPTYPE_BOOL:
        return "true or false";
      case pb::FieldDescriptor::CPPTYPE_STRING:
        return "a string";
      case pb::FieldDescriptor::CPPTYPE_ENUM:
        return "one of " + value_names(*field.enum_type());
      case pb::FieldDescriptor::CPPTYPE_MESSAGE:
        return fmt::format("a block {{ ... }} of {}", field_names(*field.message_type()));
      default:
        return field.cpp_type_name();
    }
  }();
  return field.is_repeated() && !element ? fmt::format("a list [...], each {}", one) : one;
}

/// In one line, whatever stands in the override.
std::string refusal(const std::string& assignment, const std::string& sentence) {
  return in_one_line(fmt::format("override {}: {}", assignment, sentence));
}

/// One override on its way through the scene.
class Override {
 public:
  Override(schema::Scene& scene, const std::string& assignment) : assignment_{assignment}, block_{&scene} {}

  /// Returns the outermost block that it has created.
  std::string apply() {
    if (const std::string error = assignment_error(assignment_); !error.empty()) throw ConfigError{error};
    const std::size_t equals = assignment_.find('=');
    std::string_view path = trimmed(std::string_view{assignment_}.substr(0, equals));
    for (std::size_t dot; (dot = path.find('.')) != path.npos; path = path.substr(dot + 1)) {
      find(path.substr(0, dot));
      descend();
    }
    find(path);
    set(std::string{trimmed(std::string_view{assignment_}.substr(equals + 1))});
    return created_;
  }

 private:
  [[noreturn]] void fail(const std::string& sentence) const { throw ConfigError{refusal(assignment_, sentence)}; }
  [[nodiscard]] const pb::Reflection& reflection() const { return *block_->GetReflection(); }
  [[nodiscard]] int size() const { return reflection().FieldSize(*block_, field_); }
  [[nodiscard]] bool indexed() const { return index_ >= 0; }

  /// Finds the field that one step of the path names: NAME or NAME[INDEX].
  void find(std::string_view step) {
    const std::size_t bracket = step.find('[');
    const std::string name{step.substr(0, bracket)};
    const pb::Descriptor& descriptor = *block_->GetDescriptor();
    field_ = descriptor.FindFieldByName(name);
    if (!field_)
      fail(fmt::format("no field \"{}\" in {}; it has {}", name, path_.empty() ? "a scene" : path_,
                       field_names(descriptor)));
    path_ += path_.empty() ? name : "." + name;
    index_ = -1;
    if (bracket != step.npos) take_index(step.substr(bracket + 1));
  }

  /// `rest` is what follows the opening bracket.
  void take_index(std::string_view rest) {
    if (!field_->is_repeated()) fail(fmt::format("{} is not a list, it takes no index", path_));
    const char* const end = rest.data() + rest.size();
    const auto [stop, error] = std::from_chars(rest.data(), end, index_);
    if (error != std::errc{} || stop + 1 != end || *stop != ']' || index_ < 0)
      fail(fmt::format("{} must be followed by an index such as [0]", path_));
    if (const int n = size(); index_ > n)
      fail(fmt::format("{} holds {}; the index must be {}{} to append", path_, n,
                       n == 0   ? ""
                       : n == 1 ? "0, or "
                                : fmt::format("0 to {}, or ", n - 1),
                       n));
    path_ += fmt::format("[{}]", index_);
  }

  /// Enters the block of the field; creates it if absent.
  void descend() {
    if (!field_->message_type()) fail(fmt::format("{} is {} and has no fields", path_, allowed(*field_, indexed())));
    if (field_->is_repeated() && !indexed())
      fail(fmt::format("{} is a list and needs an index, as in {}[0]", path_, path_));
    const bool is_there = indexed() ? index_ < size() : reflection().HasField(*block_, field_);
    if (!is_there && created_.empty()) created_ = path_;
    if (!indexed())
      block_ = reflection().MutableMessage(block_, field_);
    else if (index_ < size())
      block_ = reflection().MutableRepeatedMessage(block_, field_, index_);
    else
      block_ = reflection().AddMessage(block_, field_);
  }

  /// Reads the value with the text-format parser, as a field of an otherwise empty block, and puts it in place.
  void set(std::string value) {
    if (field_->cpp_type() == pb::FieldDescriptor::CPPTYPE_STRING && !value.starts_with('"') &&
        !value.starts_with('\''))
      value = fmt::format("\"{}\"", value);  // a shell takes the quotes off
    const std::unique_ptr<pb::Message> alone{block_->New()};
    const auto error = parse_text(fmt::format("{}: {}", field_->name(), value), *alone);
    if (error && field_->message_type())
      fail(fmt::format("it must be {} ({})", allowed(*field_, indexed()), error->sentence));
    if (error && field_->cpp_type() == pb::FieldDescriptor::CPPTYPE_DOUBLE && value.find(',') != value.npos)
      fail(fmt::format("it must be {}; a decimal separator is a point", allowed(*field_, indexed())));
    std::vector<const pb::FieldDescriptor*> given;
    reflection().ListFields(*alone, &given);
    const bool only = given.empty() ? field_->is_repeated() && !indexed() : given.size() == 1 && given[0] == field_;
    if (error || !only || (indexed() && reflection().FieldSize(*alone, field_) != 1))
      fail(fmt::format("it must be {}", allowed(*field_, indexed())));

    if (!indexed()) reflection().ClearField(block_, field_);
    const int before = field_->is_repeated() ? size() : 0;
    block_->MergeFrom(*alone);  // appends to a list
    if (indexed() && index_ < before) {
      reflection().SwapElements(block_, field_, index_, before);
      reflection().RemoveLast(block_, field_);
    }
  }

  const std::string& assignment_;
  pb::Message* block_;
  const pb::FieldDescriptor* field_ = nullptr;
  int index_ = -1;       ///< -1: none
  std::string path_;     ///< so far
  std::string created_;  ///< outermost block that was absent
};

}  // namespace

std::string assignment_error(const std::string& assignment) {
  if (assignment.find('=') != assignment.npos) return "";
  const std::string_view whole = trimmed(assignment);
  const std::size_t end = std::min(whole.find_first_of(" :{<\t\n"), whole.size());
  const std::size_t value = std::min(whole.find_first_not_of(" :\t\n", end), whole.size());
  const std::string_view path = end > 0 ? whole.substr(0, end) : "to_slave.delay_ms";
  return refusal(assignment, fmt::format("it has no \"=\"; it must read PATH=VALUE, as in {}={}", path,
                                         value < whole.size() ? whole.substr(value) : "VALUE"));
}

std::vector<std::string> single_overrides(std::span<const std::string> overrides) {
  std::vector<std::string> all;
  for (const std::string& assignment : overrides) {
    const std::size_t equals = assignment.find('=');
    if (equals == assignment.npos || assignment.find(',') > equals) {
      all.push_back(assignment);
      continue;
    }
    std::vector<std::string_view> paths;
    for (std::size_t from = 0, to = 0; to < equals; from = to + 1) {
      to = std::min(assignment.find(',', from), equals);
      const std::string_view path = trimmed(std::string_view{assignment}.substr(from, to - from));
      if (path.empty()) throw ConfigError{refusal(assignment, "a path is empty; linked paths read A,B=VALUE")};
      if (std::find(paths.begin(), paths.end(), path) != paths.end())
        throw ConfigError{refusal(assignment, fmt::format("{} is named twice", path))};
      paths.push_back(path);
      all.push_back(fmt::format("{}{}", path, std::string_view{assignment}.substr(equals)));
    }
  }
  return all;
}

std::string apply_override(schema::Scene& scene, const std::string& assignment) {
  return Override{scene, assignment}.apply();
}

}  // namespace twoport
