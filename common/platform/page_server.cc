#include "common/platform/page_server.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <boost/endian/conversion.hpp>
#include <chrono>
#include <csignal>
#include <optional>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/text.h"
#include "common/platform/random.h"
#include "common/platform/web_server.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;
using Now = std::chrono::steady_clock;

constexpr auto kFrameTime = 16ms;          // between two messages to a client
constexpr auto kJudging = 250ms;           // between two verdicts
constexpr auto kLastWords = 150ms;         // for the end of the run to reach the pages
constexpr std::size_t kSockets = 8;        // WebSockets at once
constexpr std::size_t kMostSamples = 128;  // in one message
constexpr std::uint16_t kUnknownData = 1003, kPolicyError = 1008, kTryAgainLater = 1013;  // RFC 6455, 7.4.1

/// Are they the same, in a time that does not depend on where they differ?
bool same(std::string_view a, std::string_view b) {
  unsigned different = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < a.size(); ++i) different |= static_cast<unsigned>(a[i] ^ b[i % b.size()]);
  return different == 0;
}

}  // namespace

struct PageServer::Impl {
  using Text = WebSession::Text;

  struct Client final : WebSession {
    explicit Client(Impl& of) : page{of} {}
    void opened() override {
      greeted = untold = true;
      write(page.introduction, true);
      if (page.controlling == nullptr) page.give_control(this);
    }
    void heard(std::string_view text, bool is_text) override { is_text ? page.obey(*this, text) : end(kUnknownData); }
    void sent() override { page.write_next(*this); }
    void closed() override { page.forget(*this); }

    Impl& page;
    bool holds = false, greeted = false;
    bool untold = false;  ///< status() has changed since it was sent
    Text samples;         ///< newest that are not sent yet
    Now::time_point commanded = Now::now();
  };

  Impl(const Options& o, PageChannel& c, PageJudge j)
      : options{o},
        channel{c},
        judge{std::move(j)},
        introduction{std::make_shared<const std::string>(o.introduction)},
        server{{.address = o.address,
                .flag = "--page",
                .largest_message = kLargestMessage,
                .every = kFrameTime,
                .request_time = o.request_time,
                .ping_every = o.ping_every,
                .silence = o.silence,
                .answer = [this](const WebRequest& r) { return answer(r); },
                .tick = [this] { tick(); }}} {
    if (!server.is_local()) query = fmt::format("?token={:016x}{:016x}", system_random(), system_random());
    url = fmt::format("http://{}/{}", server.address(), query);
    server.start();
  }

  void tick() {
    send_samples();
    if (const auto now = Now::now(); now - judged > kJudging) {
      judged = now;
      verdict = judge.verdict();
      if (std::string news = *status(false); news != told) {
        told = std::move(news);
        tell_all();
      }
    }
  }

  void send_samples() {
    std::size_t count = 0;
    PageSample sample;
    while (channel.samples.try_pop(sample)) {
      sample.dropped = static_cast<double>(channel.samples.dropped());
      judge.add(sample);
      batch[count++ % kMostSamples] = sample;
    }
    if (count == 0 || clients.empty()) return;
    std::string numbers;
    for (std::size_t i = count - std::min(count, kMostSamples); i < count; ++i)
      for_each_page_field(
          batch[i % kMostSamples],
          [&](const char*, std::size_t size, const double* values) {
            for (const double each : std::span{values, size}) {
              const auto bits = boost::endian::native_to_little(std::bit_cast<std::uint64_t>(each));
              numbers.append(reinterpret_cast<const char*>(&bits), sizeof bits);
            }
          },
          options.joints);
    const auto message = std::make_shared<const std::string>(std::move(numbers));
    for (Client* const client : clients) {
      if (!client->greeted) continue;
      if (client->is_writing()) {
        client->samples = message;
      } else {
        client->write(message, false);
      }
    }
  }

