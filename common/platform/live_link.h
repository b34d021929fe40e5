#pragma once

#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/histogram.h"
#include "common/link/clock_offset.h"
#include "common/link/impaired_socket.h"
#include "common/link/mailbox.h"
#include "common/page/channel.h"
#include "common/platform/key_file.h"
#include "common/platform/log.h"
#include "common/platform/program.h"
#include "common/platform/random.h"
#include "common/platform/recorder.h"
#include "common/platform/udp.h"
#include "common/recording/tick.h"
#include "common/runtime/cycle.h"
#include "common/runtime/modes.h"
#include "common/safety/guarded_transport.h"
#include "common/scene/load.h"
#include "common/secure/secure_socket.h"
#include "common/wire/link_transport.h"

namespace twoport {

/// The link of a live run: the mailbox of the cycle, and the session with the peer.
template <int N>
class LiveLink {
 public:
  using Transport = TappedTransport<N, GuardedTransport<N, LinkTransport<N>>>;

  /// A master calls the slave at the address, a slave listens there. Throws ConfigError for an address of another machine
  /// without a key. `adjustable`: with a further network that adjust() changes.
  LiveLink(Side side, const Scene& scene, const LiveArguments& arguments, bool adjustable = false);
  LiveLink(const LiveLink&) = delete;  // its parts refer to each other

  [[nodiscard]] Mailbox<N, Transport>& mail() noexcept { return mail_; }
  [[nodiscard]] const PeerState<N>& known() const noexcept { return mail_.known(); }
  void tap(ReportTap<N>* tap) noexcept { mail_.transport().tap(tap); }
  /// `log` is used until this is destroyed, from another thread too.
  void say_where(spdlog::logger& log);

  /// Says that the other side has not come, and what to do.
  [[nodiscard]] std::string not_met();

  /// Call before every cycle. True when the other side appears for the first time or has restarted; the node's totals
  /// then restart with the peer's.
  template <class Node>
  bool met(Node& node) noexcept {
    if (!mail_.transport().take_new_session()) return false;
    node.on_peer_restart(Energy{mail_.known().energy_in_j});
    mail_.reset(session_since());
    clock_ = {};
    return true;
  }
  /// Every report of this session was made after this time of this side.
  [[nodiscard]] Duration session_since() noexcept { return mail_.transport().handshake().session_since(); }
  /// Reason why the two sides cannot work together, or empty.
  [[nodiscard]] std::string_view refusal() noexcept { return mail_.transport().reject_reason(); }
  /// After the last cycle, at the time `now`: this side ends, and the other one releases at once. Repeated for 0.1 s: packets are lost.
  void say_goodbye(Duration now) noexcept;
  /// After every cycle.
  void note() noexcept {
    const PeerState<N>& peer = mail_.known();
    if (peer.is_new && peer.round_trip() >= Duration{0}) round_trip_.add(peer.round_trip());
    clock_.step(peer);
  }

  /// Changes what is added to the scene's network, where the link is adjustable.
  void adjust(bool outgoing, const ImpairedSocket::Direction& d) noexcept {
    if (!adjustable_) return;
    if (outgoing) {
      adjustable_->set_outgoing(d);
    } else {
      adjustable_->set_incoming(d);
    }
  }

  [[nodiscard]] TickView view(Duration now) noexcept;
  /// Of what the other side claims.
  [[nodiscard]] const LimitCounts& limit_counts() noexcept { return mail_.transport().limit_counts(); }

  /// Link figures of the summary.
  void fill(Summary& s, Mode mode);
  /// Packets dropped because the simulated network was full.
  [[nodiscard]] std::uint64_t overflowed() { return mail_.transport().counts().overflowed; }

