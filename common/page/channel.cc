#include "common/page/channel.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "common/base/text.h"

namespace twoport {
namespace {

/// The words of a command, one after the other.
class CommandReader {
 public:
  explicit CommandReader(std::string_view text) : rest_{text} {}
  std::string_view word() {
    const std::size_t space = rest_.find(' ');
    const std::string_view word = rest_.substr(0, space);
    rest_.remove_prefix(space == rest_.npos ? rest_.size() : space + 1);
    return word;
  }
  /// A finite number within [least, most], or the nearer limit. Anything else makes the command invalid.
  double number(double least, double most) {
    const std::optional<double> value = number_from<double>(word());
    expect(value && std::isfinite(*value));
    return good_ ? std::clamp(*value, least, most) : least;
  }
  /// A whole number from 0 to 1000, below `count`.
  int index(int count) {
    const double value = number(-1.0, 1000.0);
    expect(value >= 0.0 && value == std::floor(value) && value < count);
    return static_cast<int>(value);
  }
  void expect(bool condition) { good_ = good_ && condition; }
  /// Was everything well-formed, and nothing is left?
  [[nodiscard]] bool good() const { return good_ && rest_.empty(); }

 private:
  std::string_view rest_;
  bool good_ = true;
};

using Kind = PageCommand::Kind;
struct Range {
  double least, most;
};
/// The form of a command.
struct Form {
  std::string_view verb;
  Kind kind;
  int indices = 0;                 ///< PageCommand::which is below this; 0: it has none
  std::array<Range, 6> numbers{};  ///< of those, one behind the other; an empty range ends them
};
constexpr double kAny = std::numeric_limits<double>::max();
constexpr int kAnyIndex = 1001, kAxisSums = 64;
constexpr Range kReach{-kPageReach, kPageReach}, kTurn{-kPageTurn, kPageTurn};
constexpr Form kForms[] = {
    {"target", Kind::target, 0, {kReach, kReach, kReach, kTurn, kTurn, kTurn}},
    {"release", Kind::release},
    {"take", Kind::take},
    {"restart", Kind::restart},
    {"grip", Kind::grip, 0, {Range{kPageGripLeast, kPageGripMost}}},
    {"opening", Kind::opening, 0, {Range{0.0, kPageReach}}},
    {"network", Kind::network, 0, {Range{0.0, kPageDelayMs}, {0.0, kPageJitterMs}, {0.0, kPageLoss}}},
    // The slave judges: a surface may be outside the limits of a request already.
    {"surface", Kind::surface, static_cast<int>(kAdjustableSurfaces), {Range{0.0, kAny}, {0.0, kAny}}},
    {"zero", Kind::zero},
    {"method", Kind::method, kAnyIndex},
    {"clutch", Kind::clutch, 2},
    {"rehome", Kind::rehome},
    {"lock", Kind::lock, kAxisSums},
    {"scale", Kind::scale, 0, {Range{kPageScaleLeast, 1.0}, {0.0, 1.0}}},
};

}  // namespace

std::optional<PageCommand> parse_page_command(std::string_view text) {
  CommandReader words{text};
  const std::string_view verb = words.word();
  const Form* const form =
      std::find_if(std::begin(kForms), std::end(kForms), [&](const Form& f) { return f.verb == verb; });
  if (form == std::end(kForms)) return std::nullopt;
  PageCommand c{.kind = form->kind};
  if (c.kind == Kind::network) {
    const std::string_view direction = words.word();
    words.expect(direction == "to_slave" || direction == "to_master");
    c.which = direction == "to_slave" ? 0 : 1;
  }
  if (form->indices > 0) c.which = words.index(form->indices);
  for (std::size_t i = 0; i < c.number.size() && form->numbers[i].most > form->numbers[i].least; ++i)
    c.number[i] = words.number(form->numbers[i].least, form->numbers[i].most);
  if (!words.good()) return std::nullopt;
  return c;
}

}  // namespace twoport
