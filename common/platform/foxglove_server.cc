#include "common/platform/foxglove_server.h"

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
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstring>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/text.h"
#include "common/base/thread.h"
#include "common/platform/listener.h"
#include "common/platform/page_server.h"
#include "common/platform/random.h"
#include "common/recording/foxglove.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using Error = boost::system::error_code;
using Request = http::request<http::empty_body>;
using namespace std::chrono_literals;

static_assert(std::endian::native == std::endian::little, "numbers of the protocol are little-endian");

constexpr auto kEvery = 20ms;
constexpr auto kRequestTime = 5s;
constexpr std::size_t kClients = 8, kSubscriptions = 1000, kLargestCommand = 65536;
constexpr std::size_t kMostPending = std::size_t{8} << 20;  // [B], of one client, and of what is not sent yet
constexpr std::array<std::string_view, 2> kProtocols = {"foxglove.websocket.v1", "foxglove.sdk.v1"};
constexpr std::array<std::string_view, 2> kSites = {"https://app.foxglove.dev", "https://lichtblick-suite.github.io"};

/// The first of kProtocols that the client offers; empty: none.
std::string_view protocol_of(const Request& r) {
  const http::token_list offered{r[http::field::sec_websocket_protocol]};
  for (const std::string_view each : kProtocols)
    if (std::any_of(offered.begin(), offered.end(), [&](const auto& token) { return token == each; })) return each;
  return {};
}

}  // namespace

bool may_listen(std::string_view origin) {
  if (origin.empty() || origin == "file://" || std::find(kSites.begin(), kSites.end(), origin) != kSites.end())
    return true;
  constexpr std::string_view kScheme = "http://";
  if (!origin.starts_with(kScheme)) return false;
  const std::optional<unsigned> port = port_of_literal_host(origin.substr(kScheme.size()));
  return port && *port <= 65535;
}

struct FoxgloveServer::Impl {
  using Frame = std::shared_ptr<const std::string>;

  struct Message {
    std::uint16_t channel;
    std::uint64_t time_ns;
    std::string bytes;
  };
  struct Channel {
    std::string advertised;  ///< JSON
    std::optional<Message> newest;
  };
  struct Subscription {
    std::uint32_t id;
    std::uint16_t channel;
    std::uint64_t after_ns = 0;  ///< only messages after this time: the newest one was sent when it subscribed
  };
  struct Client {
    explicit Client(tcp::socket s) : socket{std::move(s)} {}
    websocket::stream<beast::tcp_stream, false> socket;
    beast::flat_buffer arriving;
    Request request;
    std::vector<Subscription> subscriptions;
    std::size_t told = 0;  ///< channels advertised to it
    std::deque<std::pair<Frame, bool>> pending;
    std::size_t pending_bytes = 0;
    bool ready = false, writing = false;
  };
  using Shared = std::shared_ptr<Client>;

