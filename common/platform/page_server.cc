#include "common/platform/page_server.h"

#define ASIO_STANDALONE
#define ASIO_NO_DEPRECATED
#define ASIO_DISABLE_FENCED_BLOCK  // the thread sanitizer does not support fences
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <asio/io_context.hpp>
#include <asio/ip/address.hpp>
#include <asio/ip/tcp.hpp>
#include <asio/steady_timer.hpp>
#include <asio/write.hpp>
#include <bit>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/thread.h"
#include "common/page/http.h"
#include "common/page/websocket.h"
#include "common/platform/udp.h"

namespace twoport {
namespace {

using asio::ip::tcp;
using Error = std::error_code;
using namespace std::chrono_literals;

static_assert(std::endian::native == std::endian::little, "the page reads little-endian numbers");

constexpr auto kFrameTime = 16ms;  // between two messages to a client
constexpr auto kPatience = 10s;    // for a client that reads nothing
constexpr std::size_t kRequests =
    16;  // connections at once that are no WebSockets; a new one takes the place of the oldest
constexpr std::size_t kSockets = 8;        // WebSockets at once
constexpr std::size_t kReplies = 16;       // to a client that wait
constexpr std::size_t kMostSamples = 128;  // in one message

constexpr std::string_view kAbsent = "Nothing is at this address.\n";

}  // namespace

struct PageServer::Impl {
  using Text = std::shared_ptr<const std::string>;
  using Now = std::chrono::steady_clock;

  struct Client {
    explicit Client(tcp::socket s) : socket{std::move(s)} {}
    tcp::socket socket;
    std::array<char, 2048> arriving{};
    std::string request;
    WebSocketReader reader;
    bool upgraded = false, holds = false, writing = false, ends = false;
    std::vector<Text> replies;  ///< sent in order, before samples
    Text samples;               ///< newest that are not sent yet
    Now::time_point since = Now::now(), heard = since, pinged = since, last_progress = since, commanded = since;
  };
  using Shared = std::shared_ptr<Client>;

  Impl(const Options& o, PageChannel& c) : options{o}, channel{c}, acceptor{context}, timer{context} {
    const Endpoint at = parse_endpoint(o.address, "--page");
    asio::ip::address address;
    if (at.v6) {
      address = asio::ip::address_v6{at.address, at.scope};
    } else {
      asio::ip::address_v4::bytes_type four;
      std::copy_n(at.address.begin(), four.size(), four.begin());
      address = asio::ip::address_v4{four};
    }
    local = address.is_loopback();
    const tcp::endpoint endpoint{address, at.port};
    Error error;
    acceptor.open(endpoint.protocol(), error);
    if (!error) acceptor.set_option(tcp::acceptor::reuse_address{true}, error);
    if (!error) acceptor.bind(endpoint, error);
    if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
    if (error)
      throw ConfigError{
          fmt::format("--page {}: {}; choose another port, or port 0 for any free one", o.address, error.message())};
    port = acceptor.local_endpoint().port();
    const bool any = address.is_unspecified();
    const std::string host = any ? "127.0.0.1" : at.v6 ? "[" + address.to_string() + "]" : address.to_string();
    url = fmt::format("http://{}:{}/", host, port);
    introduction = std::make_shared<const std::string>(websocket_frame(WebSocketOpcode::text, o.introduction));
    accept();
    tick();
    thread = std::thread{[this] {
      take_ordinary_priority();
      context.run();
    }};
  }
  ~Impl() {
    context.stop();
    thread.join();
  }

  void accept() {
    acceptor.async_accept([this](Error error, tcp::socket socket) {
      if (!error) {
        // In the order of their arrival.
        const auto is_request = [](const Shared& c) { return !c->upgraded; };
        if (std::count_if(clients.begin(), clients.end(), is_request) >= static_cast<std::ptrdiff_t>(kRequests))
          drop(Shared{*std::find_if(clients.begin(), clients.end(), is_request)});
        auto client = std::make_shared<Client>(std::move(socket));
        Error ignored;
        client->socket.set_option(tcp::no_delay{true}, ignored);
        clients.push_back(client);
        read(client);
        accept();
        return;
      }
      // Out of descriptors, or a connection that is gone again: try later.
      auto wait = std::make_shared<asio::steady_timer>(context, 100ms);
      wait->async_wait([this, wait](Error) { accept(); });
    });
  }

