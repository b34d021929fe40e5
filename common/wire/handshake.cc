#include "common/wire/handshake.h"

#include <algorithm>
#include <utility>

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr Duration kSilent = 100ms;         // after which a peer may be gone
constexpr Duration kRefusalEvery = 20ms;    // at most one so often
constexpr Duration kRefusalLinger = 500ms;  // during which refusals are sent
constexpr Duration kRefusedFor = 200ms;  // and as often: then a refusal is believed, where anybody could have made it
constexpr int kRefusedTimes = 5;
constexpr Duration kTakenAfter = 1s;        // of requests before an unpaired peer is told that the slave is busy
constexpr Duration kFollowedAfter = 750ms;  // of silence: then another address may follow
constexpr Duration kGoneAfter = 1s;  // of silence: then the slave accepts an earlier master that is still running

/// Interval at which a slave renews its offer to a master of another session: the master may have closed the last one.
constexpr Duration kOfferFor = 500ms;

bool within(Duration span, std::optional<Duration> moment, Duration now) {
  return moment && now - *moment < span;
}

}  // namespace

Handshake::Handshake(const SessionOptions& options, int dof, SessionNumbers numbers)
    : options_{options},
      dof_{dof},
      numbers_{std::move(numbers)},
      session_{draw()},
      refusing_session_{draw()},
      peer_{options.peer} {
  offers_.add(options.side == Side::master ? session_ : draw());
}

Handshake::Handshake(const SessionOptions& options, int dof, SessionNumbers numbers, const PairedSession& session)
    : Handshake{options, dof, std::move(numbers)} {
  session_ = session.session;
  if (options.side == Side::master) offers_.add(session_);
  begin({session.peer, session.peer_session, session.session, Duration{0}});
  returned_ = Duration{0};
}

std::uint64_t Handshake::draw() const noexcept {
  std::uint64_t number = 0;
  while (number == 0) number = numbers_();
  return number;
}
Identity Handshake::identity() const noexcept {
  return {dof_, options_.peer_rate_hz, options_.scene_digest, options_.side, options_.scene_fields};
}

// ---- in

void Handshake::advance(Duration now) noexcept {
  if (mismatch_found_ && now - *mismatch_found_ >= kRefusalLinger) ended_ = true;
}

Handshake::Action Handshake::on(const Header& header, Decoded decoded, const Endpoint& from, Duration now) noexcept {
  if (!header.refusal.empty()) return on_refusal(header, from, now);
  if (header.session == peer_session_ && from == peer_) return on_current(header, decoded, from, now);
  return on_unknown(header, decoded, from, now);
}

/// Only a receiver of our packets can know one of these numbers.
bool Handshake::knows_us(const Header& header) const noexcept {
  return header.peer_session == session_ || offers_.has(header.peer_session);
}

/// Has the same been said often and for long enough? Without a key it could be anybody's, or damage.
bool Handshake::persists(std::string_view text, bool found_here, Duration now) noexcept {
  if (options_.tells_reasons) return true;
  if (objection_.times == 0 || objection_.text.view() != text) objection_ = {Sentence{text}, now, 0, found_here};
  return ++objection_.times >= kRefusedTimes && now - objection_.since >= kRefusedFor;
}

Handshake::Action Handshake::on_refusal(const Header& header, const Endpoint& from, Duration now) noexcept {
  if (header.peer_session == refusing_session_) {
    // The answer to a refusal of ours. A paired side continues.
    if (pairings_ > 0 || difference_.empty() || (options_.peer && from != *options_.peer)) return Action::reject;
    if (!persists(header.refusal, true, now)) return Action::reject;
    reject_reason_ = difference_;
    ended_ = true;
    return Action::end;
  }
  // A late one does not end an active session.
  if (!knows_us(header) || (peer_ && from != *peer_) || coupled(now)) return Action::reject;
  if (!options_.tells_reasons && within(kFollowedAfter, heard_, now)) return Action::reject;
  if (!persists(header.refusal, false, now)) return Action::reject;
  const bool without_reason = header.refusal == mismatch_without_reason(Side::master).view() ||
                              header.refusal == mismatch_without_reason(Side::slave).view();
  reject_reason_ = without_reason && !difference_.empty() ? difference_ : Sentence{header.refusal};
  if (!without_reason) {
    ended_ = true;
    return Action::end;
  }
  // The other side ends when it knows that this one was told.
  if (!mismatch_found_) mismatch_found_ = now;
  return refuse(header, mismatch_without_reason(options_.side), now);
}

Handshake::Action Handshake::on_current(const Header& header, Decoded decoded, const Endpoint& from,
                                        Duration now) noexcept {
  if (decoded != Decoded::ok) return Action::reject;
  heard_ = now;
  objection_.times = 0;
  if (header.peer_session == session_) {
    // A slave introduces itself until it has accepted us, and accepts only peers that introduce themselves.
    if (options_.side == Side::slave || !header.identity) returned_ = now;
    mismatch_found_.reset();
    return Action::deliver;
  }
  // A master that has left this session, due to a late packet of a slave that has ended, has closed this number and
  // cannot return to it. It is offered another.
  const bool left =
      options_.side == Side::slave && header.identity && !within(kSilent, returned_.value_or(paired_since_), now);
  return left ? answer(header, from, now) : Action::wait;
}

