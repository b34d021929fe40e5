#include "common/wire/handshake.h"

#include <algorithm>
#include <utility>

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr Duration kSilent = 100ms;         // after which a peer may be gone
constexpr Duration kRefusalEvery = 20ms;    // at most one so often
constexpr Duration kRefusalLinger = 500ms;  // during which the refused one is told
constexpr Duration kTakenAfter = 1s;        // asking in vain before an unpaired peer is told that the slave is taken
constexpr Duration kGoneAfter = 1s;         // of silence: then the slave takes up an earlier master that still lives

bool within(Duration span, std::optional<Duration> moment, Duration now) {
  return moment && now - *moment < span;
}

}  // namespace

void ClosedSessions::add(std::uint64_t session) noexcept {
  sessions_[next_++ % sessions_.size()] = session;
}
bool ClosedSessions::has(std::uint64_t session) const noexcept {
  return std::find(sessions_.begin(), sessions_.end(), session) != sessions_.end();
}

Handshake::Handshake(const SessionOptions& options, int dof, SessionNumbers numbers)
    : options_{options},
      dof_{dof},
      numbers_{std::move(numbers)},
      session_{draw()},
      offer_{options.side == Side::master ? session_ : draw()},
      peer_{options.peer} {}

Handshake::Handshake(const SessionOptions& options, int dof, SessionNumbers numbers, const PairedSession& session)
    : Handshake{options, dof, std::move(numbers)} {
  session_ = session.session;
  if (options.side == Side::master) offer_ = session_;
  begin({session.peer, session.peer_session, Duration{0}});
  returned_ = Duration{0};
}

std::uint64_t Handshake::draw() const noexcept {
  std::uint64_t number = 0;
  while (number == 0) number = numbers_();
  return number;
}
Identity Handshake::identity() const noexcept {
  return {dof_, options_.peer_rate_hz, options_.scene_digest, options_.side};
}

// ---- in

void Handshake::advance(Duration now) noexcept {
  if (mismatch_found_ && now - *mismatch_found_ >= kRefusalLinger) ended_ = true;
}

Handshake::Action Handshake::on(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept {
  if (!header.refusal.empty()) return on_refusal(header, from);
  if (header.session == peer_session_ && from == peer_) return on_current(header, decoded, now);
  return on_unknown(header, decoded, from, now);
}

Handshake::Action Handshake::on_refusal(const Header& header, const Endpoint& from) noexcept {
  // It must know our number: whoever has never heard us cannot refuse us.
  const bool knows_us = header.peer_session == session_ || header.peer_session == offer_;
  if (!knows_us || (peer_ && from != *peer_)) return Action::reject;
  reject_reason_ = Sentence{header.refusal};
  ended_ = true;
  return Action::end;
}

Handshake::Action Handshake::on_current(const Header& header, Decoded decoded, Duration now) noexcept {
  if (decoded != Decoded::ok) return Action::reject;
  heard_ = now;
  if (header.peer_session != session_) return Action::wait;
  // A slave introduces itself until it has taken us up, and takes up only who introduces itself.
  if (options_.side == Side::slave || !header.identity) returned_ = now;
  return mismatch_found_ ? Action::wait : Action::deliver;
}

Handshake::Action Handshake::on_unknown(const Header& header, Decoded decoded, const Endpoint& from,
                                        Duration now) noexcept {
  const bool introduces_itself = header.identity.has_value() || decoded == Decoded::other_version;
  if (!introduces_itself || header.session == session_ || header.session == peer_session_) return Action::reject;
  const bool elsewhere = peer_ && from != *peer_;
  const bool preempts = elsewhere && within(kSilent, heard_, now);
  const Sentence why = mismatch(options_, dof_, header, decoded);
  if (!why.empty()) {
    // Whom we are working with has not changed its mind.
    if (!preempts && !mismatch_found_) {
      reject_reason_ = why;
      mismatch_found_ = now;
    }
    return refuse(header, why, now);
  }
  if (preempts) return on_unpaired_peer(header, now);
  // A late packet of a session that is over. Only a master may still be living behind one, squeezed out by another.
  if (closed_.has(header.session) && (options_.side == Side::master || within(kGoneAfter, heard_, now)))
    return Action::reject;
  // A packet that somebody has kept introduces itself like any other, but cannot know the number of now.
  const bool returns_offer = header.peer_session == offer_;
  if (!returns_offer && options_.side == Side::master) return Action::reject;
  if (mismatch_found_) return Action::wait;
  if (!returns_offer) {
    greeting_ = Invitation{from, header.session};
    return Action::reply;
  }
  candidate_ = Candidate{from, header.session, now};
  return Action::pair;
}

/// One that would do, while we are working with another.
Handshake::Action Handshake::on_unpaired_peer(const Header& header, Duration now) noexcept {
  if (waiting_session_ != header.session) {
    waiting_session_ = header.session;
    waiting_since_ = now;
    return Action::reject;
  }
  if (now - waiting_since_ < kTakenAfter) return Action::reject;
  return refuse(header,
                Sentence{"the %s is taken: it is working with another %s", to_string(options_.side),
                         to_string(header.identity->side)},
                now);
}

Handshake::Action Handshake::refuse(const Header& header, const Sentence& why, Duration now) noexcept {
  if (within(kRefusalEvery, refused_at_, now)) return Action::reject;
  refused_at_ = now;
  refused_session_ = header.session;
  refusal_ = why;
  return Action::refuse;
}

// ---- out

std::optional<Handshake::Greeting> Handshake::take_greeting() noexcept {
  if (!greeting_) return std::nullopt;
  Greeting greeting{greeting_->to, {}};
  greeting.header.session = offer_;
  greeting.header.peer_session = greeting_->session;
  greeting.header.identity = identity();
  greeting_.reset();
  return greeting;
}

Header Handshake::header(Duration now) const noexcept {
  Header header;
  header.session = session_;
  header.peer_session = peer_session_;
  if (!coupled(now)) header.identity = identity();
  return header;
}

Header Handshake::refusal() const noexcept {
  Header header;
  header.session = session_;
  header.peer_session = refused_session_;
  header.identity = identity();
  header.refusal = refusal_.view();
  return header;
}

// ---- state

bool Handshake::take_new_session() noexcept {
  if (!candidate_) return false;
  if (pairings_ > 0) closed_.add(peer_session_);
  // A master that comes back has kept its number: a new one of ours makes it, too, start its totals again.
  if (options_.side == Side::slave) session_ = std::exchange(offer_, draw());
  begin(*candidate_);
  candidate_.reset();
  return true;
}

void Handshake::begin(const Candidate& candidate) noexcept {
  peer_session_ = candidate.session;
  peer_ = candidate.from;
  paired_since_ = candidate.since;
  heard_ = paired_since_;
  returned_.reset();
  if (!first_paired_) first_paired_ = paired_since_;
  ++pairings_;
  waiting_session_ = 0;
}

std::string_view Handshake::reject_reason() const noexcept {
  return ended_ ? reject_reason_.view() : std::string_view{};
}
bool Handshake::coupled(Duration now) const noexcept {
  return within(kSilent, returned_, now);
}

}  // namespace twoport