 private:
  static constexpr std::uint64_t kPageStream = 0x70616765;
  /// In addition to the scene's network, and none at first.
  static ImpairedSocketOptions of_page(Side side, const Scene& scene, const Endpoint& peer) {
    ImpairedSocketOptions o = network(side, scene, peer);
    o.incoming = {};
    o.seed = scene.seed ^ kPageStream;
    o.rate_hz = side == Side::master ? scene.master_rate_hz : scene.slave_rate_hz;
    o.longest_set_s = 1e-3 * (kPageDelayMs + 10.0 * kPageJitterMs);
    return o;
  }
  std::unique_ptr<SecureSocket> secured(Duration rekey_after) {
    if (key_file_.empty()) return nullptr;
    const bool is_slave = side_ == Side::slave;
    const KeyList list = read_keys(key_file_, is_slave);
    key_names_ = list.names;
    SecureSocketOptions options{.server = is_slave, .peer = peer_, .own_thread = true, .rekey_after = rekey_after};
    options.tell = [this](HandshakeFailure failure, const Endpoint& peer, std::size_t key) {
      spdlog::logger* const log = log_.load();
      if (log == nullptr) return;
      if (failure == HandshakeFailure::none) {
        log->info("{} has the key {}", to_string(peer), key_names_[key]);
      } else {
        log->warn("a handshake with {} has failed: {}", to_string(peer), cause_of(failure));
      }
    };
    return std::make_unique<SecureSocket>(network_, options, list.keys);
  }
  [[nodiscard]] std::string key_count() const {
    return key_names_.size() == 1 ? "the key" : std::to_string(key_names_.size()) + " keys";
  }
  [[nodiscard]] const char* cause_of(HandshakeFailure failure) const {
    switch (failure) {
      case HandshakeFailure::other_key:
        return key_names_.size() > 1 ? "it has another key; put a copy of its key into the folder of --key"
                                     : "it has another key; start both with the same --key";
      case HandshakeFailure::earlier_version:
        return "it is of an earlier version of twoport; install the same version on both sides";
      default:
        return "packets are lost; check the network";
    }
  }
  DatagramSocket& top() noexcept {
    if (secure_) return *secure_;
    return network_;
  }
  /// Why no session has come about, where it is a matter of keys; else empty.
  [[nodiscard]] std::string key_advice() {
    const Rejected rejected = mail_.transport().counts().rejected;
    const HandshakeFailure failure = secure_ ? secure_->last_failure() : HandshakeFailure::none;
    if (failure != HandshakeFailure::none && secure_->associations() == 0)
      return (side_ == Side::master ? "the program at " + address_ + " answered" : std::string{"a program called"}) +
             ", but the handshake did not succeed: " + cause_of(failure);
    if (secure_ && secure_->associations() == 0 && rejected.not_encrypted > 0)
      return "packets without encryption arrived; start both programs with the same --key, or both without";
    if (!secure_ && rejected.encrypted > 0)
      return "encrypted packets arrived, and this program has no key; start both programs with the same --key";
    return {};
  }
  static ImpairedSocketOptions network(Side side, const Scene& scene, std::optional<Endpoint> peer) {
    const bool master = side == Side::master;
    return {.incoming = master ? scene.to_master : scene.to_slave,
            .seed = scene.seed ^ (master ? kToMasterStream : kToSlaveStream),
            .peer_rate_hz = master ? scene.slave_rate_hz : scene.master_rate_hz,
            .peer = peer};
  }
  static const TransmissionOptions& incoming(Side side, const Scene& scene) {
    return side == Side::master ? scene.transmission_to_master : scene.transmission_to_slave;
  }
  static const TransmissionOptions& outgoing(Side side, const Scene& scene) {
    return side == Side::master ? scene.transmission_to_slave : scene.transmission_to_master;
  }
  static SessionOptions session(Side side, const Scene& scene, std::optional<Endpoint> peer, bool encrypted,
                                bool measures) {
    const bool master = side == Side::master;
    SessionOptions options{.side = side,
                           .rate_hz = master ? scene.master_rate_hz : scene.slave_rate_hz,
                           .peer_rate_hz = master ? scene.slave_rate_hz : scene.master_rate_hz,
                           .scene_digest = scene_digest(scene),
                           .peer = peer,
                           .tells_reasons = encrypted};
    if (measures) {
      options.scene_digest = kMeasurementDigest;
      return options;
    }
    for (const SharedField& field : shared_fields(scene)) {
      options.scene_field_names.push_back(field.path);
      const std::uint64_t folded = field.digest ^ field.digest >> 32;
      for (const int shift : {0, 16})
        options.scene_fields.push_back(static_cast<char>(folded >> shift ^ folded >> (shift + 8)));
    }
    return options;
  }

