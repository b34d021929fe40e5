#include "common/scene/servos.h"

#include <algorithm>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/blocks.h"
#include "common/scene/text.h"
#include "proto/servos.pb.h"

namespace twoport {

std::vector<ServoMount> load_servos(const std::string& path, int joints) {
  schema::ArmServos message;
  if (const auto error = parse_text(read_text(path), message))
    throw ConfigError{fmt::format("{}:{}: {}", path, error->place, error->sentence)};
  const Context context{.file = path};
  const Block of{context, message};
  of.check_fields();
  std::vector<ServoMount> servos;
  for (const auto& each : of.blocks(FIELD(servo))) {
    const bool taken = std::ranges::any_of(servos, [&](const ServoMount& other) { return other.id == each->id(); });
    if (taken) each.refuse(FIELD(id), "be another one: two servos of a bus with one id answer at once");
    servos.push_back({each->id(), each->reversed(), each->zero_rad(), GIVEN(each, torque_per_current_n_m_per_a)});
  }
  if (servos.size() != static_cast<std::size_t>(joints))
    of.fail(fmt::format("servo is given {} times; the arm has {} joints, in whose order they stand", servos.size(),
                        joints));
  return servos;
}

}  // namespace twoport
