#include "common/platform/udp.h"

#define ASIO_STANDALONE
#define ASIO_NO_DEPRECATED
#include <algorithm>
#include <asio/buffer.hpp>
#include <asio/io_context.hpp>
#include <asio/ip/address.hpp>
#include <asio/ip/udp.hpp>
#include <charconv>

#include "common/base/check.h"

namespace twoport {
namespace {

using asio::ip::udp;

constexpr std::size_t kBuffer = 1500;  // [B], longer than any datagram of ours

udp::endpoint to_asio(const Endpoint& e) {
  if (e.v6) return {asio::ip::address_v6{e.address, e.scope}, e.port};
  asio::ip::address_v4::bytes_type four;
  std::copy_n(e.address.begin(), four.size(), four.begin());
  return {asio::ip::address_v4{four}, e.port};
}

Endpoint from_asio(const udp::endpoint& e) {
  Endpoint out;
  out.port = e.port();
  const asio::ip::address address = e.address();
  out.v6 = address.is_v6();
  if (out.v6) {
    const asio::ip::address_v6 six = address.to_v6();
    out.address = six.to_bytes();
    out.scope = static_cast<std::uint32_t>(six.scope_id());
  } else {
    const auto four = address.to_v4().to_bytes();
    std::copy(four.begin(), four.end(), out.address.begin());
  }
  return out;
}

/// Why the socket cannot be bound, and what to do about it.
std::string bind_advice(const asio::error_code& error) {
  if (error == asio::error::address_in_use)
    return "the port is in use, perhaps by a program that still runs; end that one or choose another port";
  if (error == std::errc::address_not_available)
    return "no interface of this machine has that address; use one that `ip address` lists, or 0.0.0.0 for all";
  if (error == asio::error::access_denied) return "not permitted; choose a port from 1024 on";
  return error.message();
}

}  // namespace

std::string to_string(const Endpoint& endpoint) {
  const std::string address = to_asio(endpoint).address().to_string();
  return (endpoint.v6 ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port);
}

Endpoint parse_endpoint(std::string_view text, std::string_view option) {
  const auto refuse = [&] {
    return ConfigError(std::string{option} + ": '" + std::string{text} +
                       "' is not ADDR:PORT with a numeric address and a port from 0 to 65535; allowed is for example "
                       "127.0.0.1:45001 or [::1]:45001");
  };
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) throw refuse();
  std::string_view address = text.substr(0, colon);
  const std::string_view port = text.substr(colon + 1);
  const bool bracketed = address.size() > 2 && address.front() == '[' && address.back() == ']';
  if (bracketed) address = address.substr(1, address.size() - 2);

  asio::error_code error;
  const asio::ip::address parsed = asio::ip::make_address(std::string{address}, error);
  std::uint16_t number = 0;
  const auto [end, problem] = std::from_chars(port.data(), port.data() + port.size(), number);
  if (error || parsed.is_v6() != bracketed || problem != std::errc{} || end != port.data() + port.size())
    throw refuse();
  return from_asio({parsed, number});
}

Endpoint any_port_toward(const Endpoint& peer) {
  Endpoint any;
  any.v6 = peer.v6;
  return any;
}

struct UdpSocket::Impl {
  asio::io_context context{1};
  udp::socket socket{context};
  Endpoint local;
  udp::endpoint source;
  std::uint64_t unsent = 0;
  std::array<std::byte, kBuffer> buffer{};
};

UdpSocket::UdpSocket(const Endpoint& local) : impl_{std::make_unique<Impl>()} {
  const udp::endpoint wanted = to_asio(local);
  asio::error_code error;
  impl_->socket.open(wanted.protocol(), error);
  if (!error) impl_->socket.non_blocking(true, error);
  if (!error) impl_->socket.bind(wanted, error);
  if (error) throw ConfigError("cannot listen on " + to_string(local) + ": " + bind_advice(error));
  impl_->local = from_asio(impl_->socket.local_endpoint());
}
UdpSocket::~UdpSocket() = default;
UdpSocket::UdpSocket(UdpSocket&&) noexcept = default;
UdpSocket& UdpSocket::operator=(UdpSocket&&) noexcept = default;

const Endpoint& UdpSocket::local() const noexcept { return impl_->local; }
std::uint64_t UdpSocket::unsent() const noexcept { return impl_->unsent; }

bool UdpSocket::send_to(std::span<const std::byte> bytes, const Endpoint& to) noexcept {
  asio::error_code error;
  impl_->socket.send_to(asio::buffer(bytes.data(), bytes.size()), to_asio(to), 0, error);
  // An ICMP error of an earlier datagram is reported here, and takes the place of this send: try once more.
  if (error == asio::error::connection_refused)
    impl_->socket.send_to(asio::buffer(bytes.data(), bytes.size()), to_asio(to), 0, error);
  if (error) ++impl_->unsent;
  return !error;
}

std::optional<ReceivedDatagram> UdpSocket::receive() noexcept {
  asio::error_code error;
  std::size_t size =
      impl_->socket.receive_from(asio::buffer(impl_->buffer.data(), impl_->buffer.size()), impl_->source, 0, error);
  if (error == asio::error::connection_refused)  // as in send_to
    size =
        impl_->socket.receive_from(asio::buffer(impl_->buffer.data(), impl_->buffer.size()), impl_->source, 0, error);
  if (error) return std::nullopt;
  return ReceivedDatagram{{impl_->buffer.data(), size}, from_asio(impl_->source)};
}

}  // namespace twoport
