#include "common/secure/record.h"

#include <algorithm>
#include <vector>

#include "tests/fuzz/input.h"

// Any bytes as records, between genuine ones that the input cuts, changes, repeats and reorders. Only genuine ones are
// opened, each once.
namespace twoport {
namespace {

void check(Input& in) {
  RecordKeys keys;
  keys.key.fill(1), keys.iv.fill(2);
  Sealer sealer{keys};
  Opener opener{keys};
  struct Genuine {
    std::vector<std::byte> record, plain;
    bool opened = false;
  };
  std::vector<Genuine> genuine;
  const auto open = [&](std::span<const std::byte> bytes) {
    std::span<const std::byte> plain;
    if (opener.open(bytes, plain) != Opened::ok) {
      require(plain.empty(), "what is not opened is empty");
      return;
    }
    const auto at = std::find_if(genuine.begin(), genuine.end(),
                                 [&](const Genuine& g) { return std::ranges::equal(g.record, bytes); });
    require(at != genuine.end(), "only genuine records are opened");
    require(!at->opened, "each once");
    require(std::ranges::equal(at->plain, plain), "with what was sealed");
    at->opened = true;
  };
  while (!in.empty()) {
    const std::uint8_t what = in.byte();
    if (what < 64 || genuine.empty()) {
      const auto plain = in.piece(what);
      const auto record = sealer.seal(plain);
      if (genuine.size() < 64) genuine.push_back({{record.begin(), record.end()}, {plain.begin(), plain.end()}});
    } else if (what < 128) {
      open(genuine[what % genuine.size()].record);
    } else if (what < 192) {
      std::vector<std::byte> changed = genuine[what % genuine.size()].record;
      changed[in.byte() % changed.size()] ^= static_cast<std::byte>(in.byte());
      changed.resize(changed.size() - std::min<std::size_t>(in.byte() % 4, changed.size()));
      open(changed);
    } else {
      open(in.piece(in.byte()));
    }
  }
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  twoport::check(in);
  return 0;
}
