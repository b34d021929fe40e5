#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "common/page/channel.h"
#include "common/page/http.h"
#include "common/page/websocket.h"

namespace twoport {
namespace {

using Kind = WebSocketReader::Event::Kind;

/// A client's frame, masked with 1, 2, 3, 4.
std::string client_frame(unsigned first, std::string_view payload, bool masked = true) {
  std::string out;
  out += static_cast<char>(first);
  const unsigned bit = masked ? 0x80 : 0;
  if (payload.size() < 126) {
    out += static_cast<char>(bit | payload.size());
  } else {
    out += static_cast<char>(bit | 126);
    out += static_cast<char>(payload.size() >> 8);
    out += static_cast<char>(payload.size() & 0xff);
  }
  if (masked) out += "\1\2\3\4";
  for (std::size_t i = 0; i < payload.size(); ++i)
    out += masked ? static_cast<char>(payload[i] ^ static_cast<char>(1 + i % 4)) : payload[i];
  return out;
}

std::string request(std::string_view headers, std::string_view line = "GET / HTTP/1.1") {
  return std::string{line} + "\r\n" + std::string{headers} + "\r\n";
}

TEST(WebSocket, AcceptIsThatOfTheStandardsExample) {  // RFC 6455, 1.3
  EXPECT_EQ(websocket_accept("dGhlIHNhbXBsZSBub25jZQ=="), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
}

TEST(WebSocket, ReadsTheStandardsExamples) {  // RFC 6455, 5.7
  const WebSocketFrame hello = parse_client_frame("\x81\x85\x37\xfa\x21\x3d\x7f\x9f\x4d\x51\x58");
  EXPECT_EQ(hello.status, Parsed::whole);
  EXPECT_EQ(hello.payload, "Hello");
  EXPECT_EQ(hello.used, 11u);
  EXPECT_EQ(parse_client_frame("\x81\x05Hello").close_code, 1002) << "a client must mask";
  EXPECT_EQ(websocket_frame(WebSocketOpcode::text, "Hello"), "\x81\x05Hello");
}

TEST(WebSocket, EveryPrefixOfAFrameIsIncomplete) {
  const std::string frame = client_frame(0x81, std::string(300, 'x'));
  for (std::size_t size = 0; size < frame.size(); ++size)
    ASSERT_EQ(parse_client_frame(std::string_view{frame}.substr(0, size)).status, Parsed::incomplete) << size;
  EXPECT_EQ(parse_client_frame(frame).payload, std::string(300, 'x'));
}

TEST(WebSocket, RefusesWhatTheStandardForbids) {
  EXPECT_EQ(parse_client_frame(client_frame(0xc1, "")).close_code, 1002) << "reserved bit";
  EXPECT_EQ(parse_client_frame(client_frame(0x83, "")).close_code, 1002) << "reserved opcode";
  EXPECT_EQ(parse_client_frame(client_frame(0x09, "")).close_code, 1002) << "fragmented ping";
  EXPECT_EQ(parse_client_frame(client_frame(0x89, std::string(126, 'x'))).close_code, 1002) << "long ping";
  EXPECT_EQ(parse_client_frame(std::string_view{"\x81\xfe\0\x05", 4}).close_code, 1002) << "length not shortest";
  EXPECT_EQ(parse_client_frame(client_frame(0x81, std::string(kLargestMessage + 1, 'x'))).close_code, 1009);
  EXPECT_EQ(parse_client_frame(client_frame(0x81, std::string(kLargestMessage, 'x'))).status, Parsed::whole);
}

TEST(WebSocket, AssemblesFragmentsWithPingsBetween) {
  const std::string all = client_frame(0x01, "tar") + client_frame(0x89, "p") + client_frame(0x00, "g") +
                          client_frame(0x80, "et") + client_frame(0x88, "\x03\xe8");
  for (const std::size_t piece : {std::size_t{1}, std::size_t{3}, all.size()}) {
    WebSocketReader reader;
    std::string seen;
    for (std::size_t at = 0; at < all.size(); at += piece) {
      reader.add(std::string_view{all}.substr(at, piece));
      for (auto e = reader.next(); e.kind != Kind::nothing; e = reader.next()) {
        seen += e.kind == Kind::text ? "text " + e.payload + ";" : e.kind == Kind::ping ? "ping;" : "";
        if (e.kind == Kind::close) {
          seen += "close " + std::to_string(e.close_code);
          break;
        }
      }
    }
    EXPECT_EQ(seen, "ping;text target;close 1000") << piece;
  }
}

TEST(WebSocket, AnErrorStays) {
  WebSocketReader reader;
  reader.add(client_frame(0x80, "continues nothing"));
  EXPECT_EQ(reader.next().close_code, 1002);
  reader.add(client_frame(0x81, "release"));
  EXPECT_EQ(reader.next().kind, Kind::error);
  WebSocketReader fragments;
  for (int i = 0; i < 3; ++i) fragments.add(client_frame(i == 0 ? 0x01 : 0x00, std::string(400, 'x')));
  EXPECT_EQ(fragments.next().close_code, 1009) << "many fragments are one message";
}

/// Bytes of every kind, half of them mutations of valid ones, neither crash the parsers nor make them use more than
/// they got.
TEST(WebSocket, SurvivesRandomBytes) {
  std::mt19937 random{7};
  const std::vector<std::string> valid{client_frame(0x81, "target 0 0 0 0 0 0"), client_frame(0x88, "\x03\xe8"),
                                       client_frame(0x01, "a") + client_frame(0x80, std::string(200, 'b')),
                                       request("Host: localhost:80\r\nUpgrade: websocket\r\n")};
  for (int i = 0; i < 200000; ++i) {
    std::string bytes = i % 2 == 0 ? valid[random() % valid.size()] : std::string(random() % 40, '\0');
    const std::size_t changes = i % 2 == 0 ? 1 + random() % 4 : bytes.size();
    for (std::size_t j = 0; j < changes; ++j)
      bytes[i % 2 == 0 ? random() % bytes.size() : j] = static_cast<char>(random() & 0xff);
    const WebSocketFrame frame = parse_client_frame(bytes);
    ASSERT_LE(frame.used, bytes.size());
    ASSERT_LE(frame.payload.size(), kLargestMessage);
    const HttpParse http = parse_request(bytes);
    ASSERT_LE(http.used, bytes.size());
    WebSocketReader reader;
    reader.add(bytes);
    for (int n = 0; n < 50; ++n) {
      const auto e = reader.next();
      if (e.kind == Kind::nothing || e.kind == Kind::error || e.kind == Kind::close) break;
      ASSERT_LT(n, 49);
    }
  }
}

TEST(Http, ReadsARequest) {
  const std::string text = request(
      "Host: localhost:45080\r\nOrigin: http://localhost:45080\r\nupgrade: WebSocket\r\n"
      "Connection: keep-alive, Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
      "Sec-WebSocket-Version: 13\r\n",
      "GET /live HTTP/1.1");
  const HttpParse parse = parse_request(text + "rest");
  ASSERT_EQ(parse.status, Parsed::whole);
  EXPECT_EQ(parse.used, text.size());
  EXPECT_EQ(parse.request.target, "/live");
  EXPECT_TRUE(is_websocket_upgrade(parse.request));
  EXPECT_TRUE(is_own_origin(parse.request));
  for (std::size_t size = 0; size < text.size(); ++size)
    ASSERT_EQ(parse_request(std::string_view{text}.substr(0, size)).status, Parsed::incomplete);
}

TEST(Http, RefusesMalformedRequests) {
  for (const std::string& bad :
       {request("", "GET /"), request("", "GET x HTTP/1.1"), request("", "GET / HTTP/2"), request("no colon\r\n"),
        request("Host : a\r\n"), request("Host: a\r\nHost: b\r\n"), request("Content-Length: 5\r\n"),
        request("Transfer-Encoding: chunked\r\n"), request("Host: \1\r\n"), std::string(kLargestRequest + 1, 'x')})
    EXPECT_EQ(parse_request(bad).status, Parsed::invalid) << bad.substr(0, 60);
}

TEST(Http, OnlyLiteralHostsOfThisPort) {
  for (const char* good : {"127.0.0.1:45080", "localhost:45080", "LOCALHOST:45080", "[::1]:45080", "192.168.1.7:45080"})
    EXPECT_TRUE(is_literal_host(good, 45080)) << good;
  for (const char* bad :
       {"", "evil.example:45080", "127.0.0.1", "127.0.0.1:80", "localhost:450800", "127.0.0.1.evil:45080",
        "1.2.3:45080", "1.2.3.256:45080", "[evil]:45080", "localhost:", "127.0.0.1:45080x"})
    EXPECT_FALSE(is_literal_host(bad, 45080)) << bad;
  EXPECT_TRUE(is_literal_host("127.0.0.1", 80));
}

TEST(Http, AnotherSitesOriginIsNotOwn) {
  HttpRequest r;
  r.host = "localhost:45080";
  for (const char* bad : {"", "null", "http://evil.example", "https://localhost:45080", "http://localhost:450801"}) {
    r.origin = bad;
    EXPECT_FALSE(is_own_origin(r)) << bad;
  }
  r.host = "";
  r.origin = "http://";
  EXPECT_FALSE(is_own_origin(r));
}

TEST(PageCommand, IsClampedToItsLimits) {
  const auto target = parse_page_command("target 9 -9 0.01 0 0 -4");
  ASSERT_TRUE(target);
  EXPECT_EQ(target->kind, PageCommand::Kind::target);
  EXPECT_EQ(target->number, (std::array<double, 6>{kPageReach, -kPageReach, 0.01, 0, 0, -kPageTurn}));
  EXPECT_EQ(parse_page_command("grip 1e9")->number[0], kPageGripMost);
  EXPECT_EQ(parse_page_command("grip -1")->number[0], kPageGripLeast);
  EXPECT_EQ(parse_page_command("opening 0.04")->kind, PageCommand::Kind::opening);
  EXPECT_EQ(parse_page_command("opening 0.04")->number[0], 0.04);
  EXPECT_EQ(parse_page_command("opening -1")->number[0], 0.0);
  EXPECT_EQ(parse_page_command("opening 9")->number[0], kPageReach);
  const auto network = parse_page_command("network to_master 1e6 50.5 1");
  ASSERT_TRUE(network);
  EXPECT_EQ(network->which, 1);
  EXPECT_EQ(network->number[0], kPageDelayMs);
  EXPECT_EQ(network->number[2], kPageLoss);
  EXPECT_EQ(parse_page_command("release")->kind, PageCommand::Kind::release);
  EXPECT_EQ(parse_page_command("method 3")->which, 3);
  const auto surface = parse_page_command("surface 2 2e6 -1");
  ASSERT_TRUE(surface);
  EXPECT_EQ(surface->kind, PageCommand::Kind::surface);
  EXPECT_EQ(surface->which, 2);
  EXPECT_EQ(surface->number[0], 2e6) << "the slave judges";
  EXPECT_EQ(surface->number[1], 0.0);
  EXPECT_EQ(parse_page_command("surface 0 3 9")->number[1], 9.0);
  EXPECT_FALSE(parse_page_command("surface 4 1 0"));
  EXPECT_FALSE(parse_page_command("surface -1 1 0"));
  EXPECT_FALSE(parse_page_command("surface -0.5 1 0"));
  EXPECT_FALSE(parse_page_command("method -1"));
}

TEST(PageCommand, RefusesAnythingElse) {
  for (const char* bad : {"",
                          "x",
                          "target",
                          "target 0 0 0 0 0",
                          "target 0 0 0 0 0 0 0",
                          "target nan 0 0 0 0 0",
                          "target inf 0 0 0 0 0",
                          "target 0,1 0 0 0 0 0",
                          "target  0 0 0 0 0 0",
                          "grip",
                          "grip 1 1",
                          "opening",
                          "opening nan",
                          "opening 0 0",
                          "network up 1 1 0",
                          "network to_slave 1 1",
                          "release now",
                          "method 1.5",
                          "method x",
                          "surface 0 1",
                          "surface 0.5 1 0",
                          "surface 0 nan 0",
                          "surface 0 1 0 0"})
    EXPECT_FALSE(parse_page_command(bad)) << bad;
}

TEST(PageSample, FieldsCoverTheWholeSample) {
  PageSample sample;
  std::size_t numbers = 0;
  for_each_page_field(sample, [&](const char*, std::size_t size, const double*) { numbers += size; });
  EXPECT_EQ(numbers * sizeof(double), sizeof(PageSample));
}

}  // namespace
}  // namespace twoport
