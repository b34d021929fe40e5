#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/page/http.h"

namespace twoport {

// The server's half of RFC 6455 as functions of bytes.

/// Sec-WebSocket-Accept for the client's key: base64(SHA-1(key + GUID)), RFC 6455, 4.2.2. Nothing secret depends on SHA-1
/// here; it shows that the peer speaks the protocol.
std::string websocket_accept(std::string_view key);

enum class WebSocketOpcode : std::uint8_t { continuation = 0, text = 1, binary = 2, close = 8, ping = 9, pong = 10 };

/// Largest payload of a frame, and of a message, that a client may send [B].
inline constexpr std::size_t kLargestMessage = 1024;

/// One frame of a client.
struct WebSocketFrame {
  Parsed status = Parsed::incomplete;
  std::uint16_t close_code = 0;  ///< of an invalid frame: 1002 protocol error, 1009 too big
  std::size_t used = 0;          ///< bytes of a whole frame
  bool final = false;
  WebSocketOpcode opcode = WebSocketOpcode::continuation;
  std::string payload;  ///< unmasked
};
/// Reads one frame from the front of `bytes`. Invalid: reserved bits or opcodes, no mask, a length that is not in its
/// shortest form, a control frame that is fragmented or longer than 125 bytes, more than kLargestMessage bytes.
WebSocketFrame parse_client_frame(std::string_view bytes);

/// Assembles the messages of a client from bytes in pieces of any size.
class WebSocketReader {
 public:
  struct Event {
    enum class Kind : std::uint8_t { nothing, text, ping, close, error } kind = Kind::nothing;
    std::string payload;           ///< of a text or ping
    std::uint16_t close_code = 0;  ///< of a close (1005: none was given) or an error
  };
  void add(std::string_view bytes) { pending_ += bytes; }
  /// The next event; `nothing` when more bytes are needed. Binary messages are refused with 1003. After a close or an
  /// error every further event is that one.
  Event next();

 private:
  Event fail(std::uint16_t code);

  std::string pending_, message_;
  bool in_message_ = false;
  Event last_;
};

/// A frame from the server: final, not masked.
std::string websocket_frame(WebSocketOpcode opcode, std::string_view payload);
/// The payload of a close frame.
std::string websocket_close(std::uint16_t code);

}  // namespace twoport
