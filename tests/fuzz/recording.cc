#include "common/recording/recording.h"

#include <memory>
#include <sstream>
#include <string>

#include "common/base/check.h"
#include "common/mcap/writer.h"
#include "tests/fuzz/input.h"

// Any bytes as a recording; with a first byte of 1 they are the messages of one, so that its parsers are reached without
// zstd and CRC in the way. Nothing but a ConfigError comes of it.
namespace twoport {
namespace {

void put(std::string& to, std::uint64_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) to.push_back(static_cast<char>(value >> (8 * i)));
}
void put(std::string& to, const std::string& text) {
  put(to, text.size(), 4);
  to += text;
}
void record(std::string& to, int op, const std::string& content) {
  to.push_back(static_cast<char>(op));
  put(to, content.size(), 8);
  to += content;
}

/// A file without chunks' compression whose messages are pieces of the input.
std::string file_of(Input& in) {
  std::string file{"\x89MCAP0\r\n", 8}, chunk;
  for (std::uint64_t id = 1; id <= 3; ++id) {
    const char* schema = id == 1 ? "twoport.schema.RecordingHeader" : "twoport.schema.RecordedTick";
    const char* topic = id == 1 ? "/master/header" : id == 2 ? "/master/tick" : "/slave/tick";
    std::string s, c;
    put(s, id, 2), put(s, schema), put(s, "protobuf"), put(s, "");
    put(c, id, 2), put(c, id, 2), put(c, topic), put(c, "protobuf"), put(c, "");
    record(file, 3, s), record(file, 4, c);
  }
  while (!in.empty()) {
    std::string message;
    put(message, in.byte() % 4U, 2);
    message.append(20, '\0');
    const auto piece = in.piece(in.number(2));
    message.append(reinterpret_cast<const char*>(piece.data()), piece.size());
    record(chunk, 5, message);
  }
  std::string body;
  put(body, 0, 8), put(body, 0, 8), put(body, chunk.size(), 8), put(body, 0, 4), put(body, ""),
      put(body, chunk.size(), 8);
  record(file, 6, body + chunk);
  return file;
}

void check(Input& in) {
  const bool messages = in.byte() == 1;
  const auto rest = messages ? std::span<const std::byte>{} : in.rest();
  const std::string bytes =
      messages ? file_of(in) : std::string{reinterpret_cast<const char*>(rest.data()), rest.size()};
  try {
    RecordingReader reader{std::make_unique<std::istringstream>(bytes), "input"};
    RecordedTick<1> one;
    RecordedTick<3> three;
    RecordedTick<6> six;
    for (RecordingReader::Kind kind; (kind = reader.next()) != RecordingReader::Kind::end;) {
      if (kind != RecordingReader::Kind::tick) continue;
      const int fit = static_cast<int>(reader.tick(one)) + static_cast<int>(reader.tick(three)) +
                      static_cast<int>(reader.tick(six));
      require(fit <= 1, "a tick has one size");
    }
  } catch (const ConfigError&) {
  }
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::Input in{data, size};
  twoport::check(in);
  return 0;
}