  /// Samples of the cycle to all clients; clients that make no progress or say nothing end. A browser answers a ping by itself.
  void tick() {
    timer.expires_after(kFrameTime);
    timer.async_wait([this](Error) {
      send_samples();
      const auto now = Now::now();
      for (const Shared& client : std::vector<Shared>{clients}) {
        const bool slow = client->writing && now - client->last_progress > kPatience;
        const bool silent = client->upgraded ? now - client->heard > options.silence
                                             : !client->ends && now - client->since > options.request_time;
        if (slow || silent) {
          drop(client);
        } else if (client->upgraded && !client->ends && now - client->pinged > options.ping_every) {
          client->pinged = now;
          reply(client, websocket_frame(WebSocketOpcode::ping, ""));
        }
      }
      tick();
    });
  }

  void send_samples() {
    std::size_t count = 0;
    PageSample sample;
    while (channel.samples.try_pop(sample)) {
      sample.dropped = static_cast<double>(channel.samples.dropped());
      batch[count++ % kMostSamples] = sample;
    }
    const bool wanted = std::any_of(clients.begin(), clients.end(), [](const Shared& c) { return c->upgraded; });
    if (count == 0 || !wanted) return;
    std::string numbers;
    for (std::size_t i = count - std::min(count, kMostSamples); i < count; ++i)
      for_each_page_field(batch[i % kMostSamples], [&](const char*, std::size_t size, const double* values) {
        numbers.append(reinterpret_cast<const char*>(values), size * sizeof(double));
      });
    const auto message = std::make_shared<const std::string>(websocket_frame(WebSocketOpcode::binary, numbers));
    for (const Shared& client : clients) {
      if (!client->upgraded || client->ends) continue;
      client->samples = message;
      write(client);
    }
  }

  void read(const Shared& client) {
    client->socket.async_read_some(asio::buffer(client->arriving), [this, client](Error error, std::size_t size) {
      if (error) return drop(client);
      client->heard = Now::now();
      const std::string_view bytes{client->arriving.data(), size};
      if (client->upgraded) {
        client->reader.add(bytes);
        hear(client);
      } else {
        client->request += bytes;
        answer(client);
      }
      if (!client->ends) read(client);
    });
  }

  void answer(const Shared& client) {
    HttpParse parse = parse_request(client->request);
    if (parse.status == Parsed::incomplete) return;
    if (parse.status == Parsed::invalid)
      return end(client, http_response("400 Bad Request", "text/plain", "The request is malformed.\n"));
    const HttpRequest& r = parse.request;
    if (!is_literal_host(r.host, port))
      return end(client, http_response("421 Misdirected Request", "text/plain",
                                       "Use localhost or the IP address of this machine in the address.\n"));
    if (r.target == "/live") return upgrade(client, r, std::string_view{client->request}.substr(parse.used));
    if (r.method != "GET" && r.method != "HEAD")
      return end(client, http_response("405 Method Not Allowed", "text/plain", "Only GET is allowed.\n"));
    const std::string_view target = r.target == "/" ? std::string_view{"/index.html"} : std::string_view{r.target};
    for (const PageAsset& asset : options.assets)
      if (asset.path == target) {
        std::string response = http_response("200 OK", asset.content_type, asset.content, headers(r.host));
        if (r.method == "HEAD") response.resize(response.size() - asset.content.size());
        return end(client, std::move(response));
      }
    end(client, http_response("404 Not Found", "text/plain", kAbsent, headers(r.host)));
  }

  static std::vector<std::pair<std::string, std::string>> headers(const std::string& host) {
    return {{"Content-Security-Policy",
             "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self' ws://" +
                 host + "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"},
            {"X-Content-Type-Options", "nosniff"},
            {"Referrer-Policy", "no-referrer"},
            {"Cache-Control", "no-cache"}};
  }

  /// A place for a further WebSocket, if need be that of a spectator.
  bool has_place() {
    std::size_t open = 0;
    Shared idlest;
    for (const Shared& c : clients) {
      if (!c->upgraded || c->ends) continue;
      ++open;
      if (!c->holds && (!idlest || c->commanded < idlest->commanded)) idlest = c;
    }
    if (open < kSockets) return true;
    if (!idlest || Now::now() - idlest->commanded < options.spectator_time) return false;
    end(idlest, websocket_frame(WebSocketOpcode::close, websocket_close(1013)));
    return true;
  }

