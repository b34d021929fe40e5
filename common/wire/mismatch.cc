#include "common/wire/mismatch.h"

#include <cinttypes>

namespace twoport {

Sentence mismatch(const SessionOptions& options, int dof, const Header& header, Decoded decoded) noexcept {
  const bool master = options.side == Side::master;
  const auto differ = [&](const char* format, auto mine, auto theirs) {
    return Sentence{format, master ? mine : theirs, master ? theirs : mine};
  };
  constexpr std::uint32_t kNumber = 0xffff;
  if (decoded == Decoded::other_version)
    return differ(
        "master and slave use different protocol versions: version %u at the master, %u at the slave; install the "
        "same release of twoport on both",
        kProtocolVersion & kNumber, header.version & kNumber);
  const Identity& theirs = *header.identity;
  if (theirs.side == options.side)
    return Sentence{"both programs are a %s: a twoport-master needs the address of a twoport-slave",
                    to_string(theirs.side)};
  if (theirs.dof != dof)
    return differ("master and slave differ in dof: %d at the master, %d at the slave; start both with the same scene",
                  dof, theirs.dof);
  if (theirs.rate_hz != options.rate_hz)
    return Sentence{
        "master and slave differ in the rate of the %s: it runs at %.9g Hz, the %s expects %.9g Hz; start "
        "both with the same scene",
        to_string(options.side), options.rate_hz, to_string(theirs.side), theirs.rate_hz};
  if (theirs.scene_digest != options.scene_digest)
    return differ("master and slave run different scenes: digest %016" PRIx64 " at the master, %016" PRIx64
                  " at the slave; their control blocks differ: compare them, and every --set control",
                  options.scene_digest, theirs.scene_digest);
  return {};
}

bool is_mismatch(std::string_view reason) noexcept {
  return reason.starts_with("master and slave ") || reason.starts_with("both programs are ");
}

}  // namespace twoport
