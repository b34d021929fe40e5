#pragma once

#include <cstdint>

namespace twoport {

/// Datagrams that were dropped, by reason. Each is counted once.
struct Rejected {
  // Before anything was read.
  std::uint64_t foreign_address = 0;  ///< not of the peer's address
  std::uint64_t flood = 0;            ///< above the number of datagrams of unpaired addresses that a tick takes
  std::uint64_t too_long = 0;
  // With a key.
  std::uint64_t not_encrypted = 0;     ///< in plain text
  std::uint64_t not_authentic = 0;     ///< sealed with another key, or changed on the way
  std::uint64_t replayed = 0;          ///< received before
  std::uint64_t stale = 0;             ///< behind the window of sequence numbers
  std::uint64_t failed_handshake = 0;  ///< of nobody's handshake, or of one that has failed
  // Without.
  std::uint64_t encrypted = 0;  ///< of DTLS, and this side has no key
  // Of what was read.
  std::uint64_t malformed = 0;
  std::uint64_t other_session = 0;  ///< of a session that is over, or that never was
  std::uint64_t refused = 0;        ///< introductions that do not fit: another scene, rate, size or version; busy
  std::uint64_t sequence = 0;       ///< a sequence number that cannot be true

  /// f(name, count) for each reason.
  template <class F>
  void each(F&& f) const {
    f("foreign_address", foreign_address);
    f("flood", flood);
    f("too_long", too_long);
    f("not_encrypted", not_encrypted);
    f("not_authentic", not_authentic);
    f("replayed", replayed);
    f("stale", stale);
    f("failed_handshake", failed_handshake);
    f("encrypted", encrypted);
    f("malformed", malformed);
    f("other_session", other_session);
    f("refused", refused);
    f("sequence", sequence);
  }
  Rejected& operator+=(const Rejected& o) {
    foreign_address += o.foreign_address, flood += o.flood, too_long += o.too_long;
    not_encrypted += o.not_encrypted, not_authentic += o.not_authentic, replayed += o.replayed, stale += o.stale;
    failed_handshake += o.failed_handshake, encrypted += o.encrypted, malformed += o.malformed;
    other_session += o.other_session, refused += o.refused, sequence += o.sequence;
    return *this;
  }
  [[nodiscard]] std::uint64_t total() const {
    std::uint64_t sum = 0;
    each([&](const char*, std::uint64_t count) { sum += count; });
    return sum;
  }
};

}  // namespace twoport
