#include "common/wire/mismatch.h"

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>

namespace twoport {
namespace {

/// The first names of a list, with commas.
struct FieldList {
  static constexpr int kMost = 3;
  std::array<char, 200> text{};
  int count = 0;
};

/// Fields whose digests differ. None if the other side sends another number of them.
FieldList different_fields(const SessionOptions& options, const Identity& theirs) noexcept {
  FieldList list;
  const std::string_view mine = options.scene_fields;
  const std::size_t fields = options.scene_field_names.size();
  if (mine.size() != 2 * fields || theirs.scene_fields.size() != mine.size()) return list;
  int used = 0;
  for (std::size_t i = 0; i < fields; ++i) {
    if (mine.substr(2 * i, 2) == theirs.scene_fields.substr(2 * i, 2)) continue;
    if (++list.count > FieldList::kMost) continue;
    const std::string_view name = options.scene_field_names[i];
    const auto room = list.text.size() - static_cast<std::size_t>(used);
    used += std::snprintf(list.text.data() + used, room, "%s%.*s", used > 0 ? ", " : "",
                          static_cast<int>(std::min<std::size_t>(name.size(), 60)), name.data());
  }
  return list;
}

}  // namespace

Sentence mismatch(const SessionOptions& options, int dof, const Header& header, Decoded decoded) noexcept {
  const bool master = options.side == Side::master;
  const auto differ = [&](const char* format, auto mine, auto theirs) {
    return Sentence{format, master ? mine : theirs, master ? theirs : mine};
  };
  constexpr std::uint32_t kNumber = 0xffff;
  if (decoded == Decoded::other_version)
    return differ(
        "master and slave use different protocol versions: version %u at the master, %u at the slave; install the same "
        "release of twoport on both",
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
        "master and slave differ in the rate of the %s: it runs at %.9g Hz, the %s expects %.9g Hz; start both with "
        "the same scene",
        to_string(options.side), options.rate_hz, to_string(theirs.side), theirs.rate_hz};
  if (const FieldList differing = different_fields(options, theirs); differing.count > 0)
    return Sentence{
        "master and slave run different scenes: they differ in %s%s; start both with the same scene and the same --set",
        differing.text.data(), differing.count > FieldList::kMost ? " and more" : ""};
  if (theirs.scene_digest != options.scene_digest)
    return differ("master and slave run different scenes: digest %016" PRIx64 " at the master, %016" PRIx64
                  " at the slave; their control blocks differ: compare them, and every --set control",
                  options.scene_digest, theirs.scene_digest);
  return {};
}

Sentence no_measurement(Side side, std::uint64_t mine) noexcept {
  if (mine == kMeasurementDigest)
    return Sentence{"twoport-lab doctor runs at the %s's address, and has no scene; end it first", to_string(side)};
  return Sentence{"the %s has a scene, and answers no measurement", to_string(side)};
}

Sentence mismatch_without_reason(Side side) noexcept {
  return Sentence{
      "master and slave do not fit together: scene, --set, dof, rate, version or role; the %s names the difference",
      to_string(side)};
}

bool is_mismatch(std::string_view reason) noexcept {
  return reason.starts_with("master and slave ") || reason.starts_with("both programs are ");
}

}  // namespace twoport
