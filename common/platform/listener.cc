#include "common/platform/listener.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>

#include "common/base/check.h"
#include "common/platform/udp.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
using Error = boost::system::error_code;

/// The address under which other machines reach this one, by its route to the rest of the network. No packet is sent.
asio::ip::address own_address(const asio::ip::address& bound) {
  if (!bound.is_unspecified()) return bound;
  asio::io_context context;
  asio::ip::udp::socket socket{context};
  Error error;
  socket.connect({asio::ip::make_address(bound.is_v6() ? "2001:db8::1" : "192.0.2.1"), 9}, error);
  if (!error) return socket.local_endpoint().address();
  return bound.is_v6() ? asio::ip::address{asio::ip::address_v6::loopback()}
                       : asio::ip::address{asio::ip::address_v4::loopback()};
}

}  // namespace

asio::ip::tcp::acceptor listen_at(asio::io_context& context, const std::string& address, const char* flag) {
  const Endpoint at = parse_endpoint(address, flag);
  asio::ip::address ip;
  if (at.v6) {
    ip = asio::ip::address_v6{at.address, at.scope};
  } else {
    asio::ip::address_v4::bytes_type four;
    std::copy_n(at.address.begin(), four.size(), four.begin());
    ip = asio::ip::address_v4{four};
  }
  const asio::ip::tcp::endpoint endpoint{ip, at.port};
  asio::ip::tcp::acceptor acceptor{context};
  Error error;
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(asio::socket_base::reuse_address{true}, error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    throw ConfigError{
        fmt::format("{} {}: {}; choose another port, or port 0 for any free one", flag, address, error.message())};
  return acceptor;
}

std::string reached_at(const asio::ip::tcp::acceptor& acceptor) {
  const asio::ip::tcp::endpoint bound = acceptor.local_endpoint();
  const asio::ip::address ip = own_address(bound.address());
  return fmt::format(fmt::runtime(ip.is_v6() ? "[{}]:{}" : "{}:{}"), ip.to_string(), bound.port());
}

}  // namespace twoport
