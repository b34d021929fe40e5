#include "common/scene/text.h"

#include <fmt/format.h>
#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cctype>
#include <utility>
#include <vector>

#include "common/base/text.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

bool is_digit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}
bool is_word(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_';
}

/// "LINE:COLUMN" of a byte, both from 1.
std::string place_of(std::string_view text, std::size_t offset) {
  const std::string_view before = text.substr(0, offset);
  const std::size_t newline = before.rfind('\n');
  return fmt::format("{}:{}", std::count(before.begin(), before.end(), '\n') + 1,
                     newline == before.npos ? offset + 1 : offset - newline);
}

/// Keeps the first error, as the parser gives it.
class FirstError : public pb::io::ErrorCollector {
 public:
  void AddError(int line, pb::io::ColumnNumber column, const std::string& message) override {
    if (!message_.empty()) return;
    line_ = std::max(line, 0);
    column_ = std::max(column, 0);
    message_ = message;
  }
  [[nodiscard]] const std::string& message() const { return message_; }

  /// The byte where the parser stood. It counts a tab up to the next multiple of 8.
  [[nodiscard]] std::size_t offset_in(std::string_view text) const {
    std::size_t offset = 0;
    for (int skipped = 0; skipped < line_; ++skipped) {
      const std::size_t end = text.find('\n', offset);
      if (end == text.npos) break;
      offset = end + 1;
    }
    for (int column = 0; column < column_ && offset < text.size() && text[offset] != '\n'; ++offset)
      column = text[offset] == '\t' ? (column / 8 + 1) * 8 : column + 1;
    return offset;
  }

 private:
  int line_ = 0, column_ = 0;  // from 0
  std::string message_;
};

// ---- which blocks are open

struct OpenBlock {
  std::string name;
  std::size_t offset;  ///< of its name
};

/// The blocks that `text` opens and does not close, outermost first.
std::vector<OpenBlock> open_blocks(std::string_view text) {
  std::vector<OpenBlock> open;
  OpenBlock last{};  // name read last
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '#') {
      i = std::min(text.find('\n', i), text.size());
    } else if (c == '"' || c == '\'') {
      for (++i; i < text.size() && text[i] != c; ++i) i += text[i] == '\\';
    } else if (is_word(c)) {
      const std::size_t begin = i;
      while (i + 1 < text.size() && is_word(text[i + 1])) ++i;
      last = {std::string{text.substr(begin, i + 1 - begin)}, begin};
    } else if (c == '{' || c == '<') {
      open.push_back(last);
    } else if ((c == '}' || c == '>') && !open.empty()) {
      last = open.back();  // the next of a list has no name of its own
      open.pop_back();
    }
  }
  return open;
}

/// "operator.hand (opened at 2:3)"
std::string described(const std::vector<OpenBlock>& open, std::string_view text) {
  std::string path;
  for (const OpenBlock& each : open) path += (path.empty() ? "" : ".") + each.name;
  return fmt::format("{} (opened at {})", path, place_of(text, open.back().offset));
}

/// The schema of the text itself, and of each block that is open.
std::vector<const pb::Descriptor*> schemas(const pb::Descriptor& whole, const std::vector<OpenBlock>& open) {
  std::vector<const pb::Descriptor*> all{&whole};
  for (const OpenBlock& each : open) {
    const pb::FieldDescriptor* field = all.back()->FindFieldByName(each.name);
    if (field == nullptr || field->message_type() == nullptr) break;
    all.push_back(field->message_type());
  }
  return all;
}

// ---- what is wrong

struct Explanation {
  std::string sentence;
  std::string token;  ///< the token in error, just before the parser's position; empty: at the position
};

/// A number with a decimal comma, as in "mass_kg: 0,5": the parser takes the comma for the end of the field.
struct DecimalComma {
  std::size_t offset;
  std::string written, meant;
};
std::optional<DecimalComma> decimal_comma(std::string_view text, std::size_t offset) {
  std::size_t fraction = offset, end = offset;
  while (fraction > 0 && is_word(text[fraction - 1])) --fraction;
  while (end < text.size() && is_word(text[end])) ++end;
  if (fraction < 2 || fraction == end || !is_digit(text[fraction]) || text[fraction - 1] != ',') return std::nullopt;
  std::size_t begin = fraction - 1;
  while (begin > 0 && is_digit(text[begin - 1])) --begin;
  if (begin == fraction - 1) return std::nullopt;
  if (begin > 0 && text[begin - 1] == '-') --begin;
  const std::string_view before = trimmed(text.substr(0, begin));
  if (!before.ends_with(':')) return std::nullopt;  // within a list a comma parts two numbers
  DecimalComma found{begin, std::string{text.substr(begin, end - begin)}, std::string{text.substr(begin, end - begin)}};
  std::replace(found.meant.begin(), found.meant.end(), ',', '.');
  return found;
}

