#include "common/platform/page_server.h"

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_BEAST_USE_STD_STRING_VIEW
#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // the thread sanitizer does not support fences
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <csignal>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/base/thread.h"
#include "common/platform/listener.h"
#include "common/platform/random.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Error = boost::system::error_code;
using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;
using namespace std::chrono_literals;

static_assert(std::endian::native == std::endian::little, "the page reads little-endian numbers");

constexpr auto kFrameTime = 16ms;   // between two messages to a client
constexpr auto kPatience = 10s;     // for a client that reads nothing
constexpr auto kJudging = 250ms;    // between two verdicts
constexpr auto kLastWords = 150ms;  // for the end of the run to reach the pages
constexpr std::size_t kRequests =
    16;  // connections at once that are no WebSockets; a new one takes the place of the oldest
constexpr std::size_t kSockets = 8;        // WebSockets at once
constexpr std::size_t kMostSamples = 128;  // in one message

/// Without a body, with at most one Host and Origin, and of a file here?
bool is_well_formed(const http::request_parser<http::empty_body>& parser) {
  const Request& r = parser.get();
  return parser.is_done() && r.target().starts_with('/') && r.count(http::field::host) < 2 &&
         r.count(http::field::origin) < 2;
}

/// Are they the same, in a time that does not depend on where they differ?
bool same(std::string_view a, std::string_view b) {
  unsigned different = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < a.size(); ++i) different |= static_cast<unsigned>(a[i] ^ b[i % b.size()]);
  return different == 0;
}

}  // namespace

std::optional<unsigned> port_of_literal_host(std::string_view host) {
  const std::size_t colon = host.rfind(':');
  const bool has_port = colon != host.npos && host.back() != ']';
  std::string_view name = host.substr(0, has_port ? colon : host.npos);
  const std::optional<unsigned> port = has_port ? number_from<unsigned>(host.substr(colon + 1)) : 80;
  if (boost::beast::iequals(name, "localhost")) return port;
  const bool bracketed = name.size() > 2 && name.front() == '[' && name.back() == ']';
  if (bracketed) name = name.substr(1, name.size() - 2);
  // After '%' anything is a zone.
  if (name.find('%') != name.npos) return {};
  Error error;
  const asio::ip::address address = asio::ip::make_address(std::string{name}, error);
  return !error && address.is_v6() == bracketed ? port : std::nullopt;
}

bool is_literal_host(std::string_view host, std::uint16_t port) {
  return port_of_literal_host(host) == port;
}

bool is_own_origin(std::string_view host, std::string_view origin) {
  return !host.empty() && boost::beast::iequals(origin, "http://" + std::string{host});
}

struct PageServer::Impl {
  using Text = std::shared_ptr<const std::string>;
  using Now = std::chrono::steady_clock;

  struct Client {
    explicit Client(tcp::socket s) : socket{std::move(s)} { parser.header_limit(kLargestRequest); }
    websocket::stream<tcp::socket, false> socket;
    http::request_parser<http::empty_body> parser;
    boost::beast::flat_buffer arriving;
    bool upgraded = false, holds = false, greeted = false, writing = false, pinging = false, ends = false;
    bool untold = false;  ///< status() has changed since it was sent
    Text samples;         ///< newest that are not sent yet
    Now::time_point since = Now::now(), heard = since, pinged = since, last_progress = since, commanded = since;
  };
  using Shared = std::shared_ptr<Client>;

