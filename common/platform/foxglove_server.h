#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/mcap/writer.h"

namespace twoport {

/// May a page of this Origin listen? None is of a program; else localhost, an IP address, or the site of Foxglove or Lichtblick. Any other
/// site that somebody visits could read from a server on this machine too.
bool may_listen(std::string_view origin);

/// The channels of a recording, live, by the WebSocket protocol of Foxglove and Lichtblick (foxglove.websocket.v1, also offered
/// as foxglove.sdk.v1): serverInfo, advertise, subscribe, unsubscribe, message data. Nothing is taken from a client but what it wants to hear.
///
/// A thread of its own at ordinary priority sends every 20 ms what has been written since. Who subscribes gets the newest message
/// of the channel at once. Of a client that reads too slowly messages are left out, beyond 8 MB; at most eight listen.
class FoxgloveServer final : public mcap::Channels {
 public:
  /// `address`: value of --foxglove, ADDR:PORT; port 0: any free one. `name`: of the program. Throws ConfigError with the
  /// address and what to do.
  FoxgloveServer(const std::string& address, std::string_view name);
  ~FoxgloveServer() override;
  FoxgloveServer(const FoxgloveServer&) = delete;

  std::uint16_t add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                            const mcap::Metadata& metadata) override;
  /// Never waits for a client.
  void write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) override;

  /// "ws://127.0.0.1:8765", with the port that was taken.
  [[nodiscard]] const std::string& url() const;
  [[nodiscard]] bool is_local() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twoport
