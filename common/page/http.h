#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace twoport {

/// Result of parsing bytes that may continue.
enum class Parsed : std::uint8_t { whole, incomplete, invalid };

/// Longest request with its header that is read [B].
inline constexpr std::size_t kLargestRequest = 8192;

/// The parts of an HTTP/1.1 request that the page's server uses; a header that is absent is empty.
struct HttpRequest {
  std::string method, target;
  std::string host, origin, upgrade, connection, websocket_key, websocket_version;
};
struct HttpParse {
  Parsed status = Parsed::incomplete;
  std::size_t used = 0;  ///< bytes of the request, where it is whole
  HttpRequest request;
};
/// Reads one request without a body from the front of `bytes`. Invalid: a malformed line, a repeated Host or Origin, a
/// body, or more than kLargestRequest bytes without an end.
HttpParse parse_request(std::string_view bytes);

/// Is `host` an address that a name server cannot redirect: localhost or an IP address, with this port? Refusing any other
/// name prevents DNS rebinding.
bool is_literal_host(std::string_view host, std::uint16_t port);

/// Does the request come from a page that this server has delivered? Other web sites may open a WebSocket to localhost
/// too; the browser states their Origin.
bool is_own_origin(const HttpRequest& request);

/// Is it a WebSocket upgrade of version 13 (RFC 6455, 4.2.1)?
bool is_websocket_upgrade(const HttpRequest& request);

/// A complete response, after which the server closes the connection.
std::string http_response(std::string_view status, std::string_view content_type, std::string_view body,
                          const std::vector<std::pair<std::string, std::string>>& headers = {});

}  // namespace twoport
