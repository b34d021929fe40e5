#include "common/platform/page_server.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/platform/foxglove_server.h"
#include "common/platform/web_server.h"

namespace twoport::page_server_test {
namespace {

using namespace std::chrono_literals;

/// A blocking connection to a port of 127.0.0.1.
class Connection {
 public:
  explicit Connection(std::uint16_t port, int receive_buffer = 0) : fd_{socket(AF_INET, SOCK_STREAM, 0)} {
    const timeval patience{5, 0};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    if (receive_buffer > 0) setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(fd_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) throw IoError{"no connection"};
  }
  ~Connection() { close(fd_); }
  Connection(const Connection&) = delete;
  [[nodiscard]] bool takes(const std::string& text) const {
    return send(fd_, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
  }
  void write(const std::string& text) const { ASSERT_TRUE(takes(text)); }
  /// Until `text` has been received, the connection ends or five seconds pass.
  std::string read_until(const std::string& text) {
    std::array<char, 4096> some{};
    for (std::size_t from = 0; text.empty() || got_.find(text, from) == got_.npos;) {
      from = got_.size() - std::min(got_.size(), text.size());
      const ssize_t size = recv(fd_, some.data(), some.size(), 0);
      if (size <= 0) break;
      got_.append(some.data(), static_cast<std::size_t>(size));
    }
    return got_;
  }
  std::string read_all() { return read_until(""); }

 private:
  int fd_;
  std::string got_;
};

struct Served {
  explicit Served(PageServer::Options o = {}) : options{std::move(o)} {}
  static PageServer::Options complete(PageServer::Options o) {
    if (o.address.empty()) o.address = "127.0.0.1:0";
    o.introduction = "{\"scene\":\"s\"}";
    o.page = "<p>page";
    return o;
  }
  PageServer::Options options;
  PageChannel channel;
  PageServer server{complete(options), channel, PageJudge{Scene{}, 500.0, true}};
  std::uint16_t port = static_cast<std::uint16_t>(std::stoi(server.url().substr(server.url().rfind(':') + 1)));
  std::string host = "127.0.0.1:" + std::to_string(port);

