#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "common/page/channel.h"
#include "common/platform/page_server.h"
#include "tests/fuzz/input.h"

// What a client of the live page may send: a request, frames of a WebSocket, the commands in them. The server answers with HTTP or
// nothing, passes on the same commands however they arrive in pieces, and their numbers are finite and within their limits.
namespace twoport {
namespace {

void check_command(const PageCommand& command) {
  using Kind = PageCommand::Kind;
  for (std::size_t i = 0; i < command.number.size(); ++i) {
    const double number = command.number[i];
    require(std::isfinite(number), "a command's numbers are finite");
    if (command.kind == Kind::target)
      require(std::abs(number) <= (i < 3 ? kPageReach : kPageTurn), "a target is within reach");
  }
  if (command.kind == Kind::grip)
    require(command.number[0] >= kPageGripLeast && command.number[0] <= kPageGripMost, "so is the grip");
  if (command.kind == Kind::network)
    require(command.number[0] >= 0.0 && command.number[0] <= kPageDelayMs && command.number[1] >= 0.0 &&
                command.number[1] <= kPageJitterMs && command.number[2] >= 0.0 && command.number[2] <= kPageLoss &&
                (command.which == 0 || command.which == 1),
            "so is the network");
  if (command.kind == Kind::surface)
    require(command.which >= 0 && command.which < static_cast<int>(kAdjustableSurfaces) && command.number[0] >= 0.0 &&
                command.number[1] >= 0.0,
            "so is a surface");
  if (command.kind == Kind::clutch || command.kind == Kind::lock)
    require(command.which >= 0 && command.which < (command.kind == Kind::clutch ? 2 : 64), "so are clutch and locks");
  if (command.kind == Kind::scale)
    require(command.number[0] >= kPageScaleLeast && command.number[0] <= 1.0 && command.number[1] >= 0.0 &&
                command.number[1] <= 1.0,
            "so are scales");
  if (command.kind == Kind::method) require(command.which >= 0, "a method is an index");
}

struct Server {
  PageChannel channel;
  PageServer server{{.address = "127.0.0.1:0", .introduction = "introduction", .page = "<p>page"},
                    channel,
                    PageJudge{Scene{}, 500.0, true}};
  std::uint16_t port = static_cast<std::uint16_t>(std::stoi(server.url().substr(server.url().rfind(':') + 1)));
  std::string host = "127.0.0.1:" + std::to_string(port);
};

/// A blocking connection.
class Client {
 public:
  explicit Client(std::uint16_t port) : fd_{socket(AF_INET, SOCK_STREAM, 0)} {
    const linger none{1, 0};  // a port is free again at once
    const int at_once = 1;
    setsockopt(fd_, SOL_SOCKET, SO_LINGER, &none, sizeof none);
    setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &at_once, sizeof at_once);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const auto error_of_connect = [&] {
      return connect(fd_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 ? 0 : errno;
    };
    int error = error_of_connect();
    // Ports of connections that the server has ended are taken for a minute.
    for (int attempt = 0; error == EADDRNOTAVAIL && attempt < 100; ++attempt) {
      std::this_thread::sleep_for(std::chrono::milliseconds{100});
      error = error_of_connect();
    }
    require(error == 0, "the server accepts");
  }
  ~Client() { close(fd_); }
  Client(const Client&) = delete;
  void send(std::string_view bytes) const {
    if (::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) < 0) return;  // it has ended
  }
  /// Up to and with `text`, or all where the server ends before.
  std::string receive(std::string_view text) const {
    std::string got;
    std::array<char, 4096> some{};
    while (text.empty() || got.find(text) == got.npos) {
      const ssize_t size = recv(fd_, some.data(), some.size(), 0);
      if (size <= 0) break;
      got.append(some.data(), static_cast<std::size_t>(size));
    }
    return got;
  }
  std::string rest() const {
    shutdown(fd_, SHUT_WR);
    return receive("");
  }

 private:
  int fd_;
};

/// The bytes as a request.
void check_request(const Server& s, std::string_view bytes) {
  const Client client{s.port};
  client.send(bytes);
  const std::string answer = client.rest();
  require(answer.empty() || answer.starts_with("HTTP/1.1 "), "an answer is HTTP");
}

/// A page that was greeted. At most eight are open, and one that has ended is given up a little later.
void greet(const Server& s, std::optional<Client>& page) {
  std::string got;
  for (int attempt = 0; attempt < 500; ++attempt) {
    page.emplace(s.port).send(
        "GET /live HTTP/1.1\r\nHost: " + s.host + "\r\nOrigin: http://" + s.host +
        "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n");
    got = page->receive("introduction");
    if (got.find("introduction") != got.npos) return;
    std::this_thread::sleep_for(std::chrono::milliseconds{10});
  }
  std::fprintf(stderr, "received: %s\n", got.c_str());
  require(false, "a page is greeted within five seconds");
}

/// The commands of the bytes as frames of a WebSocket, in pieces.
std::string commands(Server& s, std::string_view bytes, std::size_t piece) {
  std::optional<Client> client;
  greet(s, client);
  for (std::size_t at = 0; at < bytes.size(); at += piece) client->send(bytes.substr(at, piece));
  static_cast<void>(client->rest());
  // A WebSocket may be closed before it is given up; the next connection comes after both.
  static_cast<void>(Client{s.port}.rest());
  std::string seen;
  PageCommand command;
  for (auto* ring : {&s.channel.hand, &s.channel.commands})
    while (ring->try_pop(command)) {
      check_command(command);
      seen += std::to_string(static_cast<int>(command.kind)) + ':' + std::to_string(command.which);
      for (const double number : command.number) seen += ' ' + std::to_string(number);
    }
  return seen;
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace twoport;
  const std::string_view bytes{reinterpret_cast<const char*>(data), size};
  if (const auto command = parse_page_command(bytes)) check_command(*command);
  static Server server;
  check_request(server, bytes);
  require(commands(server, bytes, std::max<std::size_t>(1, size / 64)) == commands(server, bytes, size + 1),
          "pieces of any size are the same message");
  return 0;
}
