#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

namespace twoport::mcap {

/// Name and unit of each field, or whatever else a channel says of itself.
using Metadata = std::map<std::string, std::string>;

/// Where the messages of a recording go: a file, whoever listens, or both.
class Channels {
 public:
  virtual ~Channels() = default;
  /// A channel of Protobuf messages; the first is 1. `schema`: their full name; `descriptors`: a serialised FileDescriptorSet.
  virtual std::uint16_t add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                                    const Metadata& metadata) = 0;
  virtual void write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) = 0;
};

}  // namespace twoport::mcap
