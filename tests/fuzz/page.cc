#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "common/page/channel.h"
#include "common/page/http.h"
#include "common/page/websocket.h"
#include "tests/fuzz/input.h"

// What a client of the live page may send: a request, frames of a WebSocket, the commands in them. The parsers use no more than
// they got, however it arrives in pieces, and a command's numbers are finite and within their limits.
namespace twoport {
namespace {

using Event = WebSocketReader::Event;

void check_command(std::string_view text) {
  const auto command = parse_page_command(text);
  if (!command) return;
  using Kind = PageCommand::Kind;
  for (std::size_t i = 0; i < command->number.size(); ++i) {
    const double number = command->number[i];
    require(std::isfinite(number), "a command's numbers are finite");
    if (command->kind == Kind::target)
      require(std::abs(number) <= (i < 3 ? kPageReach : kPageTurn), "a target is within reach");
  }
  if (command->kind == Kind::grip)
    require(command->number[0] >= kPageGripLeast && command->number[0] <= kPageGripMost, "so is the grip");
  if (command->kind == Kind::network)
    require(command->number[0] >= 0.0 && command->number[0] <= kPageDelayMs && command->number[1] >= 0.0 &&
                command->number[1] <= kPageJitterMs && command->number[2] >= 0.0 && command->number[2] <= kPageLoss &&
                (command->which == 0 || command->which == 1),
            "so is the network");
  if (command->kind == Kind::surface)
    require(command->which >= 0 && command->which < static_cast<int>(kAdjustableSurfaces) &&
                command->number[0] >= 0.0 && command->number[1] >= 0.0,
            "so is a surface");
  if (command->kind == Kind::method) require(command->which >= 0, "a method is an index");
}

void check_request(std::string_view bytes) {
  const HttpParse parse = parse_request(bytes);
  require(parse.used <= bytes.size(), "no more than there is");
  if (parse.status != Parsed::whole) return;
  require(parse_request(bytes.substr(0, parse.used)).status == Parsed::whole,
          "what follows a request is no part of it");
  require(parse_request(bytes.substr(0, parse.used - 1)).status != Parsed::whole, "nor is it whole before its end");
  // The host is repeated in a header of the answer.
  const auto is_control = [](char c) { return (c >= 0 && c < ' ' && c != '\t') || c == '\x7f'; };
  require(std::none_of(parse.request.host.begin(), parse.request.host.end(), is_control), "a host is one line");
  if (is_literal_host(parse.request.host, 45080))
    require(parse.request.host.find_first_of("/@# \"'<>") == std::string::npos, "a literal host is an address");
  static_cast<void>(is_own_origin(parse.request));
  if (is_websocket_upgrade(parse.request))
    require(websocket_accept(parse.request.websocket_key).size() == 28, "20 bytes in base64");
}

/// Events as text, until one that stays.
std::string read_in_pieces(std::string_view bytes, std::size_t piece) {
  WebSocketReader reader;
  std::string seen;
  for (std::size_t at = 0; at < bytes.size(); at += piece) {
    reader.add(bytes.substr(at, piece));
    for (Event e = reader.next(); e.kind != Event::Kind::nothing; e = reader.next()) {
      require(e.payload.size() <= kLargestMessage, "a message is not longer than allowed");
      seen += static_cast<char>('0' + static_cast<int>(e.kind));
      seen += e.payload + std::to_string(e.close_code) + ';';
      if (e.kind == Event::Kind::text) check_command(e.payload);
      if (e.kind == Event::Kind::error || e.kind == Event::Kind::close) return seen;
    }
  }
  return seen;
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace twoport;
  const std::string_view bytes{reinterpret_cast<const char*>(data), size};
  check_command(bytes);
  check_request(bytes);
  require(read_in_pieces(bytes, 1) == read_in_pieces(bytes, size + 1), "pieces of any size are the same message");
  return 0;
}