/// The text in double quotes in a message of the parser.
std::vector<std::string> quoted_in(const std::string& message) {
  std::vector<std::string> all;
  for (std::size_t open = message.find('"'); open != message.npos;) {
    const std::size_t close = message.find('"', open + 1);
    if (close == message.npos) break;
    all.push_back(message.substr(open + 1, close - open - 1));
    open = message.find('"', close + 1);
  }
  return all;
}

Explanation unknown_field(const pb::Descriptor& block, const std::string& name, std::string_view text,
                          const std::vector<OpenBlock>& open, const std::vector<const pb::Descriptor*>& known) {
  std::string sentence = fmt::format("{} has no field \"{}\"; it has {}", block.name(), name, field_names(block));
  // A field of an outer block: a closing brace is probably missing.
  const bool further_out = std::any_of(known.begin(), known.end() - 1, [&](const pb::Descriptor* each) {
    return each->FindFieldByName(name) != nullptr;
  });
  if (further_out) sentence += fmt::format("; perhaps the }} of {} is missing", described(open, text));
  return {sentence, name};
}

/// Translates a message of the parser to a sentence. `text` is the text before the parser's position, `whole` its
/// schema.
Explanation explain(const std::string& message, std::string_view text, const pb::Descriptor& whole) {
  const std::vector<std::string> quoted = quoted_in(message);
  const auto starts = [&](std::string_view words, std::size_t quotes) {
    return message.starts_with(words) && quoted.size() == quotes;
  };
  const std::vector<OpenBlock> open = open_blocks(text);
  const std::vector<const pb::Descriptor*> known = schemas(whole, open);

  if (starts("Message type ", 2)) {
    const pb::Descriptor* block = whole.file()->pool()->FindMessageTypeByName(quoted[0]);
    if (block) return unknown_field(*block, quoted[1], text, open, known);
  }
  if (starts("Unknown enumeration value of ", 2)) {
    const pb::FieldDescriptor* field = known.back()->FindFieldByName(quoted[1]);
    if (field && field->enum_type())
      return {fmt::format("{} is {}; it must be one of {}", quoted[1], quoted[0], value_names(*field->enum_type())),
              quoted[0]};
  }
  if (starts("Invalid value for boolean field ", 2))
    return {fmt::format("{} is {}; it must be true or false", quoted[0], quoted[1]), quoted[1]};
  if (starts("Non-repeated field ", 1)) return {fmt::format("{} is given twice", quoted[0]), quoted[0]};
  if (starts("Field ", 3))
    return {fmt::format("{} and {} are both given; only one is allowed", quoted[0], quoted[1]), quoted[0]};
  if (message.ends_with("got: ") || message.ends_with("found \"\"."))
    return {open.empty() ? "the text is incomplete"
                         : fmt::format("the text ends within {}; a }} is missing", described(open, text)),
            ""};
  if (starts("Expected \"", 2)) return {fmt::format("\"{}\" is expected here, not {}", quoted[0], quoted[1]), ""};
  if (message == "Expected identifier, got: }") return {"this } closes no block", ""};
  for (const auto& [begin, needed] :
       {std::pair{"Expected double, got: ", "a number"}, std::pair{"Expected integer, got: ", "an integer"},
        std::pair{"Expected string, got: ", "a string in quotes"},
        std::pair{"Expected identifier, got: ", "the name of a field"}})
    if (message.starts_with(begin))
      return {fmt::format("{} is expected here, not {}", needed, message.substr(std::string_view{begin}.size())), ""};
  return {message, ""};
}

}  // namespace

std::optional<ParseError> parse_text(const std::string& text, pb::Message& message) {
  FirstError error;
  pb::TextFormat::Parser parser;
  parser.RecordErrorsTo(&error);
  if (parser.ParseFromString(text, &message)) return std::nullopt;

  std::size_t offset = error.offset_in(text);
  if (const auto comma = decimal_comma(text, offset))
    return ParseError{place_of(text, comma->offset),
                      fmt::format("{} is not a number; a decimal point is meant: {}", comma->written, comma->meant)};
  const auto [sentence, token] =
      explain(error.message(), std::string_view{text}.substr(0, offset), *message.GetDescriptor());
  if (!token.empty() && offset > 0)
    if (const std::size_t passed = text.rfind(token, offset - 1); passed != text.npos) offset = passed;
  return ParseError{place_of(text, offset), sentence};
}

std::string field_names(const pb::Descriptor& block) {
  std::vector<std::string> names;
  for (int i = 0; i < block.field_count(); ++i) names.push_back(block.field(i)->name());
  return fmt::format("{}", fmt::join(names, ", "));
}

std::string value_names(const pb::EnumDescriptor& choice) {
  std::vector<std::string> names;
  for (int i = 0; i < choice.value_count(); ++i) names.push_back(choice.value(i)->name());
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace twoport