  Impl(const std::string& address, std::string_view name)
      : acceptor{listen_at(context, address, "--foxglove")},
        url{"ws://" + reached_at(acceptor)},
        local{acceptor.local_endpoint().address().is_loopback()},
        info{std::make_shared<const std::string>(fmt::format(
            R"({{"op":"serverInfo","name":{},"capabilities":[],"supportedEncodings":[],"metadata":{{}},"sessionId":"{:016x}"}})",
            json_string(name), system_random()))},
        timer{context} {
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
      if (!error && clients.size() < kClients) {
        const auto client = std::make_shared<Client>(std::move(socket));
        clients.push_back(client);
        client->socket.next_layer().expires_after(kRequestTime);
        http::async_read(client->socket.next_layer(), client->arriving, client->request,
                         [this, client](Error failed, std::size_t) {
                           if (failed) return drop(client);
                           greet(client);
                         });
      }
      accept_later.expires_after(error ? 100ms : 0ms);
      accept_later.async_wait([this](Error) { accept(); });
    });
  }

  void greet(const Shared& client) {
    const Request& r = client->request;
    const std::string_view protocol = protocol_of(r);
    if (!websocket::is_upgrade(r) || protocol.empty())
      return refuse(client, http::status::upgrade_required,
                    "This address speaks foxglove.websocket.v1: connect Foxglove or Lichtblick to it.\n");
    if (!may_listen(r[http::field::origin]))
      return refuse(client, http::status::forbidden, "Another web site may not connect.\n");
    client->socket.next_layer().expires_never();
    client->socket.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
    client->socket.set_option(websocket::stream_base::decorator([protocol](websocket::response_type& response) {
      response.set(http::field::sec_websocket_protocol, protocol);
    }));
    client->socket.read_message_max(kLargestCommand);
    client->socket.async_accept(client->request, [this, client](Error error) {
      if (error) return drop(client);
      client->ready = true;
      send(client, info, true);
      advertise(client);
      read(client);
    });
  }

  void refuse(const Shared& client, http::status status, const char* why) {
    const auto response = std::make_shared<http::response<http::string_body>>(status, 11);
    response->set(http::field::content_type, "text/plain");
    response->body() = why;
    response->keep_alive(false);
    response->prepare_payload();
    http::async_write(client->socket.next_layer(), *response,
                      [this, client, response](Error, std::size_t) { drop(client); });
  }

  void read(const Shared& client) {
    client->arriving.clear();
    client->socket.async_read(client->arriving, [this, client](Error error, std::size_t size) {
      if (error) return drop(client);
      if (client->socket.got_text()) obey(client, {static_cast<const char*>(client->arriving.data().data()), size});
      read(client);
    });
  }

  void obey(const Shared& client, std::string_view text) {
    const FoxgloveCommand command = parse_foxglove_command(text);
    for (const std::string& each : command.complaints) complain(client, each);
    for (const auto& [id, channel] : command.subscribe)
      if (client->subscriptions.size() >= kSubscriptions || !subscribe(client, id, channel))
        complain(client, "a subscription is of no channel here, or is one too many");
    for (const std::uint32_t id : command.unsubscribe)
      std::erase_if(client->subscriptions, [&](const Subscription& s) { return s.id == id; });
    count_subscriptions();
  }
  bool subscribe(const Shared& client, std::uint32_t id, std::uint32_t channel) {
    if (channel < 1 || channel > client->told) return false;
    std::erase_if(client->subscriptions, [&](const Subscription& s) { return s.id == id; });
    Subscription& added = client->subscriptions.emplace_back(Subscription{id, static_cast<std::uint16_t>(channel)});
    count_subscriptions();  // first: what is written from here on is kept for it
    std::optional<Message> newest;
    {
      const std::lock_guard lock{mutex};
      newest = channels[channel - 1].newest;
    }
    if (newest) {
      added.after_ns = newest->time_ns;
      send(client, frame_of(*newest, id), false);
    }
    return true;
  }
  void count_subscriptions() {
    std::size_t all = 0;
    for (const Shared& each : clients) all += each->subscriptions.size();
    subscriptions = all;
  }
  void complain(const Shared& client, std::string_view why) {
    if (client->pending_bytes > kLargestCommand) return;  // it does not read
    send(client, std::make_shared<const std::string>(fmt::format(R"({{"op":"status","level":2,"message":"{}"}})", why)),
         true);
  }

  /// Channels that the client does not know yet.
  void advertise(const Shared& client) {
    std::vector<std::string> news;
    {
      const std::lock_guard lock{mutex};
      for (; client->told < channels.size(); ++client->told) news.push_back(channels[client->told].advertised);
    }
    if (!news.empty())
      send(client,
           std::make_shared<const std::string>(
               fmt::format(R"({{"op":"advertise","channels":[{}]}})", fmt::join(news, ","))),
           true);
  }

  static Frame frame_of(const Message& m, std::uint32_t subscription) {
    std::string frame(1 + sizeof subscription + sizeof m.time_ns, '\x01');
    std::memcpy(frame.data() + 1, &subscription, sizeof subscription);
    std::memcpy(frame.data() + 1 + sizeof subscription, &m.time_ns, sizeof m.time_ns);
    return std::make_shared<const std::string>(frame + m.bytes);
  }

  void tick() {
    timer.expires_after(kEvery);
    timer.async_wait([this](Error) {
      std::vector<Message> messages;
      {
        const std::lock_guard lock{mutex};
        messages.swap(written);
        written_bytes = 0;
      }
      for (const Shared& client : std::vector<Shared>{clients}) {
        if (!client->ready) continue;
        advertise(client);
        for (const Message& m : messages)
          for (const Subscription& s : client->subscriptions)
            if (s.channel == m.channel && m.time_ns > s.after_ns) send(client, frame_of(m, s.id), false);
      }
      tick();
    });
  }

  void send(const Shared& client, Frame frame, bool is_text) {
    if (!is_text && client->pending_bytes + frame->size() > kMostPending) return;
    client->pending_bytes += frame->size();
    client->pending.emplace_back(std::move(frame), is_text);
    if (!client->writing) write_next(client);
  }
  void write_next(const Shared& client) {
    if (client->pending.empty()) return;
    client->writing = true;
    const auto [frame, is_text] = client->pending.front();
    client->socket.text(is_text);
    client->socket.async_write(asio::buffer(*frame), [this, client, keep = frame](Error error, std::size_t) {
      client->writing = false;
      if (error) return drop(client);
      client->pending_bytes -= keep->size();
      client->pending.pop_front();
      write_next(client);
    });
  }

  void drop(const Shared& client) {
    client->ready = false;
    client->socket.next_layer().close();
    std::erase(clients, client);
    count_subscriptions();
  }

  asio::io_context context{1};
  tcp::acceptor acceptor;
  std::string url;
  bool local;
  Frame info;
  asio::steady_timer timer, accept_later{context};
  std::vector<Shared> clients;
  std::atomic<std::size_t> subscriptions{0};

  std::mutex mutex;  ///< of what follows
  std::vector<Channel> channels;
  std::vector<Message> written;
  std::size_t written_bytes = 0;

  std::thread thread;
};

FoxgloveServer::FoxgloveServer(const std::string& address, std::string_view name)
    : impl_{std::make_unique<Impl>(address, name)} {}
FoxgloveServer::~FoxgloveServer() = default;

std::uint16_t FoxgloveServer::add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                                          const mcap::Metadata&) {
  const std::lock_guard lock{impl_->mutex};
  const auto id = static_cast<std::uint16_t>(impl_->channels.size() + 1);
  impl_->channels.push_back({foxglove_channel(id, topic, schema, descriptors), {}});
  return id;
}

void FoxgloveServer::write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) {
  const std::lock_guard lock{impl_->mutex};
  impl_->channels[channel - 1U].newest = Impl::Message{channel, log_time_ns, std::string{message}};
  if (impl_->subscriptions == 0 || impl_->written_bytes + message.size() > kMostPending) return;
  impl_->written.push_back(*impl_->channels[channel - 1U].newest);
  impl_->written_bytes += message.size();
}

const std::string& FoxgloveServer::url() const {
  return impl_->url;
}
bool FoxgloveServer::is_local() const {
  return impl_->local;
}

}  // namespace twoport
