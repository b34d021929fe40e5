#include "common/mcap/reader.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <utility>

#include "common/base/check.h"
#include "common/mcap/bytes.h"

namespace twoport::mcap {
namespace {

constexpr std::uint64_t kLargestRecord = std::uint64_t{256} << 20;  // [bytes]
constexpr std::size_t kStep = std::size_t{1} << 20;                 // memory is taken for what is there [bytes]

/// Appends `size` bytes of the stream; false when there are fewer.
bool read(std::istream& in, std::uint64_t size, std::string& into) {
  into.clear();
  while (into.size() < size) {
    const std::size_t had = into.size(), piece = static_cast<std::size_t>(std::min<std::uint64_t>(size - had, kStep));
    into.resize(had + piece);
    in.read(into.data() + had, static_cast<std::streamsize>(piece));
    if (static_cast<std::size_t>(in.gcount()) != piece) return false;
  }
  return true;
}

}  // namespace

Reader::Reader(std::istream& in, std::string name) : in_{&in}, name_{std::move(name)} {
  if (!read(in, kMagic.size(), record_) || record_ != kMagic) fail("it is no MCAP file");
}

bool Reader::next(Message& message) {
  while (true) {
    if (rest_.empty()) {
      if (ended_ || !next_chunk()) return false;
      continue;
    }
    InputBytes in{rest_};
    const auto op = in.number<std::uint8_t>();
    const std::string_view content = in.raw(in.number<std::uint64_t>());
    if (!in.ok) fail("a record of a chunk is cut off");
    rest_.remove_prefix(1 + 8 + content.size());
    if (op != static_cast<std::uint8_t>(Op::message)) {
      define(op, content);
      continue;
    }
    InputBytes fields{content};
    const auto channel = channels_.find(fields.number<std::uint16_t>());
    fields.number<std::uint32_t>();
    message.log_time_ns = fields.number<std::uint64_t>();
    fields.number<std::uint64_t>();
    if (!fields.ok) fail("a message is cut off");
    if (channel == channels_.end()) fail("a message is of no channel");
    message.channel = &channel->second;
    message.data = content.substr(2 + 4 + 8 + 8);
    return true;
  }
}

/// Reads records up to the next chunk; false at the end of the messages.
bool Reader::next_chunk() {
  while (true) {
    if (!read(*in_, 9, record_)) return end_torn();
    InputBytes head{record_};
    const auto op = head.number<std::uint8_t>();
    const auto size = head.number<std::uint64_t>();
    if (op == static_cast<std::uint8_t>(Op::data_end)) {
      ended_ = true;
      return false;
    }
    if (size > kLargestRecord) fail("a record is longer than " + std::to_string(kLargestRecord) + " bytes");
    if (!read(*in_, size, record_)) return end_torn();
    if (op != static_cast<std::uint8_t>(Op::chunk)) {
      define(op, record_);
      continue;
    }
    InputBytes in{record_};
    in.number<std::uint64_t>(), in.number<std::uint64_t>();
    const auto full = in.number<std::uint64_t>();
    const auto expected = in.number<std::uint32_t>();
    const std::string_view compression = in.string();
    const std::string_view body = in.raw(in.number<std::uint64_t>());
    if (!in.ok || full > kLargestRecord) fail("a chunk is damaged");
    if (compression.empty()) {
      chunk_ = body;
    } else if (compression == "zstd") {
      // The frame says how long it is before any memory is taken.
      if (ZSTD_getFrameContentSize(body.data(), body.size()) != full) fail("a chunk is damaged");
      chunk_.resize(static_cast<std::size_t>(full));
      if (ZSTD_decompress(chunk_.data(), chunk_.size(), body.data(), body.size()) != full) fail("a chunk is damaged");
    } else {
      fail("a chunk is compressed by \"" + std::string{compression} + "\"; zstd and none are known");
    }
    const auto crc = ::crc32_z(0, reinterpret_cast<const unsigned char*>(chunk_.data()), chunk_.size());
    if (expected != 0 && crc != expected) fail("a chunk is damaged: its CRC differs");
    rest_ = chunk_;
    return true;
  }
}

void Reader::define(std::uint8_t op, std::string_view content) {
  InputBytes in{content};
  if (op == static_cast<std::uint8_t>(Op::schema)) {
    const auto id = in.number<std::uint16_t>();
    const std::string_view name = in.string();
    in.string();
    const std::string_view data = in.string();
    if (!in.ok) fail("a schema is damaged");
    const auto found = schemas_.find(id);
    if (found != schemas_.end() && found->second.first == name && found->second.second == data) return;  // repeated
    keep(content.size());
    schemas_.insert_or_assign(id, std::pair{std::string{name}, std::string{data}});
  } else if (op == static_cast<std::uint8_t>(Op::channel)) {
    const auto id = in.number<std::uint16_t>(), schema = in.number<std::uint16_t>();
    if (content.size() > kMostDefinitions) fail("a channel is damaged");
    Channel channel;
    channel.topic = in.string();
    in.string();
    InputBytes entries{in.string()};
    while (!entries.empty() && entries.ok) {
      const std::string_view key = entries.string();
      channel.metadata.emplace(key, entries.string());
    }
    if (!in.ok || !entries.ok) fail("a channel is damaged");
    if (const auto found = schemas_.find(schema); found != schemas_.end())
      std::tie(channel.schema, channel.descriptors) = found->second;
    const auto found = channels_.find(id);
    if (found != channels_.end() && found->second == channel) return;
    keep(content.size() + channel.schema.size() + channel.descriptors.size());
    channels_.insert_or_assign(id, std::move(channel));
  }
}

/// Before memory is taken for a definition.
void Reader::keep(std::size_t bytes) {
  kept_ += bytes;
  if (kept_ > kMostDefinitions)
    fail("its schemas and channels are longer than " + std::to_string(kMostDefinitions) + " bytes");
}

void Reader::fail(const std::string& why) const {
  throw ConfigError{name_ + ": " + why};
}

}  // namespace twoport::mcap
