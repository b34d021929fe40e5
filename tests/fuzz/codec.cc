#include "common/wire/codec.h"

#include <algorithm>
#include <cmath>

#include "tests/fuzz/input.h"

// Any bytes as a datagram. What is accepted is finite and printable, and the same after it was written again.
namespace twoport {
namespace {

template <int N>
void check(std::span<const std::byte> bytes) {
  static Codec<N> first, second;
  static Envelope<N> read, again;
  const Decoded decoded = first.decode(bytes, read);
  if (decoded == Decoded::malformed) return;
  require(read.session != 0, "a session is not 0");
  require(read.refusal.size() <= kMaxRefusal, "a refusal is cut");
  require(std::all_of(read.refusal.begin(), read.refusal.end(), [](char c) { return c >= ' ' && c <= '~'; }),
          "a refusal is printable");
  if (decoded != Decoded::ok) return;
  if (read.refusal.empty())
    require(read.report.finite() && read.report.sequence > 0, "a report is finite and numbered");
  const std::span<const std::byte> written = first.encode(read);
  require(written.size() <= kMaxDatagram, "a datagram is not too long");
  require(second.decode(written, again) == Decoded::ok, "what was accepted can be written and read");
  require(again.session == read.session && again.refusal == read.refusal &&
              again.identity.has_value() == read.identity.has_value(),
          "the header is the same");
  if (read.refusal.empty())
    require(again.report.sequence == read.report.sequence && again.report.words.count == read.report.words.count &&
                again.report.sum() == read.report.sum(),
            "the report is the same");
  if (!read.refusal.empty()) return;
  const EnvironmentMessage &a = read.environment, &b = again.environment;
  require(a.finite() && a.count <= kAdjustableSurfaces, "the environment is finite");
  require(a.number == b.number && a.answer == b.answer && a.count == b.count && a.energy_j == b.energy_j &&
              a.link_energy_j == b.link_energy_j && a.joints == b.joints && a.joint_rad == b.joint_rad &&
              a.has_object == b.has_object && a.object_m == b.object_m && a.zero_number == b.zero_number &&
              a.zero_answer == b.zero_answer && a.sensor_drift_n == b.sensor_drift_n,
          "and the same");
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  const int dof = in.byte() % 3;
  const auto bytes = in.rest();
  if (dof == 0) twoport::check<1>(bytes);
  if (dof == 1) twoport::check<3>(bytes);
  if (dof == 2) twoport::check<6>(bytes);
  return 0;
}