Handshake::Action Handshake::on_unknown(const Header& header, Decoded decoded, const Endpoint& from,
                                        Duration now) noexcept {
  const bool introduces_itself = header.identity.has_value() || decoded == Decoded::other_version;
  if (!introduces_itself || header.session == session_) return Action::reject;
  const bool elsewhere = peer_ && from != *peer_;
  if (header.session == peer_session_ && within(kSilent, heard_, now)) return Action::reject;
  // An active session is not replaced.
  const bool preempts = elsewhere ? within(kFollowedAfter, heard_, now) : coupled(now);
  const Sentence why = mismatch(options_, dof_, header, decoded);
  const std::uint64_t mine = options_.scene_digest, theirs = header.identity ? header.identity->scene_digest : mine;
  if (!why.empty() && (mine == kMeasurementDigest || theirs == kMeasurementDigest)) {
    if (preempts) return refuse(header, busy(), now);
    return refuse(header, mine == theirs ? why : no_measurement(options_.side, mine), now);
  }
  if (!why.empty()) {
    // Only the first peer, and one that restarts in its place, can be the wrong one.
    const Duration silent = options_.tells_reasons ? kSilent : kFollowedAfter;
    const bool may_end_us = pairings_ == 0 || (!elsewhere && !within(silent, heard_, now) && !preempts);
    if (may_end_us && !mismatch_found_ && (options_.tells_reasons || knows_us(header)) &&
        persists(why.view(), true, now)) {
      reject_reason_ = why;
      mismatch_found_ = now;
    }
    difference_ = why;
    if (options_.tells_reasons) return refuse(header, why, now);
    return refuse(header, preempts ? busy() : mismatch_without_reason(options_.side), now);
  }
  if (preempts) return on_unpaired_peer(header, now);
  // A late packet of a session that is over. Only a master may still run behind one, displaced by another master.
  if (closed_.has(header.session) && (options_.side == Side::master || within(kGoneAfter, heard_, now)))
    return Action::reject;
  return answer(header, from, now);
}

/// A valid peer without a session.
Handshake::Action Handshake::answer(const Header& header, const Endpoint& from, Duration now) noexcept {
  if (objection_.found_here) objection_.times = 0;
  // A replayed packet also introduces itself, but does not contain the current numbers.
  if (offers_.has(header.peer_session)) {
    if (!is_confirmed(header, from, now)) return Action::wait;
    objection_.times = 0;
    candidate_ = Candidate{from, header.session, header.peer_session, now};
    return Action::pair;
  }
  if (options_.side == Side::master) return Action::reject;
  if (header.peer_session != 0 && offered_at_ && now - *offered_at_ >= kOfferFor) {
    offers_.add(draw());
    offered_at_ = now;
  }
  if (!offered_at_) offered_at_ = now;
  greeting_ = Invitation{from, header.session};
  return Action::reply;
}

/// Another number from the address of a peer that has just been heard: it has restarted, or bits were flipped on the way. Flipped bits
/// do not give the same number twice.
bool Handshake::is_confirmed(const Header& header, const Endpoint& from, Duration now) noexcept {
  const bool may_be_damaged = pairings_ > 0 && header.session != peer_session_ && from == *peer_;
  if (options_.tells_reasons || !may_be_damaged || !within(kSilent, heard_, now)) return true;
  return std::exchange(unconfirmed_, header.session) == header.session;
}

/// A valid peer during a session with another.
Handshake::Action Handshake::on_unpaired_peer(const Header& header, Duration now) noexcept {
  auto* const known =
      std::find_if(waiting_.begin(), waiting_.end(), [&](const Waiting& w) { return w.session == header.session; });
  if (known == waiting_.end()) {
    waiting_[next_waiting_++ % waiting_.size()] = {header.session, now};
    return Action::reject;
  }
  if (now - known->since < kTakenAfter) return Action::reject;
  return refuse(header, busy(), now);
}

Sentence Handshake::busy() const noexcept {
  return Sentence{"the %s is busy: it has a session with another %s", to_string(options_.side),
                  to_string(options_.side == Side::slave ? Side::master : Side::slave)};
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
  greeting.header.session = offers_.newest();
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
  // Not a session number: a refused peer could use it.
  Header header;
  header.session = refusing_session_;
  header.peer_session = refused_session_;
  header.refusal = refusal_.view();
  return header;
}

// ---- state

bool Handshake::take_new_session() noexcept {
  if (!candidate_) return false;
  const Duration since = options_.side == Side::slave ? offered_at_.value_or(candidate_->since) : candidate_->since;
  if (pairings_ > 0 && candidate_->session != peer_session_) closed_.add(peer_session_);
  // A returning master has kept its number: our new number makes it restart its totals too.
  if (options_.side == Side::slave) {
    session_ = candidate_->offer;
    offers_ = {};
    offers_.add(draw());
    offered_at_.reset();
  }
  begin(*candidate_);
  session_since_ = since;
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
  waiting_ = {};
  mismatch_found_.reset();
}

std::string_view Handshake::reject_reason() const noexcept {
  return ended_ ? reject_reason_.view() : std::string_view{};
}
bool Handshake::coupled(Duration now) const noexcept {
  return within(kSilent, returned_, now);
}

}  // namespace twoport
