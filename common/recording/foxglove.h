#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace twoport {

/// The text of the Foxglove WebSocket protocol. What a channel is in the message `advertise`.
std::string foxglove_channel(std::uint16_t id, std::string_view topic, std::string_view schema,
                             std::string_view descriptors);

/// What a client says.
struct FoxgloveCommand {
  struct Subscription {
    std::uint32_t id, channel;
  };
  std::vector<Subscription> subscribe;
  std::vector<std::uint32_t> unsubscribe;
  std::vector<std::string> complaints;  ///< of what is not understood
};
FoxgloveCommand parse_foxglove_command(std::string_view text);

}  // namespace twoport