  void upgrade(const Shared& client, const HttpRequest& r, std::string_view rest) {
    if (!is_websocket_upgrade(r))
      return end(client, http_response("426 Upgrade Required", "text/plain", "This address is a WebSocket.\n",
                                       {{"Upgrade", "websocket"}, {"Sec-WebSocket-Version", "13"}}));
    if (!is_own_origin(r))
      return end(client, http_response("403 Forbidden", "text/plain", "Another web site may not connect.\n"));
    if (!has_place())
      return end(client, http_response("503 Service Unavailable", "text/plain", "Eight pages are open; close one.\n"));
    client->upgraded = true;
    client->reader.add(rest);
    client->replies.push_back(std::make_shared<const std::string>(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: " +
        websocket_accept(r.websocket_key) + "\r\n\r\n"));
    client->replies.push_back(introduction);
    client->request = {};
    write(client);
    hear(client);
  }

  void hear(const Shared& client) {
    using Kind = WebSocketReader::Event::Kind;
    for (WebSocketReader::Event e = client->reader.next(); e.kind != Kind::nothing; e = client->reader.next()) {
      switch (e.kind) {
        case Kind::nothing:
          break;
        case Kind::text:
          obey(client, e.payload);
          if (client->ends) return;
          break;
        case Kind::ping:
          reply(client, websocket_frame(WebSocketOpcode::pong, e.payload));
          break;
        case Kind::close:
        case Kind::error:
          return end(client, websocket_frame(WebSocketOpcode::close,
                                             e.close_code == 1005 ? std::string{} : websocket_close(e.close_code)));
      }
    }
  }

  void obey(const Shared& client, std::string_view text) {
    const std::optional<PageCommand> command = parse_page_command(text);
    if (!command) return end(client, websocket_frame(WebSocketOpcode::close, websocket_close(1008)));
    client->commanded = Now::now();
    switch (command->kind) {
      case PageCommand::Kind::target:
        // One hand at a time.
        if (held_by_another(client)) return;
        client->holds = true;
        channel.hand.try_push(*command);
        break;
      case PageCommand::Kind::release:
        release(client);
        break;
      case PageCommand::Kind::opening:
        if (held_by_another(client)) return;
        channel.hand.try_push(*command);
        break;
      case PageCommand::Kind::grip:
        channel.hand.try_push(*command);
        break;
      case PageCommand::Kind::network:
      case PageCommand::Kind::surface:
      case PageCommand::Kind::method:
        channel.commands.try_push(*command);
        break;
    }
  }

  bool held_by_another(const Shared& client) const {
    return std::any_of(clients.begin(), clients.end(), [&](const Shared& c) { return c != client && c->holds; });
  }

  void release(const Shared& client) {
    // Where the ring is full the device's own time limit releases the handle.
    if (std::exchange(client->holds, false)) channel.hand.try_push({});
  }

  void reply(const Shared& client, std::string frame) {
    if (client->replies.size() < kReplies)
      client->replies.push_back(std::make_shared<const std::string>(std::move(frame)));
    write(client);
  }

  void write(const Shared& client) {
    if (client->writing) return;
    Text text;
    if (!client->replies.empty()) {
      text = std::move(client->replies.front());
      client->replies.erase(client->replies.begin());
    } else {
      text = std::exchange(client->samples, nullptr);
    }
    if (!text) {
      if (client->ends) drop(client);
      return;
    }
    client->writing = true;
    client->last_progress = Now::now();
    asio::async_write(client->socket, asio::buffer(*text), [this, client, text](Error error, std::size_t) {
      client->writing = false;
      if (error) return drop(client);
      client->last_progress = Now::now();
      write(client);
    });
  }

  /// Sends `last`, then closes.
  void end(const Shared& client, std::string last) {
    if (client->ends) return;
    client->ends = true;
    client->samples = nullptr;
    release(client);
    client->replies.push_back(std::make_shared<const std::string>(std::move(last)));
    write(client);
  }
  void drop(const Shared& client) {
    release(client);
    client->ends = true;
    Error ignored;
    client->socket.shutdown(tcp::socket::shutdown_both, ignored);
    client->socket.close(ignored);
    std::erase(clients, client);
  }

  Options options;
  PageChannel& channel;
  asio::io_context context{1};
  tcp::acceptor acceptor;
  asio::steady_timer timer;
  std::uint16_t port = 0;
  bool local = true;
  std::string url;
  Text introduction;
  std::vector<Shared> clients;
  std::array<PageSample, kMostSamples> batch{};
  std::thread thread;
};

PageServer::PageServer(const Options& options, PageChannel& channel)
    : impl_{std::make_unique<Impl>(options, channel)} {}
PageServer::~PageServer() = default;
const std::string& PageServer::url() const {
  return impl_->url;
}
bool PageServer::is_local() const {
  return impl_->local;
}

}  // namespace twoport
