#include "common/platform/foxglove_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/endian/conversion.hpp>
#include <chrono>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/text.h"
#include "common/platform/random.h"
#include "common/platform/web_server.h"
#include "common/recording/foxglove.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr auto kEvery = 20ms;
constexpr std::size_t kClients = 8, kSubscriptions = 1000, kLargestCommand = 65536;
constexpr std::size_t kMostPending = std::size_t{8} << 20;  // [B], of one client, and of what is not sent yet
constexpr std::array<std::string_view, 2> kProtocols = {"foxglove.websocket.v1", "foxglove.sdk.v1"};
constexpr std::array<std::string_view, 2> kSites = {"https://app.foxglove.dev", "https://lichtblick-suite.github.io"};

/// The first of kProtocols that is among those offered; empty: none.
std::string_view protocol_of(const std::vector<std::string_view>& offered) {
  for (const std::string_view each : kProtocols)
    if (std::find(offered.begin(), offered.end(), each) != offered.end()) return each;
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
  using Frame = WebSession::Text;

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
  struct Client final : WebSession {
    explicit Client(Impl& of) : server{of} {}
    void opened() override {
      ready = true;
      send(server.info, true);
      server.advertise(*this);
    }
    void heard(std::string_view text, bool is_text) override {
      if (is_text) server.obey(*this, text);
    }
    void sent() override {
      pending_bytes -= pending.front().first->size();
      pending.pop_front();
      write_next();
    }
    void closed() override {
      std::erase(server.clients, this);
      server.count_subscriptions();
    }
    void send(Frame frame, bool is_text) {
      if (!is_text && pending_bytes + frame->size() > kMostPending) return;
      pending_bytes += frame->size();
      pending.emplace_back(std::move(frame), is_text);
      if (!is_writing()) write_next();
    }
    void say(std::string text) { send(std::make_shared<const std::string>(std::move(text)), true); }
    void write_next() {
      if (!pending.empty()) write(pending.front().first, pending.front().second);
    }

    Impl& server;
    std::vector<Subscription> subscriptions;
    std::size_t told = 0;  ///< channels advertised to it
    std::deque<std::pair<Frame, bool>> pending;
    std::size_t pending_bytes = 0;
    bool ready = false;
  };

  Impl(const std::string& address, std::string_view name)
      : info{std::make_shared<const std::string>(fmt::format(
            R"({{"op":"serverInfo","name":{},"capabilities":[],"supportedEncodings":[],"metadata":{{}},"sessionId":"{:016x}"}})",
            json_string(name), system_random()))},
        web{{.address = address,
             .flag = "--foxglove",
             .largest_message = kLargestCommand,
             .every = kEvery,
             .ping_every = 20s,
             .silence = 60s,
             .patience = 60s,
             .answer = [this](const WebRequest& r) { return answer(r); },
             .tick = [this] { pass_on(); }}},
        url{"ws://" + web.address()} {
    web.start();
  }

  WebAnswer answer(const WebRequest& r) {
    const std::string_view protocol = protocol_of(r.protocols);
    if (!r.upgrades || protocol.empty())
      return WebAnswer::refusal(426,
                                "This address speaks foxglove.websocket.v1: connect Foxglove or Lichtblick to it.\n");
    if (!may_listen(r.origin)) return WebAnswer::refusal(403, "Another web site may not connect.\n");
    if (clients.size() >= kClients) return WebAnswer::refusal(503, "Eight listen; close one.\n");
    auto client = std::make_unique<Client>(*this);
    clients.push_back(client.get());
    return {.session = std::move(client), .protocol = std::string{protocol}};
  }

  void obey(Client& client, std::string_view text) {
    const FoxgloveCommand command = parse_foxglove_command(text);
    for (const std::string& each : command.complaints) complain(client, each);
    for (const auto& [id, channel] : command.subscribe)
      if (client.subscriptions.size() >= kSubscriptions || !subscribe(client, id, channel))
        complain(client, "a subscription is of no channel here, or is one too many");
    for (const std::uint32_t id : command.unsubscribe)
      std::erase_if(client.subscriptions, [&](const Subscription& s) { return s.id == id; });
    count_subscriptions();
  }
  bool subscribe(Client& client, std::uint32_t id, std::uint32_t channel) {
    if (channel < 1 || channel > client.told) return false;
    std::erase_if(client.subscriptions, [&](const Subscription& s) { return s.id == id; });
    Subscription& added = client.subscriptions.emplace_back(Subscription{id, static_cast<std::uint16_t>(channel)});
    count_subscriptions();  // first: what is written from here on is kept for it
    const std::optional<Message> newest = [&] {
      const std::lock_guard lock{mutex};
      return channels[channel - 1].newest;
    }();
    if (newest) {
      added.after_ns = newest->time_ns;
      client.send(frame_of(*newest, id), false);
    }
    return true;
  }
  void count_subscriptions() {
    std::size_t all = 0;
    for (const Client* each : clients) all += each->subscriptions.size();
    subscriptions = all;
  }
  void complain(Client& client, std::string_view why) {
    if (client.pending_bytes > kLargestCommand) return;  // it does not read
    client.say(fmt::format(R"({{"op":"status","level":2,"message":"{}"}})", why));
  }

  /// Channels that the client does not know yet.
  void advertise(Client& client) {
    std::vector<std::string> news;
    {
      const std::lock_guard lock{mutex};
      for (; client.told < channels.size(); ++client.told) news.push_back(channels[client.told].advertised);
    }
    if (!news.empty()) client.say(fmt::format(R"({{"op":"advertise","channels":[{}]}})", fmt::join(news, ",")));
  }

  static Frame frame_of(const Message& m, std::uint32_t subscription) {
    std::string frame(1 + sizeof subscription + sizeof m.time_ns, '\x01');
    auto* const to = reinterpret_cast<unsigned char*>(frame.data()) + 1;
    boost::endian::store_little_u32(to, subscription);
    boost::endian::store_little_u64(to + sizeof subscription, m.time_ns);
    return std::make_shared<const std::string>(frame + m.bytes);
  }

  void pass_on() {
    std::vector<Message> messages;
    {
      const std::lock_guard lock{mutex};
      messages.swap(written);
      written_bytes = 0;
    }
    for (Client* const client : clients) {
      if (!client->ready) continue;
      advertise(*client);
      for (const Message& m : messages)
        for (const Subscription& s : client->subscriptions)
          if (s.channel == m.channel && m.time_ns > s.after_ns) client->send(frame_of(m, s.id), false);
    }
  }

  Frame info;
  std::vector<Client*> clients;
  std::atomic<std::size_t> subscriptions{0};

  std::mutex mutex;  ///< of what follows
  std::vector<Channel> channels;
  std::vector<Message> written;
  std::size_t written_bytes = 0;

  WebServer web;
  std::string url;
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
  return impl_->web.is_local();
}

}  // namespace twoport