  Impl(const Options& o, PageChannel& c, PageJudge j)
      : options{o},
        channel{c},
        judge{std::move(j)},
        acceptor{listen_at(context, o.address, "--page")},
        timer{context},
        port{acceptor.local_endpoint().port()},
        local{acceptor.local_endpoint().address().is_loopback()} {
    if (!local) query = fmt::format("?token={:016x}{:016x}", system_random(), system_random());
    url = fmt::format("http://{}/{}", reached_at(acceptor), query);
    introduction = std::make_shared<const std::string>(o.introduction);
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
        client->socket.next_layer().set_option(tcp::no_delay{true}, ignored);
        clients.push_back(client);
        read_request(client);
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
      if (now - judged > kJudging) {
        judged = now;
        verdict = judge.verdict();
        if (std::string news = *status(false); news != told) {
          told = std::move(news);
          tell_all();
        }
      }
      for (const Shared& client : std::vector<Shared>{clients}) {
        const bool slow = client->writing && now - client->last_progress > kPatience;
        const bool silent = client->upgraded ? now - client->heard > options.silence
                                             : !client->ends && now - client->since > options.request_time;
        if (slow || silent) {
          drop(client);
        } else if (client->greeted && !client->ends && !client->pinging && now - client->pinged > options.ping_every) {
          client->pinged = now;
          client->pinging = true;
          client->socket.async_ping({}, [client](Error) { client->pinging = false; });
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
      judge.add(sample);
      batch[count++ % kMostSamples] = sample;
    }
    const bool wanted = std::any_of(clients.begin(), clients.end(), [](const Shared& c) { return c->upgraded; });
    if (count == 0 || !wanted) return;
    std::string numbers;
    for (std::size_t i = count - std::min(count, kMostSamples); i < count; ++i)
      for_each_page_field(batch[i % kMostSamples], [&](const char*, std::size_t size, const double* values) {
        numbers.append(reinterpret_cast<const char*>(values), size * sizeof(double));
      });
    const auto message = std::make_shared<const std::string>(std::move(numbers));
    for (const Shared& client : clients) {
      if (!client->greeted || client->ends) continue;
      if (client->writing) {
        client->samples = message;
      } else {
        write(client, message);
      }
    }
  }

  void read_request(const Shared& client) {
    http::async_read_header(
        client->socket.next_layer(), client->arriving, client->parser, [this, client](Error error, std::size_t) {
          const bool malformed = error.category() == make_error_code(http::error::bad_method).category() &&
                                 error != http::error::end_of_stream && error != http::error::partial_message;
          if (error && !malformed) return drop(client);
          if (error || !is_well_formed(client->parser))
            return refuse(client, http::status::bad_request, "The request is malformed.\n");
          answer(client, client->parser.get());
        });
  }

  void answer(const Shared& client, const Request& r) {
    const std::string_view host = r[http::field::host];
    if (!is_literal_host(host, port))
      return refuse(client, http::status::misdirected_request,
                    "Use localhost or the IP address of this machine in the address.\n");
    const std::string_view whole = r.target();
    const std::string_view path = whole.substr(0, whole.find('?'));
    if (!query.empty() && !same(whole.substr(path.size()), query))
      return refuse(client, http::status::forbidden,
                    "This address needs a token. Open the link that twoport-master printed when it started: it holds "
                    "the token.\n");
    if (path == "/live") return upgrade(client, r);
    if (r.method() != http::verb::get && r.method() != http::verb::head)
      return refuse(client, http::status::method_not_allowed, "Only GET is allowed.\n");
    if (path != "/" && path != "/index.html")
      return refuse(client, http::status::not_found, "Nothing is at this address.\n");
    Response response{http::status::ok, 11};
    response.set(http::field::content_type, "text/html; charset=utf-8");
    // What may run is said in the page itself, by the digests of its script and style.
    response.set(
        "Content-Security-Policy",
        fmt::format("connect-src 'self' ws://{}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'", host));
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set(http::field::cache_control, "no-cache");
    response.content_length(options.page.size());
    if (r.method() == http::verb::get) response.body() = options.page;
    respond(client, std::move(response));
  }

  void refuse(const Shared& client, http::status status, const char* why) {
    Response response{status, 11};
    response.set(http::field::content_type, "text/html; charset=utf-8");
    if (status == http::status::upgrade_required) {
      response.set(http::field::upgrade, "websocket");
      response.set(http::field::sec_websocket_version, "13");
    }
    response.body() =
        std::string{"<!doctype html><meta name=viewport content=width=device-width><title>twoport</title><p>"} + why;
    response.content_length(response.body().size());
    respond(client, std::move(response));
  }

  /// The only response of its connection.
  void respond(const Shared& client, Response response) {
    response.keep_alive(false);
    const auto sent = std::make_shared<const Response>(std::move(response));
    client->ends = client->writing = true;
    client->last_progress = Now::now();
    http::async_write(client->socket.next_layer(), *sent, [this, client, sent](Error, std::size_t) { drop(client); });
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
    end(idlest, websocket::close_code::try_again_later);
    return true;
  }

  void upgrade(const Shared& client, const Request& r) {
    if (!websocket::is_upgrade(r) || r[http::field::sec_websocket_version] != "13")
      return refuse(client, http::status::upgrade_required, "This address is a WebSocket.\n");
    if (!is_own_origin(r[http::field::host], r[http::field::origin]))
      return refuse(client, http::status::forbidden, "Another web site may not connect.\n");
    // RFC 6455, 4.1: a client waits for the response.
    if (client->arriving.size() > 0) return refuse(client, http::status::bad_request, "The request is malformed.\n");
    if (!has_place()) return refuse(client, http::status::service_unavailable, "Eight pages are open; close one.\n");
    client->upgraded = true;
    client->heard = Now::now();
    client->socket.read_message_max(kLargestMessage);
    client->socket.auto_fragment(false);
    client->socket.control_callback([c = client.get()](websocket::frame_type, auto) {
      if (!c->ends) c->heard = Now::now();
    });
    client->socket.async_accept(r, [this, client](Error error) {
      if (error) return drop(client);
      client->greeted = true;
      client->untold = true;
      write(client, introduction, true);
      if (controlling == nullptr) give_control(client.get());
      read(client);
    });
  }

  /// Beast answers pings and close frames, and closes with the code of what the standard forbids.
  void read(const Shared& client) {
    client->socket.async_read(client->arriving, [this, client](Error error, std::size_t size) {
      if (error) return drop(client);
      if (client->ends) return;
      client->heard = Now::now();
      if (client->socket.got_text()) {
        obey(client, {static_cast<const char*>(client->arriving.data().data()), size});
      } else {
        end(client, websocket::close_code::unknown_data);
      }
      client->arriving.consume(size);
      if (!client->ends) read(client);
    });
  }

  void obey(const Shared& client, std::string_view text) {
    const std::optional<PageCommand> command = parse_page_command(text);
    if (!command) return end(client, websocket::close_code::policy_error);
    client->commanded = Now::now();
    using enum PageCommand::Kind;
    if ((command->kind == target || command->kind == take) && !held_by_another(client)) give_control(client.get());
    if (controlling != client.get()) return;
    // A target that stays where it is moves nothing.
    if (command->kind != target || !client->holds || command->number != aim) judge.disturb();
    switch (command->kind) {
      case target:
        client->holds = true;
        aim = command->number;
        channel.hand.try_push(*command);
        break;
      case release:
        let_go(client);
        break;
      case opening:
      case grip:
        channel.hand.try_push(*command);
        break;
      case network:
      case surface:
      case method:
      case clutch:
      case rehome:
      case lock:
      case scale:
        channel.commands.try_push(*command);
        break;
      case take:
        break;
      case restart:
        if (!options.restartable) break;
        restarting = true;
        std::raise(SIGTERM);
        break;
    }
  }

  void give_control(const Client* to) {
    if (controlling == to) return;
    controlling = to;
    tell_all();
  }
  /// What a client is told besides the introduction and samples.
  [[nodiscard]] Text status(bool controls) const {
    return std::make_shared<const std::string>(
        fmt::format(R"({{"controls":{},"verdict":{},"reason":{},"initial_energy_j":{},"earlier_debt_j":{},)"
                    R"("both_initial_energy_j":{},"both_earlier_debt_j":{},"end":{}}})",
                    controls, json_string(to_string(verdict.kind)), json_string(verdict.reason),
                    judge.initial_energy_j(), judge.earlier_debt_j(), judge.both_initial_energy_j(),
                    judge.both_earlier_debt_j(), over.empty() ? "null" : json_string(over)));
  }
  void tell_all() {
    for (const Shared& client : std::vector<Shared>{clients}) {
      if (!client->greeted || client->ends) continue;
      client->untold = true;
      if (!client->writing) write_next(client);
    }
  }
  void write_next(const Shared& client) {
    if (std::exchange(client->untold, false)) {
      write(client, status(controlling == client.get()), true);
    } else {
      write(client, std::exchange(client->samples, nullptr));
    }
  }

  bool held_by_another(const Shared& client) const {
    return std::any_of(clients.begin(), clients.end(), [&](const Shared& c) { return c != client && c->holds; });
  }

  void let_go(const Shared& client) {
    // Where the ring is full the device's own time limit releases the handle.
    if (std::exchange(client->holds, false)) channel.hand.try_push({});
  }

  void write(const Shared& client, Text text, bool is_text = false) {
    if (client->writing || client->ends || !text) return;
    client->writing = true;
    client->last_progress = Now::now();
    client->socket.text(is_text);
    client->socket.async_write(asio::buffer(*text), [this, client, text](Error error, std::size_t) {
      client->writing = false;
      if (error) return drop(client);
      write_next(client);
    });
  }

  /// Sends the code, then closes.
  void end(const Shared& client, websocket::close_code code) {
    if (client->ends) return;
    client->ends = true;
    client->samples = nullptr;
    let_go(client);
    client->socket.async_close(code, [this, client](Error) { drop(client); });
  }
  void drop(const Shared& client) {
    let_go(client);
    client->ends = true;
    if (controlling == client.get()) {
      const auto next =
          std::find_if(clients.begin(), clients.end(), [](const Shared& c) { return c->greeted && !c->ends; });
      controlling = nullptr;
      if (next != clients.end()) give_control(next->get());
    }
    Error ignored;
    client->socket.next_layer().shutdown(asio::socket_base::shutdown_both, ignored);
    client->socket.next_layer().close(ignored);
    std::erase(clients, client);
  }

  Options options;
  PageChannel& channel;
  PageJudge judge;
  PageVerdict verdict;
  std::string told;  ///< status() without who controls, as it was told last
  Now::time_point judged{};
  const Client* controlling = nullptr;
  std::array<double, 6> aim{};  ///< newest target of the hand
  std::atomic<bool> restarting{false};
  std::string over;  ///< how the run ended
  asio::io_context context{1};
  tcp::acceptor acceptor;
  asio::steady_timer timer;
  std::uint16_t port;
  bool local;
  std::string url, query;  ///< query: "?token=…", what a request must end with
  Text introduction;
  std::vector<Shared> clients;
  std::array<PageSample, kMostSamples> batch{};
  std::thread thread;
};

PageServer::PageServer(const Options& options, PageChannel& channel, PageJudge judge)
    : impl_{std::make_unique<Impl>(options, channel, std::move(judge))} {}
PageServer::~PageServer() = default;
void PageServer::end(const std::string& how) {
  asio::post(impl_->context, [impl = impl_.get(), how] {
    impl->over = how;
    impl->tell_all();
  });
  std::this_thread::sleep_for(kLastWords);
}
const std::string& PageServer::url() const {
  return impl_->url;
}
bool PageServer::restarts() const {
  return impl_->restarting;
}
bool PageServer::is_local() const {
  return impl_->local;
}

}  // namespace twoport
