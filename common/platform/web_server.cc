#include "common/platform/web_server.h"

#include <fmt/format.h>

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_BEAST_USE_STD_STRING_VIEW
#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // the thread sanitizer does not support fences
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <thread>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/base/thread.h"
#include "common/platform/udp.h"

namespace twoport {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Error = boost::system::error_code;
using Now = std::chrono::steady_clock;

namespace {

constexpr std::size_t kPassing = 16;    // connections at once that are no WebSockets, or close
constexpr int kSendBuffer = 32 * 1024;  // of a connection [B]: what waits in it is late

/// The address under which other machines reach this one, by its route to the rest of the network. No packet is sent.
asio::ip::address own_address(const asio::ip::address& bound) {
  if (!bound.is_unspecified()) return bound;
  asio::io_context context;
  asio::ip::udp::socket socket{context};
  Error error;
  socket.connect({asio::ip::make_address(bound.is_v6() ? "2001:db8::1" : "192.0.2.1"), 9}, error);
  if (!error) return socket.local_endpoint().address();
  return bound.is_v6() ? asio::ip::address{asio::ip::address_v6::loopback()}
                       : asio::ip::address{asio::ip::address_v4::loopback()};
}

/// Listens at ADDR:PORT, the value of `flag`; port 0: any free one. Throws ConfigError with the address and what to do.
asio::ip::tcp::acceptor listen_at(asio::io_context& context, const std::string& address, const char* flag) {
  const Endpoint at = parse_endpoint(address, flag);
  const auto& a = at.address;
  const asio::ip::address ip = at.v6 ? asio::ip::address{asio::ip::address_v6{a, at.scope}}
                                     : asio::ip::address{asio::ip::address_v4{{a[0], a[1], a[2], a[3]}}};
  const asio::ip::tcp::endpoint endpoint{ip, at.port};
  asio::ip::tcp::acceptor acceptor{context};
  Error error;
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(asio::socket_base::reuse_address{true}, error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    throw ConfigError{
        fmt::format("{} {}: {}; choose another port, or port 0 for any free one", flag, address, error.message())};
  return acceptor;
}

/// "127.0.0.1:8765" as others reach it: under a wildcard address, by this machine's route to the rest of the network.
std::string reached_at(const asio::ip::tcp::acceptor& acceptor) {
  const asio::ip::tcp::endpoint bound = acceptor.local_endpoint();
  const asio::ip::address ip = own_address(bound.address());
  return fmt::format(fmt::runtime(ip.is_v6() ? "[{}]:{}" : "{}:{}"), ip.to_string(), bound.port());
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

WebAnswer WebAnswer::refusal(unsigned status, std::string_view why) {
  return {.status = status,
          .body = "<!doctype html><meta name=viewport content=width=device-width><title>twoport</title><p>" +
                  std::string{why},
          .fields = {{"Content-Type", "text/html; charset=utf-8"}}};
}

struct WebServer::Impl {
  explicit Impl(Options o)
      : options{std::move(o)},
        acceptor{listen_at(context, options.address, options.flag)},
        timer{context},
        address{reached_at(acceptor)} {
    accept();
    tick();
  }

  void accept();
  void tick();
  void drop(const std::shared_ptr<WebConnection>& connection);

  Options options;
  asio::io_context context{1};
  tcp::acceptor acceptor;
  asio::steady_timer timer;
  std::string address;
  std::vector<std::shared_ptr<WebConnection>> connections;
  std::thread thread;
};

class WebConnection : public std::enable_shared_from_this<WebConnection> {
 public:
  WebConnection(WebServer::Impl& server, tcp::socket socket) : server_{server}, socket_{std::move(socket)} {
    Error ignored;
    socket_.next_layer().set_option(tcp::no_delay{true}, ignored);
    socket_.next_layer().set_option(asio::socket_base::send_buffer_size{kSendBuffer}, ignored);
    parser_.header_limit(kLargestRequest);
  }

  /// Is it no WebSocket, or one that closes?
  [[nodiscard]] bool is_passing() const { return !session_ || ends_; }
  [[nodiscard]] bool is_writing() const { return writing_; }

  void read_request() {
    http::async_read_header(
        socket_.next_layer(), arriving_, parser_, [this, self = shared_from_this()](Error error, std::size_t) {
          const bool malformed = error.category() == make_error_code(http::error::bad_method).category() &&
                                 error != http::error::end_of_stream && error != http::error::partial_message;
          if (error && !malformed) return server_.drop(self);
          if (error || !is_well_formed()) return respond(WebAnswer::refusal(400, "The request is malformed.\n"), false);
          answer();
        });
  }

  void write(WebSession::Text text, bool is_text) {
    if (!open_ || writing_ || ends_ || !text) return;
    writing_ = true;
    progressed_ = Now::now();
    socket_.text(is_text);
    socket_.async_write(asio::buffer(*text), [this, self = shared_from_this(), text](Error error, std::size_t) {
      writing_ = false;
      if (error) return server_.drop(self);
      if (!ends_) session_->sent();
    });
  }
  void end(std::uint16_t code) {
    if (std::exchange(ends_, true)) return;
    session_->closed();
    socket_.async_close(static_cast<websocket::close_code>(code),
                        [this, self = shared_from_this()](Error) { server_.drop(self); });
  }
  /// Has it lasted too long?
  [[nodiscard]] bool is_over(Now::time_point now) const {
    const WebServer::Options& o = server_.options;
    const bool silent = session_ ? now - heard_ > o.silence : !ends_ && now - since_ > o.request_time;
    return silent || (writing_ && now - progressed_ > o.patience);
  }
  /// A browser answers by itself.
  void ping(Now::time_point now) {
    if (!open_ || ends_ || pinging_ || now - pinged_ <= server_.options.ping_every) return;
    pinged_ = now;
    pinging_ = true;
    socket_.async_ping({}, [this, self = shared_from_this()](Error) { pinging_ = false; });
  }
  void close() {
    if (!std::exchange(ends_, true) && session_) session_->closed();
    Error ignored;
    socket_.next_layer().shutdown(asio::socket_base::shutdown_both, ignored);
    socket_.next_layer().close(ignored);
  }

 private:
  using Request = http::request<http::empty_body>;

  [[nodiscard]] bool is_well_formed() const {
    const Request& r = parser_.get();
    return parser_.is_done() && r.target().starts_with('/') && r.count(http::field::host) < 2 &&
           r.count(http::field::origin) < 2;
  }

  void answer() {
    const Request& r = parser_.get();
    const bool upgrades = websocket::is_upgrade(r) && r[http::field::sec_websocket_version] == "13";
    // RFC 6455, 4.1: a client waits for the response.
    if (upgrades && arriving_.size() > 0) return respond(WebAnswer::refusal(400, "The request is malformed.\n"), false);
    std::vector<std::string_view> protocols;
    for (const auto token : http::token_list{r[http::field::sec_websocket_protocol]}) protocols.push_back(token);
    WebAnswer answer = server_.options.answer({.method = r.method_string(),
                                               .target = r.target(),
                                               .host = r[http::field::host],
                                               .origin = r[http::field::origin],
                                               .protocols = std::move(protocols),
                                               .upgrades = upgrades});
    if (!answer.session) return respond(std::move(answer), r.method() == http::verb::head);
    session_ = std::move(answer.session);
    session_->connection_ = this;
    heard_ = Now::now();
    socket_.read_message_max(server_.options.largest_message);
    socket_.auto_fragment(false);
    socket_.control_callback([this](websocket::frame_type, auto) {
      if (!ends_) heard_ = Now::now();
    });
    if (!answer.protocol.empty())
      socket_.set_option(websocket::stream_base::decorator([protocol = answer.protocol](websocket::response_type& to) {
        to.set(http::field::sec_websocket_protocol, protocol);
      }));
    socket_.async_accept(r, [this, self = shared_from_this()](Error error) {
      if (error) return server_.drop(self);
      if (ends_) return;
      open_ = true;
      session_->opened();
      read();
    });
  }

  /// The only response of its connection.
  void respond(WebAnswer answer, bool head_only) {
    const auto response = std::make_shared<http::response<http::string_body>>(http::int_to_status(answer.status), 11);
    for (const auto& [name, value] : answer.fields) response->set(name, value);
    if (response->result() == http::status::upgrade_required) {
      response->set(http::field::upgrade, "websocket");
      response->set(http::field::sec_websocket_version, "13");
    }
    response->content_length(answer.body.size());
    if (!head_only) response->body() = std::move(answer.body);
    response->keep_alive(false);
    ends_ = writing_ = true;
    progressed_ = Now::now();
    http::async_write(socket_.next_layer(), *response,
                      [this, self = shared_from_this(), response](Error, std::size_t) { server_.drop(self); });
  }

  /// Beast answers pings and close frames, and closes with the code of what the standard forbids.
  void read() {
    socket_.async_read(arriving_, [this, self = shared_from_this()](Error error, std::size_t size) {
      if (error) return server_.drop(self);
      if (ends_) return;
      heard_ = Now::now();
      session_->heard({static_cast<const char*>(arriving_.data().data()), size}, socket_.got_text());
      arriving_.consume(size);
      if (!ends_) read();
    });
  }

  WebServer::Impl& server_;
  websocket::stream<tcp::socket, false> socket_;
  http::request_parser<http::empty_body> parser_;
  boost::beast::flat_buffer arriving_;
  std::unique_ptr<WebSession> session_;
  bool open_ = false, writing_ = false, pinging_ = false, ends_ = false;
  Now::time_point since_ = Now::now(), heard_ = since_, pinged_ = since_, progressed_ = since_;
};

bool WebSession::is_writing() const {
  return connection_ != nullptr && connection_->is_writing();
}
void WebSession::write(Text text, bool is_text) {
  if (connection_ != nullptr) connection_->write(std::move(text), is_text);
}
void WebSession::end(std::uint16_t code) {
  if (connection_ != nullptr) connection_->end(code);
}

void WebServer::Impl::accept() {
  acceptor.async_accept([this](Error error, tcp::socket socket) {
    if (!error) {
      // In the order of their arrival.
      const auto is_passing = [](const auto& c) { return c->is_passing(); };
      if (std::count_if(connections.begin(), connections.end(), is_passing) >= static_cast<std::ptrdiff_t>(kPassing))
        drop(std::shared_ptr{*std::find_if(connections.begin(), connections.end(), is_passing)});
      connections.push_back(std::make_shared<WebConnection>(*this, std::move(socket)));
      connections.back()->read_request();
      accept();
      return;
    }
    // Out of descriptors, or a connection that is gone again: try later.
    auto wait = std::make_shared<asio::steady_timer>(context, std::chrono::milliseconds{100});
    wait->async_wait([this, wait](Error) { accept(); });
  });
}

void WebServer::Impl::tick() {
  timer.expires_after(options.every);
  timer.async_wait([this](Error) {
    options.tick();
    const auto now = Now::now();
    for (const auto& connection : std::vector{connections}) {
      if (connection->is_over(now)) {
        drop(connection);
      } else {
        connection->ping(now);
      }
    }
    tick();
  });
}

void WebServer::Impl::drop(const std::shared_ptr<WebConnection>& connection) {
  connection->close();
  std::erase(connections, connection);
}

WebServer::WebServer(Options options) : impl_{std::make_unique<Impl>(std::move(options))} {}
WebServer::~WebServer() {
  impl_->context.stop();
  if (impl_->thread.joinable()) impl_->thread.join();
}
void WebServer::start() {
  impl_->thread = std::thread{[impl = impl_.get()] {
    take_ordinary_priority();
    impl->context.run();
  }};
}
void WebServer::post(std::function<void()> f) {
  asio::post(impl_->context, std::move(f));
}
const std::string& WebServer::address() const {
  return impl_->address;
}
std::uint16_t WebServer::port() const {
  return impl_->acceptor.local_endpoint().port();
}
bool WebServer::is_local() const {
  return impl_->acceptor.local_endpoint().address().is_loopback();
}

}  // namespace twoport
