#include "common/page/channel.h"

#include <algorithm>
#include <cmath>
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
  /// A whole number from 0 to `most`.
  int index(std::size_t most) {
    const double value = number(-1.0, static_cast<double>(most));
    expect(value >= 0.0 && value == std::floor(value));
    return static_cast<int>(value);
  }
  void expect(bool condition) { good_ = good_ && condition; }
  /// Was everything well-formed, and nothing is left?
  [[nodiscard]] bool good() const { return good_ && rest_.empty(); }

 private:
  std::string_view rest_;
  bool good_ = true;
};

}  // namespace

std::optional<PageCommand> parse_page_command(std::string_view text) {
  CommandReader words{text};
  const std::string_view verb = words.word();
  PageCommand c;
  if (verb == "target") {
    c.kind = PageCommand::Kind::target;
    for (std::size_t i = 0; i < 6; ++i) {
      const double most = i < 3 ? kPageReach : kPageTurn;
      c.number[i] = words.number(-most, most);
    }
  } else if (verb == "release") {
    c.kind = PageCommand::Kind::release;
  } else if (verb == "take") {
    c.kind = PageCommand::Kind::take;
  } else if (verb == "restart") {
    c.kind = PageCommand::Kind::restart;
  } else if (verb == "grip") {
    c.kind = PageCommand::Kind::grip;
    c.number[0] = words.number(kPageGripLeast, kPageGripMost);
  } else if (verb == "opening") {
    c.kind = PageCommand::Kind::opening;
    c.number[0] = words.number(0.0, kPageReach);
  } else if (verb == "network") {
    c.kind = PageCommand::Kind::network;
    const std::string_view direction = words.word();
    words.expect(direction == "to_slave" || direction == "to_master");
    c.which = direction == "to_slave" ? 0 : 1;
    c.number[0] = words.number(0.0, kPageDelayMs);
    c.number[1] = words.number(0.0, kPageJitterMs);
    c.number[2] = words.number(0.0, kPageLoss);
  } else if (verb == "surface") {
    c.kind = PageCommand::Kind::surface;
    c.which = words.index(1000);
    words.expect(c.which < static_cast<int>(kAdjustableSurfaces));
    // The slave judges: a surface may be outside the limits of a request already.
    c.number[0] = words.number(0.0, std::numeric_limits<double>::max());
    c.number[1] = words.number(0.0, std::numeric_limits<double>::max());
  } else if (verb == "method") {
    c.kind = PageCommand::Kind::method;
    c.which = words.index(1000);
  } else if (verb == "clutch") {
    c.kind = PageCommand::Kind::clutch;
    c.which = words.index(1000);
    words.expect(c.which <= 1);
  } else if (verb == "rehome") {
    c.kind = PageCommand::Kind::rehome;
  } else if (verb == "lock") {
    c.kind = PageCommand::Kind::lock;
    c.which = words.index(1000);
    words.expect(c.which < 64);
  } else if (verb == "scale") {
    c.kind = PageCommand::Kind::scale;
    c.number[0] = words.number(kPageScaleLeast, 1.0);
    c.number[1] = words.number(0.0, 1.0);
  } else {
    return std::nullopt;
  }
  if (!words.good()) return std::nullopt;
  return c;
}

}  // namespace twoport
