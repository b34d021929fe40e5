#pragma once

#include <cstdint>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "common/mcap/reader.h"
#include "common/mcap/writer.h"

namespace twoport::test {

/// A recording in memory, message by message.
struct Messages {
  struct Each {
    std::string topic;
    std::uint64_t log_time_ns;
    std::string data;
  };
  std::map<std::string, mcap::Channel> channels;
  std::vector<Each> all;
  bool torn = false;
};

inline Messages read_messages(const std::string& path) {
  std::ifstream file{path, std::ios::binary};
  mcap::Reader reader{file, path};
  Messages m;
  for (mcap::Message each; reader.next(each);) {
    m.channels.emplace(each.channel->topic, *each.channel);
    m.all.push_back({each.channel->topic, each.log_time_ns, std::string{each.data}});
  }
  m.torn = reader.torn();
  return m;
}

inline void write_messages(const std::string& path, const Messages& m) {
  mcap::Writer file{path, "test"};
  std::map<std::string, std::uint16_t> ids;
  for (const auto& [topic, c] : m.channels) ids[topic] = file.add_channel(topic, c.schema, c.descriptors, c.metadata);
  for (const Messages::Each& each : m.all) file.write(ids.at(each.topic), each.log_time_ns, each.data);
  file.close();
}

inline std::string bytes_of(const std::string& path) {
  std::ifstream file{path, std::ios::binary};
  return std::string{std::istreambuf_iterator<char>{file}, {}};
}

}  // namespace twoport::test
