#include "common/page/http.h"

#include <algorithm>
#include <array>
#include <charconv>

namespace twoport {
namespace {

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}
bool equal_ignoring_case(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) { return lower(x) == lower(y); });
}
std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == text.npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}
bool printable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c == '\t' || (c >= 0x20 && c < 0x7f); });
}
/// Is `token` one of a comma-separated list?
bool lists(std::string_view list, std::string_view token) {
  while (!list.empty()) {
    const std::size_t comma = std::min(list.find(','), list.size());
    if (equal_ignoring_case(trimmed(list.substr(0, comma)), token)) return true;
    list.remove_prefix(std::min(comma + 1, list.size()));
  }
  return false;
}

bool is_ipv4(std::string_view text) {
  int parts = 0;
  while (true) {
    int value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    const auto digits = static_cast<std::size_t>(end - text.data());
    if (error != std::errc{} || digits == 0 || digits > 3 || value < 0 || value > 255 || text[0] == '-') return false;
    ++parts;
    text.remove_prefix(digits);
    if (text.empty()) return parts == 4;
    if (parts == 4 || text[0] != '.') return false;
    text.remove_prefix(1);
  }
}
bool is_bracketed_ipv6(std::string_view text) {
  if (text.size() < 4 || text.front() != '[' || text.back() != ']') return false;
  const std::string_view inner = text.substr(1, text.size() - 2);
  return inner.find(':') != inner.npos && inner.find_first_not_of("0123456789abcdefABCDEF:.") == inner.npos;
}

}  // namespace

HttpParse parse_request(std::string_view bytes) {
  HttpParse out;
  const std::size_t end = bytes.find("\r\n\r\n");
  if (end == bytes.npos || end > kLargestRequest) {
    out.status = bytes.size() > kLargestRequest ? Parsed::invalid : Parsed::incomplete;
    return out;
  }
  out.status = Parsed::invalid;
  std::string_view head = bytes.substr(0, end + 2);
  const auto next_line = [&] {
    const std::size_t stop = head.find("\r\n");
    const std::string_view line = head.substr(0, stop);
    head.remove_prefix(stop + 2);
    return line;
  };
  const std::string_view first = next_line();
  const std::size_t a = first.find(' '), b = first.rfind(' ');
  if (a == first.npos || a == b || !printable(first) || !first.substr(b + 1).starts_with("HTTP/1.")) return out;
  HttpRequest& r = out.request;
  r.method = first.substr(0, a);
  r.target = first.substr(a + 1, b - a - 1);
  if (r.target.empty() || r.target.front() != '/' || r.target.find(' ') != r.target.npos) return out;
  const std::array<std::pair<std::string_view, std::string*>, 6> known{
      {{"host", &r.host},
       {"origin", &r.origin},
       {"upgrade", &r.upgrade},
       {"connection", &r.connection},
       {"sec-websocket-key", &r.websocket_key},
       {"sec-websocket-version", &r.websocket_version}}};
  while (!head.empty()) {
    const std::string_view line = next_line();
    const std::size_t colon = line.find(':');
    if (colon == line.npos || colon == 0 || !printable(line)) return out;
    const std::string_view name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
    if (name.find_first_of(" \t") != name.npos) return out;
    if (equal_ignoring_case(name, "transfer-encoding")) return out;
    if (equal_ignoring_case(name, "content-length") && value != "0") return out;
    for (const auto& [key, target] : known) {
      if (!equal_ignoring_case(name, key)) continue;
      if (!target->empty()) return out;
      *target = value;
    }
  }
  out.status = Parsed::whole;
  out.used = end + 4;
  return out;
}

bool is_literal_host(std::string_view host, std::uint16_t port) {
  const std::size_t colon = host.rfind(':');
  const bool has_port = colon != host.npos && host.back() != ']';
  const std::string_view name = host.substr(0, has_port ? colon : host.npos);
  unsigned given = 80;
  if (has_port) {
    const std::string_view text = host.substr(colon + 1);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), given);
    if (error != std::errc{} || end != text.data() + text.size()) return false;
  }
  return given == port && (equal_ignoring_case(name, "localhost") || is_ipv4(name) || is_bracketed_ipv6(name));
}

bool is_own_origin(const HttpRequest& r) {
  return !r.host.empty() && equal_ignoring_case(r.origin, "http://" + r.host);
}

bool is_websocket_upgrade(const HttpRequest& r) {
  // A key is 16 bytes in base64.
  return r.method == "GET" && lists(r.upgrade, "websocket") && lists(r.connection, "upgrade") &&
         r.websocket_version == "13" && r.websocket_key.size() == 24;
}

std::string http_response(std::string_view status, std::string_view content_type, std::string_view body,
                          const std::vector<std::pair<std::string, std::string>>& headers) {
  std::string out = "HTTP/1.1 " + std::string{status} + "\r\nContent-Type: " + std::string{content_type} +
                    "\r\nContent-Length: " + std::to_string(body.size()) + "\r\nConnection: close\r\n";
  for (const auto& [name, value] : headers) out += name + ": " + value + "\r\n";
  out += "\r\n";
  out += body;
  return out;
}

}  // namespace twoport