  WebAnswer answer(const WebRequest& r) {
    const auto refuse = WebAnswer::refusal;
    if (!is_literal_host(r.host, server.port()))
      return refuse(421, "Use localhost or the IP address of this machine in the address.\n");
    const std::string_view path = r.target.substr(0, r.target.find('?'));
    if (!query.empty() && !same(r.target.substr(path.size()), query))
      return refuse(403,
                    "This address needs a token. Open the link that twoport-master printed when it started: it holds "
                    "the token.\n");
    if (path == "/live") return upgrade(r);
    if (r.method != "GET" && r.method != "HEAD") return refuse(405, "Only GET is allowed.\n");
    if (path != "/" && path != "/index.html") return refuse(404, "Nothing is at this address.\n");
    // What may run is said in the page itself, by the digests of its script and style.
    return {.body = std::string{options.page},
            .fields = {{"Content-Type", "text/html; charset=utf-8"},
                       {"Content-Security-Policy",
                        fmt::format("connect-src 'self' ws://{}; base-uri 'none'; form-action 'none'; "
                                    "frame-ancestors 'none'",
                                    r.host)},
                       {"X-Content-Type-Options", "nosniff"},
                       {"Referrer-Policy", "no-referrer"},
                       {"Cache-Control", "no-cache"}}};
  }
  WebAnswer upgrade(const WebRequest& r) {
    if (!r.upgrades) return WebAnswer::refusal(426, "This address is a WebSocket.\n");
    if (!is_own_origin(r.host, r.origin)) return WebAnswer::refusal(403, "Another web site may not connect.\n");
    if (!has_place()) return WebAnswer::refusal(503, "Eight pages are open; close one.\n");
    auto client = std::make_unique<Client>(*this);
    clients.push_back(client.get());
    return {.session = std::move(client)};
  }
  /// A place for a further WebSocket, if need be that of a spectator.
  bool has_place() {
    if (clients.size() < kSockets) return true;
    Client* idlest = nullptr;
    for (Client* const c : clients)
      if (!c->holds && (idlest == nullptr || c->commanded < idlest->commanded)) idlest = c;
    if (idlest == nullptr || Now::now() - idlest->commanded < options.spectator_time) return false;
    idlest->end(kTryAgainLater);
    return true;
  }

  void obey(Client& client, std::string_view text) {
    const std::optional<PageCommand> command = parse_page_command(text);
    if (!command) return client.end(kPolicyError);
    client.commanded = Now::now();
    using enum PageCommand::Kind;
    if ((command->kind == target || command->kind == take) && !held_by_another(client)) give_control(&client);
    if (controlling != &client) return;
    // A target that stays where it is moves nothing.
    if (command->kind != target || !client.holds || command->number != aim) judge.disturb();
    if (command->kind == target) {
      client.holds = true;
      aim = command->number;
    }
    if (command->kind == release) return let_go(client);
    if (command->kind == restart && options.restartable) {
      restarting = true;
      std::raise(SIGTERM);
    }
    if (command->kind == take || command->kind == restart) return;
    (command->is_of_hand() ? channel.hand : channel.commands).try_push(*command);
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
    for (Client* const client : clients) {
      if (!client->greeted) continue;
      client->untold = true;
      if (!client->is_writing()) write_next(*client);
    }
  }
  void write_next(Client& client) {
    if (std::exchange(client.untold, false)) {
      client.write(status(controlling == &client), true);
    } else {
      client.write(std::exchange(client.samples, nullptr), false);
    }
  }

  bool held_by_another(const Client& client) const {
    return std::any_of(clients.begin(), clients.end(), [&](const Client* c) { return c != &client && c->holds; });
  }
  void let_go(Client& client) {
    // Where the ring is full the device's own time limit releases the handle.
    if (std::exchange(client.holds, false)) channel.hand.try_push({});
  }
  void forget(Client& client) {
    let_go(client);
    std::erase(clients, &client);
    if (controlling != &client) return;
    const auto next = std::find_if(clients.begin(), clients.end(), [](const Client* c) { return c->greeted; });
    controlling = nullptr;
    if (next != clients.end()) give_control(*next);
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
  std::string over;        ///< how the run ended
  std::string url, query;  ///< query: "?token=…", what a request must end with
  Text introduction;
  std::vector<Client*> clients;  ///< those that have not ended, in the order of their arrival
  std::array<PageSample, kMostSamples> batch{};
  WebServer server;
};

PageServer::PageServer(const Options& options, PageChannel& channel, PageJudge judge)
    : impl_{std::make_unique<Impl>(options, channel, std::move(judge))} {}
PageServer::~PageServer() = default;
void PageServer::end(const std::string& how) {
  impl_->server.post([impl = impl_.get(), how] {
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
  return impl_->server.is_local();
}

}  // namespace twoport
