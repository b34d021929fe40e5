#include "common/page/websocket.h"

#include <array>
#include <bit>
#include <utility>

namespace twoport {
namespace {

std::array<std::uint8_t, 20> sha1(std::string text) {
  std::array<std::uint32_t, 5> h{0x67452301, 0xefcdab89, 0x98badcfe, 0x10325476, 0xc3d2e1f0};
  const std::uint64_t bits = 8 * text.size();
  text.push_back(static_cast<char>(0x80));
  while (text.size() % 64 != 56) text.push_back('\0');
  for (int i = 7; i >= 0; --i) text.push_back(static_cast<char>(bits >> (8 * i) & 0xff));
  for (std::size_t block = 0; block < text.size(); block += 64) {
    std::array<std::uint32_t, 80> w{};
    for (std::size_t i = 0; i < 64; ++i) w[i / 4] = w[i / 4] << 8 | static_cast<std::uint8_t>(text[block + i]);
    for (std::size_t i = 16; i < 80; ++i) w[i] = std::rotl(w[i - 3] ^ w[i - 8] ^ w[i - 14] ^ w[i - 16], 1);
    auto [a, b, c, d, e] = h;
    for (std::size_t i = 0; i < 80; ++i) {
      const std::uint32_t f = i < 20   ? (b & c) | (~b & d)
                              : i < 40 ? b ^ c ^ d
                              : i < 60 ? (b & c) | (b & d) | (c & d)
                                       : b ^ c ^ d;
      const std::uint32_t k = i < 20 ? 0x5a827999 : i < 40 ? 0x6ed9eba1 : i < 60 ? 0x8f1bbcdc : 0xca62c1d6;
      const std::uint32_t next = std::rotl(a, 5) + f + e + k + w[i];
      e = d, d = c, c = std::rotl(b, 30), b = a, a = next;
    }
    h[0] += a, h[1] += b, h[2] += c, h[3] += d, h[4] += e;
  }
  std::array<std::uint8_t, 20> digest{};
  for (std::size_t i = 0; i < 20; ++i) digest[i] = static_cast<std::uint8_t>(h[i / 4] >> (24 - 8 * (i % 4)) & 0xff);
  return digest;
}

template <std::size_t Size>
std::string base64(const std::array<std::uint8_t, Size>& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < Size; i += 3) {
    const auto at = [&](std::size_t j) { return j < Size ? std::uint32_t{bytes[j]} : 0u; };
    const std::uint32_t three = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
    for (std::size_t j = 0; j < 4; ++j) out += i + j <= Size ? kDigits[three >> (18 - 6 * j) & 63] : '=';
  }
  return out;
}

std::uint8_t byte(std::string_view bytes, std::size_t i) {
  return static_cast<std::uint8_t>(bytes[i]);
}

WebSocketFrame invalid(std::uint16_t code) {
  WebSocketFrame out;
  out.status = Parsed::invalid;
  out.close_code = code;
  return out;
}

}  // namespace

std::string websocket_accept(std::string_view key) {
  return base64(sha1(std::string{key} + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
}

WebSocketFrame parse_client_frame(std::string_view bytes) {
  WebSocketFrame out;
  if (bytes.size() < 2) return out;
  const std::uint8_t first = byte(bytes, 0), second = byte(bytes, 1), code = first & 0x0f;
  const bool control = code >= 8;
  if ((first & 0x70) != 0 || (code > 2 && code < 8) || code > 10 || (second & 0x80) == 0) return invalid(1002);
  std::uint64_t length = second & 0x7f;
  if (control && (length > 125 || (first & 0x80) == 0)) return invalid(1002);
  const std::size_t extra = length == 126 ? 2 : length == 127 ? 8 : 0;
  if (bytes.size() < 2 + extra) return out;
  if (extra > 0) {
    length = 0;
    for (std::size_t i = 0; i < extra; ++i) length = length << 8 | byte(bytes, 2 + i);
    if (length < (extra == 2 ? 126u : 65536u)) return invalid(1002);
  }
  if (length > kLargestMessage) return invalid(1009);
  const std::size_t mask = 2 + extra, data = mask + 4;
  if (bytes.size() < data + length) return out;
  out.status = Parsed::whole;
  out.used = data + length;
  out.final = (first & 0x80) != 0;
  out.opcode = static_cast<WebSocketOpcode>(code);
  out.payload.resize(length);
  for (std::size_t i = 0; i < length; ++i)
    out.payload[i] = static_cast<char>(byte(bytes, data + i) ^ byte(bytes, mask + i % 4));
  return out;
}

WebSocketReader::Event WebSocketReader::fail(std::uint16_t code) {
  last_ = {Event::Kind::error, {}, code};
  return last_;
}

WebSocketReader::Event WebSocketReader::next() {
  while (last_.kind == Event::Kind::nothing) {
    WebSocketFrame frame = parse_client_frame(pending_);
    if (frame.status == Parsed::incomplete) return {};
    if (frame.status == Parsed::invalid) return fail(frame.close_code);
    pending_.erase(0, frame.used);
    switch (frame.opcode) {
      case WebSocketOpcode::ping:
        return {Event::Kind::ping, std::move(frame.payload), 0};
      case WebSocketOpcode::pong:
        break;
      case WebSocketOpcode::close: {
        if (frame.payload.size() == 1) return fail(1002);
        const unsigned code =
            frame.payload.empty() ? 1005u : unsigned{byte(frame.payload, 0)} << 8 | byte(frame.payload, 1);
        last_ = {Event::Kind::close, {}, static_cast<std::uint16_t>(code)};
        return last_;
      }
      case WebSocketOpcode::binary:
        return fail(1003);
      case WebSocketOpcode::text:
      case WebSocketOpcode::continuation:
        if (in_message_ != (frame.opcode == WebSocketOpcode::continuation)) return fail(1002);
        message_ += frame.payload;
        if (message_.size() > kLargestMessage) return fail(1009);
        in_message_ = !frame.final;
        if (frame.final) return {Event::Kind::text, std::exchange(message_, {}), 0};
        break;
    }
  }
  return last_;
}

std::string websocket_frame(WebSocketOpcode opcode, std::string_view payload) {
  std::string out;
  out += static_cast<char>(0x80 | static_cast<unsigned>(opcode));
  const std::uint64_t n = payload.size();
  const int extra = n < 126 ? 0 : n < 65536 ? 2 : 8;
  out += static_cast<char>(extra == 0 ? n : extra == 2 ? 126 : 127);
  for (int i = extra - 1; i >= 0; --i) out += static_cast<char>(n >> (8 * i) & 0xff);
  out += payload;
  return out;
}

std::string websocket_close(std::uint16_t code) {
  return {static_cast<char>(code >> 8), static_cast<char>(code & 0xff)};
}

}  // namespace twoport