  std::string get(const std::string& target, const std::string& as_host) {
    Connection c{port};
    c.write("GET " + target + " HTTP/1.1\r\nHost: " + as_host + "\r\n\r\n");
    return c.read_all();
  }
  /// A WebSocket that has been greeted.
  void join(Connection& c) {
    c.write(upgrade("http://" + host));
    ASSERT_NE(c.read_until("{\"scene\":\"s\"}").find("101 Switching"), std::string::npos);
  }
  std::string upgrade(const std::string& origin, const std::string& query = "") {
    return "GET /live" + query + " HTTP/1.1\r\nHost: " + host + "\r\nOrigin: " + origin +
           "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
           "Sec-WebSocket-Version: 13\r\n\r\n";
  }
};

/// A client's frame, masked with 1, 2, 3, 4.
std::string masked(unsigned first, const std::string& payload) {
  std::string out{static_cast<char>(first)};
  if (payload.size() < 126) {
    out += static_cast<char>(0x80 | payload.size());
  } else {
    out += {static_cast<char>(0xfe), static_cast<char>(payload.size() >> 8), static_cast<char>(payload.size() & 0xff)};
  }
  out += "\1\2\3\4";
  for (std::size_t i = 0; i < payload.size(); ++i) out += static_cast<char>(payload[i] ^ static_cast<char>(1 + i % 4));
  return out;
}
/// A frame that closes, as the server sends it.
std::string closes(unsigned code) {
  return {'\x88', '\x02', static_cast<char>(code >> 8), static_cast<char>(code & 0xff)};
}

template <class Row>
bool soon_pops(Ring<Row>& ring, Row& row) {
  for (int i = 0; i < 500; ++i) {
    if (ring.try_pop(row)) return true;
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

TEST(PageServer, ServesItsPageWithAPolicy) {
  Served s;
  const std::string page = s.get("/", s.host);
  EXPECT_NE(page.find("200 OK"), page.npos) << page;
  EXPECT_NE(page.find("<p>page"), page.npos);
  EXPECT_NE(page.find("Content-Security-Policy: connect-src 'self'"), page.npos);
  EXPECT_NE(s.get("/../etc/passwd", s.host).find("404"), std::string::npos);
}

TEST(PageServer, RefusesOtherNamesAndOtherSites) {
  Served s;
  EXPECT_NE(s.get("/", "evil.example:" + std::to_string(s.port)).find("421"), std::string::npos);
  Connection c{s.port};
  c.write(s.upgrade("http://evil.example"));
  EXPECT_NE(c.read_all().find("403"), std::string::npos);
}

TEST(PageServer, RefusesMalformedRequests) {
  Served s;
  const std::string host = "Host: " + s.host + "\r\n", get = "GET / HTTP/1.1\r\n" + host;
  for (const std::string& bad :
       {std::string{"\x16\x03\x01 not http\r\n\r\n"}, "GET /\r\n" + host + "\r\n", "GET x HTTP/1.1\r\n" + host + "\r\n",
        "GET / HTTP/2\r\n" + host + "\r\n", get + "no colon\r\n\r\n", get + "Origin : a\r\n\r\n", get + host + "\r\n",
        get + "Origin: a\r\nOrigin: b\r\n\r\n", get + "Content-Length: 5\r\n\r\n",
        get + "Transfer-Encoding: chunked\r\n\r\n", get + "Origin: \1\r\n\r\n", std::string(kLargestRequest + 1, 'x'),
        get + "Origin: " + std::string(kLargestRequest, 'x') + "\r\n\r\n",
        s.upgrade("http://" + s.host) + masked(0x81, "grip 300")}) {
    Connection c{s.port};
    c.write(bad);
    EXPECT_NE(c.read_all().find("400 Bad Request"), std::string::npos) << bad.substr(0, 80);
  }
  EXPECT_NE(s.get("/live", s.host).find("426 Upgrade Required"), std::string::npos);
  std::string head = "HEAD / HTTP/1.1\r\n" + host + "\r\n", post = "POST / HTTP/1.1\r\n" + host + "\r\n";
  Connection asks{s.port}, gives{s.port};
  asks.write(head);
  const std::string headers = asks.read_all();
  EXPECT_NE(headers.find("Content-Length: 7\r\n"), std::string::npos) << headers;
  EXPECT_TRUE(headers.ends_with("\r\n\r\n")) << headers;
  gives.write(post);
  EXPECT_NE(gives.read_all().find("405"), std::string::npos);
}

/// RFC 6455, section 5, and the limit of a message.
TEST(PageServer, EndsWebSocketsThatBreakTheStandard) {
  Served s{{.silence = 300ms}};
  const std::string large(kLargestMessage + 1, 'x'), part(400, 'x');
  for (const auto& [frames, code] : std::vector<std::pair<std::string, unsigned>>{
           {std::string{"\x81\x05Hello"}, 1002},  // a client must mask
           {masked(0xc1, ""), 1002},              // reserved bit
           {masked(0x83, ""), 1002},              // reserved opcode
           {masked(0x09, ""), 1002},              // fragmented ping
           {masked(0x89, std::string(126, 'x')), 1002},
           {std::string{"\x81\xfe\0\x05\1\2\3\4", 8}, 1002},  // length not in its shortest form
           {masked(0x80, "continues nothing"), 1002},
           {masked(0x82, "binary"), 1003},
           {masked(0x81, "\xff"), 1007},
           {masked(0x81, large), 1009},
           {masked(0x01, part) + masked(0x00, part) + masked(0x00, part), 1009}}) {
    Connection c{s.port};
    s.join(c);
    c.write(frames);
    const std::string answer = c.read_all();
    EXPECT_NE(answer.find(closes(code)), answer.npos) << code << " after " << static_cast<int>(frames[0]);
  }
}

/// One that has made room, and answers pings but not the close frame.
TEST(PageServer, WhoDoesNotAnswerACloseFrameIsClosed) {
  Served s{{.silence = 300ms, .spectator_time = 0ms}};
  std::vector<std::unique_ptr<Connection>> nine;
  for (int k = 0; k < 9; ++k) s.join(*nine.emplace_back(std::make_unique<Connection>(s.port)));
  const auto begin = std::chrono::steady_clock::now();
  while (nine.front()->takes(masked(0x8a, "")) && std::chrono::steady_clock::now() - begin < 4s)
    std::this_thread::sleep_for(20ms);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 3s);
}

TEST(PageServer, AssemblesFragmentsWithPingsBetween) {
  Served s;
  const std::string all = masked(0x01, "gri") + masked(0x89, "p") + masked(0x00, "p ") + masked(0x80, "300") +
                          masked(0x81, "grip 200." + std::string(kLargestMessage - 9, '0')) + masked(0x88, "\x03\xe8");
  for (const std::size_t piece : {std::size_t{1}, std::size_t{3}, all.size()}) {
    Connection c{s.port};
    s.join(c);
    for (std::size_t at = 0; at < all.size(); at += piece) c.write(all.substr(at, piece));
    const std::string answer = c.read_all();
    EXPECT_NE(answer.find("\x8a\x01p"), answer.npos) << "a pong";
    EXPECT_NE(answer.find(closes(1000)), answer.npos);
    PageCommand command;
    ASSERT_TRUE(soon_pops(s.channel.hand, command)) << piece;
    EXPECT_EQ(command.number[0], 300.0);
    ASSERT_TRUE(soon_pops(s.channel.hand, command)) << "a message of the largest size";
    EXPECT_EQ(command.number[0], 200.0);
  }
}

TEST(PageServer, SendsSamplesAndTakesCommands) {
  Served s;
  Connection c{s.port};
  c.write(s.upgrade("http://" + s.host));
  const std::string hello = c.read_until("{\"scene\":\"s\"}");
  EXPECT_NE(hello.find("Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), hello.npos) << hello;
  PageSample sample;
  sample.t_s = 1.25;
  s.channel.samples.try_push(sample);
  const std::string number{"\0\0\0\0\0\0\xf4\x3f", 8};  // little-endian
  EXPECT_NE(c.read_until(number).find(number), std::string::npos);

  c.write(masked(0x81, "grip 300") + masked(0x81, "network to_slave 10 1 0.1"));
  PageCommand command;
  ASSERT_TRUE(soon_pops(s.channel.hand, command));
  EXPECT_EQ(command.number[0], 300.0);
  ASSERT_TRUE(soon_pops(s.channel.commands, command));
  EXPECT_EQ(command.kind, PageCommand::Kind::network);
}

/// One page controls: the others move nothing, whatever they send, until it goes or they take over while the handle is free.
TEST(PageServer, OnlyThePageThatControlsChangesAnything) {
  Served s;
  auto first = std::make_unique<Connection>(s.port);
  Connection other{s.port};
  s.join(*first);
  EXPECT_NE(first->read_until("\"controls\":true").find("\"controls\":true"), std::string::npos);
  s.join(other);
  EXPECT_NE(other.read_until("\"controls\":false").find("\"controls\":false"), std::string::npos);
  const std::string everything = masked(0x81, "grip 301") + masked(0x81, "opening 0.01") + masked(0x81, "method 1") +
                                 masked(0x81, "surface 0 300 0") + masked(0x81, "network to_slave 9 0 0") +
                                 masked(0x81, "release");
  const std::string last = masked(0x81, "grip 302") + masked(0x81, "network to_master 8 0 0");
  PageCommand hand, command;
  // Nobody holds the handle: the other page watches all the same.
  other.write(everything + masked(0x89, "1"));
  other.read_until(std::string{"\x8a\x01"} + "1");
  first->write(last);
  ASSERT_TRUE(soon_pops(s.channel.hand, hand) && soon_pops(s.channel.commands, command));
  EXPECT_TRUE(hand.number[0] == 302.0 && command.number[0] == 8.0) << hand.number[0] << ", " << command.number[0];
  // The first holds it: it cannot be taken either.
  first->write(masked(0x81, "target 0.01 0 0 0 0 0"));
  ASSERT_TRUE(soon_pops(s.channel.hand, hand));
  other.write(masked(0x81, "take") + masked(0x81, "target 0.02 0 0 0 0 0") + everything + masked(0x89, "2"));
  other.read_until(std::string{"\x8a\x01"} + "2");
  first->write(last);
  ASSERT_TRUE(soon_pops(s.channel.hand, hand) && soon_pops(s.channel.commands, command));
  EXPECT_TRUE(hand.number[0] == 302.0 && command.number[0] == 8.0) << hand.number[0] << ", " << command.number[0];
  // It is free: the other takes over, and the first watches.
  first->write(masked(0x81, "release") + masked(0x89, "3"));
  first->read_until(std::string{"\x8a\x01"} + "3");
  ASSERT_TRUE(soon_pops(s.channel.hand, hand));
  other.write(masked(0x81, "take") + masked(0x81, "grip 303"));
  ASSERT_TRUE(soon_pops(s.channel.hand, hand));
  EXPECT_EQ(hand.number[0], 303.0);
  EXPECT_NE(first->read_until("\"controls\":false").find("\"controls\":false"), std::string::npos);
}

TEST(PageServer, WhoeverIsLeftControls) {
  Served s;
  auto first = std::make_unique<Connection>(s.port);
  Connection other{s.port};
  s.join(*first);
  s.join(other);
  first.reset();
  EXPECT_NE(other.read_until("\"controls\":true").find("\"controls\":true"), std::string::npos);
  other.write(masked(0x81, "grip 300"));
  PageCommand command;
  EXPECT_TRUE(soon_pops(s.channel.hand, command));
}

TEST(PageServer, TellsTheVerdictAndTheEnd) {
  Served s;
  Connection c{s.port};
  s.join(c);
  PageSample sample;
  sample.hand_energy_j = -0.002;
  s.channel.samples.try_push(sample);
  EXPECT_NE(c.read_until("mJ more than").find("\"verdict\":\"not passive\""), std::string::npos);
  s.server.end("STABLE: bounded and decaying");
  EXPECT_NE(c.read_until("decaying").find("\"end\":\"STABLE: bounded and decaying\""), std::string::npos);
}

TEST(PageServer, BeyondThisMachineATokenIsNeeded) {
  Served s{{.address = "0.0.0.0:0"}};
  const std::string& url = s.server.url();
  const std::string query = url.substr(url.rfind('/') + 1);
  ASSERT_TRUE(query.starts_with("?token=") && query.size() == 7 + 32) << url;
  EXPECT_EQ(url.find("0.0.0.0"), url.npos) << "nobody can open that address";
  EXPECT_NE(s.get("/" + query, s.host).find("<p>page"), std::string::npos);
  std::string wrong = query;
  wrong.back() = wrong.back() == '0' ? '1' : '0';
  for (const std::string& without :
       std::vector<std::string>{"/", "/?", "/?token=", "/" + wrong, "/" + query + "0", "/index.html"}) {
    const std::string answer = s.get(without, s.host);
    EXPECT_NE(answer.find("403"), answer.npos) << without;
    EXPECT_NE(answer.find("token"), answer.npos) << without;
    EXPECT_EQ(answer.find("<p>page"), answer.npos) << without;
  }
  for (const std::string& given : {std::string{}, wrong}) {
    Connection c{s.port};
    c.write(s.upgrade("http://" + s.host, given));
    EXPECT_NE(c.read_all().find("403"), std::string::npos) << given;
  }
  Connection c{s.port};
  c.write(s.upgrade("http://" + s.host, query));
  EXPECT_NE(c.read_until("{\"scene\":\"s\"}").find("101 Switching"), std::string::npos);
}

TEST(PageServer, AClosedConnectionReleasesTheHandle) {
  Served s;
  {
    Connection c{s.port};
    s.join(c);
    c.write(masked(0x81, "target 0.01 0 0 0 0 0"));
    PageCommand command;
    ASSERT_TRUE(soon_pops(s.channel.hand, command));
    EXPECT_EQ(command.kind, PageCommand::Kind::target);
  }
  PageCommand command;
  ASSERT_TRUE(soon_pops(s.channel.hand, command));
  EXPECT_EQ(command.kind, PageCommand::Kind::release);
}

TEST(PageServer, AMalformedCommandEndsTheConnectionAndReleases) {
  Served s{{.silence = 300ms}};
  Connection c{s.port};
  s.join(c);
  c.write(masked(0x81, "target 0 0 0 0 0 0") + masked(0x81, "target nan 0 0 0 0 0"));
  PageCommand command;
  ASSERT_TRUE(soon_pops(s.channel.hand, command));
  ASSERT_TRUE(soon_pops(s.channel.hand, command));
  EXPECT_EQ(command.kind, PageCommand::Kind::release);
  EXPECT_NE(c.read_all().find("\x88\x02\x03\xf0"), std::string::npos) << "close 1008";
}

/// A client that never reads does not hold up the server, another client, or the samples' ring.
TEST(PageServer, AClientThatNeverReadsHoldsUpNobody) {
  Served s;
  Connection deaf{s.port, 2048}, reader{s.port};
  deaf.write(s.upgrade("http://" + s.host));
  reader.write(s.upgrade("http://" + s.host));
  reader.read_until("{\"scene\":\"s\"}");
  PageSample sample;
  const auto end = std::chrono::steady_clock::now() + 1500ms;
  while (std::chrono::steady_clock::now() < end) {
    for (int i = 0; i < 30; ++i) s.channel.samples.try_push(sample);
    std::this_thread::sleep_for(2ms);
  }
  sample.t_s = 4711.5;
  s.channel.samples.try_push(sample);
  const std::string number{"\0\0\0\0\x80\x67\xb2\x40", 8};  // little-endian
  EXPECT_NE(reader.read_until(number).find(number), std::string::npos);
  EXPECT_EQ(s.channel.samples.dropped(), 0u);
}

TEST(PageServer, IdleConnectionsKeepNobodyOut) {
  Served s;
  std::vector<std::unique_ptr<Connection>> idle;
  for (int k = 0; k < 300; ++k) idle.push_back(std::make_unique<Connection>(s.port));
  EXPECT_NE(s.get("/", s.host).find("200 OK"), std::string::npos);
  // One that says a little at a time gains none.
  EXPECT_EQ(idle.front()->read_all(), "");
}

TEST(FoxgloveServer, IdleConnectionsKeepNobodyOutAndEightListen) {
  const FoxgloveServer server{"127.0.0.1:0", "test"};
  const auto port = static_cast<std::uint16_t>(std::stoi(server.url().substr(server.url().rfind(':') + 1)));
  std::vector<std::unique_ptr<Connection>> idle, listening;
  for (int k = 0; k < 100; ++k) idle.push_back(std::make_unique<Connection>(port));
  const auto answer = [&](Connection& c, const std::string& protocols, const std::string& until) {
    c.write(
        "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: "
        "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: " +
        protocols + "\r\n\r\n");
    return c.read_until(until);
  };
  for (int k = 0; k < 8; ++k) {
    listening.push_back(std::make_unique<Connection>(port));
    const std::string hello = answer(*listening.back(), "other, foxglove.sdk.v1", "serverInfo");
    EXPECT_NE(hello.find("Sec-WebSocket-Protocol: foxglove.sdk.v1"), hello.npos) << hello;
    EXPECT_NE(hello.find("serverInfo"), hello.npos) << k;
  }
  Connection ninth{port}, other{port};
  EXPECT_NE(answer(ninth, "foxglove.websocket.v1", "").find("503"), std::string::npos);
  EXPECT_NE(answer(other, "foxglove.websocket.v2", "").find("426"), std::string::npos);
}

TEST(PageServer, ARequestThatIsNotCompleteInTimeEnds) {
  Served s{{.request_time = 300ms}};
  Connection c{s.port};
  const auto begin = std::chrono::steady_clock::now();
  std::thread slow{[&] {
    for (const char letter : std::string{"GET /"}) {
      c.write({letter});
      std::this_thread::sleep_for(50ms);
    }
  }};
  slow.join();
  EXPECT_EQ(c.read_all(), "");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 2s);
}

TEST(PageServer, SilentWebSocketsMakeRoomAndOthersStay) {
  Served s{{.ping_every = 100ms, .silence = 400ms}};
  const auto opened = [&](Connection& c) {
    c.write(s.upgrade("http://" + s.host));
    return c.read_until("{\"scene\":\"s\"}").find("101 Switching") != std::string::npos;
  };
  // This one answers the pings.
  Connection alive{s.port};
  ASSERT_TRUE(opened(alive));
  std::atomic<bool> done{false};
  std::thread answers{[&] {
    while (!done) {
      alive.write(masked(0x8a, ""));
      std::this_thread::sleep_for(50ms);
    }
  }};
  std::vector<std::unique_ptr<Connection>> silent;
  for (int k = 0; k < 7; ++k) {
    silent.push_back(std::make_unique<Connection>(s.port));
    EXPECT_TRUE(opened(*silent.back())) << k;
  }
  Connection ninth{s.port};
  ninth.write(s.upgrade("http://" + s.host));
  EXPECT_NE(ninth.read_all().find("503"), std::string::npos) << "eight are open";
  const std::string end = silent.front()->read_all();
  EXPECT_NE(end.find(std::string("\x89\x00", 2)), std::string::npos) << "it was pinged";
  Connection next{s.port};
  EXPECT_TRUE(opened(next));
  done = true;
  answers.join();
  PageCommand command;
  alive.write(masked(0x81, "grip 300"));
  EXPECT_TRUE(soon_pops(s.channel.hand, command)) << "it was not ended";
}

TEST(PageServer, SpectatorsThatOnlyAnswerPingsMakeRoomAndWhoHoldsTheHandleStays) {
  Served s{{.ping_every = 50ms, .spectator_time = 400ms}};
  const auto opened = [&](Connection& c) {
    c.write(s.upgrade("http://" + s.host));
    return c.read_until("{\"scene\":\"s\"}").find("101 Switching") != std::string::npos;
  };
  std::vector<std::unique_ptr<Connection>> eight;
  for (int k = 0; k < 8; ++k) {
    eight.push_back(std::make_unique<Connection>(s.port));
    ASSERT_TRUE(opened(*eight.back())) << k;
  }
  eight[0]->write(masked(0x81, "target 0.01 0 0 0 0 0"));
  PageCommand command;
  ASSERT_TRUE(soon_pops(s.channel.hand, command));
  std::atomic<bool> done{false};
  std::thread pongs{[&] {
    while (!done) {
      for (const auto& c : eight) c->write(masked(0x8a, ""));
      std::this_thread::sleep_for(20ms);
    }
  }};
  Connection early{s.port};
  early.write(s.upgrade("http://" + s.host));
  EXPECT_NE(early.read_all().find("503"), std::string::npos) << "nobody has been idle for long enough";
  std::this_thread::sleep_for(500ms);
  Connection ninth{s.port};
  EXPECT_TRUE(opened(ninth)) << "a spectator makes room";
  done = true;
  pongs.join();
  eight[0]->write(masked(0x81, "target 0.02 0 0 0 0 0"));
  EXPECT_TRUE(soon_pops(s.channel.hand, command)) << "who holds the handle was not ended";
}

TEST(PageServer, SaysWhichAddressIsTaken) {
  Served s;
  PageChannel other;
  try {
    PageServer second{{.address = s.host}, other, PageJudge{Scene{}, 500.0, true}};
    FAIL();
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("--page " + s.host), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace twoport::page_server_test
