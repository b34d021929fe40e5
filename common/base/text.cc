#include "common/base/text.h"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace twoport {

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  return first == text.npos ? std::string_view{} : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string_view take_line(std::string_view& rest) {
  const std::size_t end = std::min(rest.find('\n'), rest.size());
  const std::string_view line = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return trimmed(line.substr(0, line.find('#')));
}

std::string printable(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto code = [&](std::size_t k) { return k < text.size() ? static_cast<unsigned char>(text[k]) : 0; };
    const bool of_two = code(i) == 0xc2 && code(i + 1) >= 0x80 && code(i + 1) < 0xa0;  // UTF-8
    if (of_two) ++i;
    const bool shown = code(i) >= 0x20 ? code(i) != 0x7f : text[i] == '\n' || text[i] == '\t';
    if (shown && !of_two) {
      out += text[i];
    } else {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\x%02x", code(i));
      out += escape;
    }
  }
  return out;
}

std::string in_one_line(std::string_view text) {
  std::string out = printable(text);
  std::replace_if(
      out.begin(), out.end(), [](char c) { return c == '\n' || c == '\t'; }, ' ');
  return out;
}

std::string json_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (code < 0x20) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", code);
      out += escape;
    } else {
      out += c;
    }
  }
  return out + '"';
}

namespace {

/// Single-character edits that make `typed` the closest part of `name`, and those that make it all of `name`.
std::pair<std::size_t, std::size_t> edit_distance(const std::string& typed, const std::string& name) {
  const auto last_row = [&](std::size_t skipped) {
    std::vector<std::size_t> row(name.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = skipped * j;
    for (std::size_t i = 0; i < typed.size(); ++i) {
      std::size_t diagonal = std::exchange(row[0], i + 1);
      for (std::size_t j = 0; j < name.size(); ++j) {
        const std::size_t replaced = diagonal + (typed[i] == name[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, replaced});
      }
    }
    return row;
  };
  const std::vector<std::size_t> part = last_row(0);
  return {*std::min_element(part.begin(), part.end()), last_row(1).back()};
}

}  // namespace

std::vector<std::string> nearest_names(const std::string& typed, const std::vector<std::string>& names,
                                       std::size_t most) {
  std::vector<std::pair<std::pair<std::size_t, std::size_t>, std::string>> nearest;
  for (const std::string& name : names) nearest.emplace_back(edit_distance(typed, name), name);
  std::sort(nearest.begin(), nearest.end());
  nearest.erase(std::unique(nearest.begin(), nearest.end()), nearest.end());
  std::vector<std::string> all;
  for (std::size_t i = 0; i < std::min(most, nearest.size()); ++i) all.push_back(nearest[i].second);
  return all;
}

}  // namespace twoport