  Side side_;
  std::string address_, key_file_;
  Endpoint where_;
  std::optional<Endpoint> peer_;
  // The stack, from the wire up.
  std::atomic<spdlog::logger*> log_{nullptr};
  std::vector<std::string> key_names_;
  UdpSocket udp_;
  std::unique_ptr<ImpairedSocket> adjustable_;  ///< null: without a page
  ImpairedSocket network_;
  std::unique_ptr<SecureSocket> secure_;  ///< null: without a key
  Mailbox<N, Transport> mail_;
  Histogram round_trip_;
  ClockOffset clock_;
};

template <int N>
LiveLink<N>::LiveLink(Side side, const Scene& scene, const LiveArguments& arguments, bool adjustable)
    : side_{side},
      address_{arguments.address},
      key_file_{arguments.key},
      where_{parse_allowed_endpoint(address_, side == Side::master ? "--peer" : "--listen", !key_file_.empty(),
                                    arguments.insecure)},
      peer_{side == Side::master ? std::optional{where_} : std::nullopt},
      udp_{peer_ ? UdpSocket{any_port_toward(*peer_), *peer_} : UdpSocket{where_}},
      adjustable_{adjustable ? std::make_unique<ImpairedSocket>(udp_, of_page(side, scene, where_)) : nullptr},
      network_{adjustable_ ? static_cast<DatagramSocket&>(*adjustable_) : udp_, network(side, scene, peer_)},
      secure_{secured(to_duration(arguments.rekey_after_s))},
      mail_{Transport{
                side == Side::master ? limits_of_slave_reports(scene.control) : limits_of_master_reports(scene.control),
                top(), session(side, scene, peer_, secure_ != nullptr, arguments.measures),
                SessionNumbers{system_random}},
            age_of_reports(scene.control), incoming(side, scene), outgoing(side, scene)} {
  if (arguments.dscp != 0) udp_.mark(arguments.dscp);
  // Of a period: the rest is for the node.
  udp_.limit(to_duration(0.25 / (side == Side::master ? scene.master_rate_hz : scene.slave_rate_hz)));
}

template <int N>
void LiveLink<N>::say_where(spdlog::logger& log) {
  log_ = &log;
  if (side_ == Side::master) {
    log.info("waiting for a slave at {}", address_);
  } else {
    log.info("listening on {}", to_string(udp_.local()));
  }
  if (secure_) {
    log.info("packets are encrypted and authenticated with {} in {}", key_count(), key_file_);
  } else if (where_.loopback()) {
    log.info("without a key: every program on this machine can take part");
  } else {
    log.warn("--insecure: packets are neither encrypted nor authenticated; whoever reaches {} can take over",
             to_string(where_));
  }
}

template <int N>
std::string LiveLink<N>::not_met() {
  const std::string about_keys = key_advice();
  if (!about_keys.empty()) return about_keys;
  if (side_ == Side::master)
    return "no slave answered at " + address_ +
           " before --duration was over; start twoport-slave there, or set --peer to its address";
  return "no master called " + to_string(udp_.local()) +
         " before --duration was over; start twoport-master with this address, or the one of this machine, as --peer";
}

template <int N>
void LiveLink<N>::say_goodbye(Duration now) noexcept {
  constexpr Duration kEvery = std::chrono::milliseconds{5}, kFor = std::chrono::milliseconds{100};
  if (mail_.counts().sent == 0) return;
  for (Duration said{0}; said < kFor; said += kEvery) {
    mail_.transport().say_goodbye(now + said);
    std::this_thread::sleep_for(kEvery);
  }
}

template <int N>
TickView LiveLink<N>::view(Duration now) noexcept {
  return {.round_trip = mail_.known().round_trip(),
          .received = mail_.counts().received,
          .lost = mail_.counts().lost,
          .sessions = mail_.transport().pairings(),
          .refused = mail_.transport().counts().rejected.total(),
          .stale = mail_.counts().stale,
          .peer_mode = mail_.known().heard.mode,
          .silence = now - mail_.known().heard.at,
          .answers = mail_.known().heard.answers};
}

template <int N>
void LiveLink<N>::fill(Summary& s, Mode mode) {
  const LinkCounts link = mail_.transport().counts();
  auto *to_slave = s.mutable_packets()->mutable_to_slave(), *to_master = s.mutable_packets()->mutable_to_master();
  const bool master = side_ == Side::master;
  *(master ? to_master : to_slave) = received_packets(mail_.counts(), link.rejected);
  Packets& outgoing = *(master ? to_slave : to_master);
  outgoing.set_sent(count(mail_.counts().sent - link.unaddressed - link.unsent));
  outgoing.set_unsent(count(link.unsent));
  s.set_encrypted(secure_ != nullptr);
  if (secure_ && secure_->paired_key()) s.set_peer_key(key_names_[*secure_->paired_key()]);
  s.set_mode(to_string(mode));
  s.set_reconnects(count(std::max<std::uint64_t>(mail_.transport().pairings(), 1) - 1));
  *s.mutable_limits()->mutable_peer() = limits_of_peer(limit_counts());
  if (round_trip_.count() > 0) *s.mutable_rtt_ms() = percentiles(round_trip_, 1e6);
  if (master && clock_.known())
    *s.mutable_slave_clock() = clock_estimate(clock_.figures(to_seconds(mail_.known().received_at).si()));
}

TWOPORT_DECLARE(LiveLink);

/// The same without a link: the session begins with the first tick.
class NoLink {
 public:
  [[nodiscard]] NoMail& mail() noexcept { return mail_; }
  void tap(const void*) const noexcept {}
  void say_where(spdlog::logger&) const {}
  [[nodiscard]] std::string not_met() const { return {}; }
  template <class Node>
  bool met(Node&) noexcept {
    return !std::exchange(met_, true);
  }
  [[nodiscard]] static Duration session_since() noexcept { return {}; }
  [[nodiscard]] std::string_view refusal() const noexcept { return {}; }
  void note() const noexcept {}
  [[nodiscard]] TickView view(Duration) const noexcept { return {}; }
  void say_goodbye(Duration) const noexcept {}
  [[nodiscard]] LimitCounts limit_counts() const noexcept { return {}; }
  [[nodiscard]] std::uint64_t overflowed() const { return 0; }

 private:
  NoMail mail_;
  bool met_ = false;
};

}  // namespace twoport
