#pragma once

#include <cstdint>
#include <istream>
#include <map>
#include <string>
#include <string_view>

#include "common/mcap/writer.h"

namespace twoport::mcap {

struct Channel {
  std::string topic, schema;
  std::string descriptors;  ///< a serialised FileDescriptorSet
  Metadata metadata;
  bool operator==(const Channel&) const = default;
};

struct Message {
  const Channel* channel;
  std::uint64_t log_time_ns;
  std::string_view data;  ///< until the next call
};

/// Reads the messages of an MCAP file in their order, from beginning to end: chunks with zstd or without compression. The
/// index is not used, so a file without its end is read as far as it goes. What is kept besides the present record and chunk, schemas
/// and channels, is at most kMostDefinitions.
class Reader {
 public:
  static constexpr std::size_t kMostDefinitions = std::size_t{64} << 20;  // [bytes]

  /// Throws ConfigError, here and in next(), with `name` and the reason for what is no MCAP file or is damaged.
  Reader(std::istream& in, std::string name);

  /// The next message; false at the end.
  bool next(Message& message);

  /// Has the file no end? Its program was killed while it wrote.
  [[nodiscard]] bool torn() const { return torn_; }

 private:
  bool next_chunk();
  bool end_torn() { return !(torn_ = ended_ = true); }
  void define(std::uint8_t op, std::string_view content);
  void keep(std::size_t bytes);
  [[noreturn]] void fail(const std::string& why) const;

  std::istream* in_;
  std::string name_;
  std::string record_, chunk_;  ///< as read, and as decompressed
  std::string_view rest_;       ///< of the chunk
  std::map<std::uint16_t, std::pair<std::string, std::string>> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::size_t kept_ = 0;  ///< of definitions, replaced ones included [bytes]
  bool torn_ = false, ended_ = false;
};

}  // namespace twoport::mcap
