#include "common/platform/udp.h"

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // no handler runs here, and the thread sanitizer does not support fences
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/udp.hpp>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <functional>
#include <utility>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/link/datagram.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
using asio::ip::udp;
using Error = boost::system::error_code;

constexpr std::size_t kBuffer = 1500;  // [B]
static_assert(kBuffer > kMaxDatagramBytes);
constexpr unsigned kBatch = 16;  // datagrams in one system call
// Most ticks find one datagram: two calls, of which the second finds none, cost less than one for a batch.
constexpr unsigned kSingles = 2;
constexpr Duration kListenEvery = std::chrono::milliseconds{1};  // where the peer has a socket of its own
constexpr Duration kSilent = std::chrono::seconds{1};  // of the peer; the route to it is looked at as often then
constexpr std::size_t kCallers = 64;
constexpr int kMostDrained = 4096, kMostErrors = 4;

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

Endpoint from_system(const sockaddr_storage& source) noexcept {
  udp::endpoint e;
  std::memcpy(e.data(), &source, e.capacity());
  return from_asio(e);
}

/// Control data of one datagram: the address of this machine that it came to, or is sent from.
struct Control {
  alignas(cmsghdr) std::array<std::byte, CMSG_SPACE(sizeof(in6_pktinfo))> bytes;
};

/// The address of this machine that a datagram came to; no address where that is none to answer from, or is not told.
Endpoint called_at(msghdr& message, std::uint16_t port) noexcept {
  Endpoint here;
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
    if (part->cmsg_level == IPPROTO_IP && part->cmsg_type == IP_PKTINFO) {
      in_pktinfo info;
      std::memcpy(&info, CMSG_DATA(part), sizeof info);
      std::memcpy(here.address.data(), &info.ipi_spec_dst, sizeof info.ipi_spec_dst);
    } else if (part->cmsg_level == IPPROTO_IPV6 && part->cmsg_type == IPV6_PKTINFO) {
      in6_pktinfo info;
      std::memcpy(&info, CMSG_DATA(part), sizeof info);
      if (IN6_IS_ADDR_MULTICAST(&info.ipi6_addr)) continue;
      std::memcpy(here.address.data(), &info.ipi6_addr, sizeof info.ipi6_addr);
      if (IN6_IS_ADDR_LINKLOCAL(&info.ipi6_addr)) here.scope = info.ipi6_ifindex;
      here.v6 = true;
    }
  }
  here.port = port;
  return here;
}

/// sendto() from the address `here` of this machine.
ssize_t send_from(int fd, const Endpoint& here, std::span<const std::byte> bytes, const udp::endpoint& to) noexcept {
  udp::endpoint there = to;
  iovec data{const_cast<std::byte*>(bytes.data()), bytes.size()};
  Control control{};
  msghdr message{};
  message.msg_name = there.data();
  message.msg_namelen = static_cast<socklen_t>(there.size());
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control.bytes.data();
  const auto put = [&](int level, int type, const auto& info) {
    message.msg_controllen = CMSG_SPACE(sizeof info);
    cmsghdr* const part = CMSG_FIRSTHDR(&message);
    part->cmsg_level = level;
    part->cmsg_type = type;
    part->cmsg_len = CMSG_LEN(sizeof info);
    std::memcpy(CMSG_DATA(part), &info, sizeof info);
  };
  if (here.v6) {
    in6_pktinfo info{};
    std::memcpy(&info.ipi6_addr, here.address.data(), sizeof info.ipi6_addr);
    info.ipi6_ifindex = here.scope;
    put(IPPROTO_IPV6, IPV6_PKTINFO, info);
  } else {
    in_pktinfo info{};
    std::memcpy(&info.ipi_spec_dst, here.address.data(), sizeof info.ipi_spec_dst);
    put(IPPROTO_IP, IP_PKTINFO, info);
  }
  return ::sendmsg(fd, &message, MSG_DONTWAIT);
}

bool connect_to(int fd, const udp::endpoint& to) noexcept {
  return ::connect(fd, to.data(), static_cast<socklen_t>(to.size())) == 0;
}
bool bind(int fd, const udp::endpoint& at) noexcept {
  return ::bind(fd, at.data(), static_cast<socklen_t>(at.size())) == 0;
}
bool set(int fd, int level, int option, int value) noexcept {
  return ::setsockopt(fd, level, option, &value, sizeof value) == 0;
}

/// Where a socket is bound.
std::optional<Endpoint> name_of(int fd) noexcept {
  sockaddr_storage name{};
  socklen_t size = sizeof name;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&name), &size) != 0) return {};
  return from_system(name);
}

/// Why the socket cannot be bound, and the remedy.
std::string bind_advice(const Error& error) {
  if (error == asio::error::address_in_use)
    return "the port is in use; stop the program that uses it or choose another port";
  if (error.value() == EADDRNOTAVAIL)
    return "no interface of this machine has that address; use one of `ip address`, or 0.0.0.0 for all";
  if (error == asio::error::access_denied) return "not permitted; choose a port >= 1024";
  return error.message();
}

/// Letters, digits, '-' and '.', with a letter among them: an address with a typing error is none.
bool may_be_host_name(std::string_view text) {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  const auto is_allowed = [&](char c) { return is_letter(c) || (c >= '0' && c <= '9') || c == '-' || c == '.'; };
  return std::any_of(text.begin(), text.end(), is_letter) && std::all_of(text.begin(), text.end(), is_allowed);
}

/// Why no program can be called there; empty: one can.
std::string_view why_nobody(const Endpoint& endpoint) {
  const asio::ip::address address = to_asio(endpoint).address();
  if (address.is_multicast() || address == asio::ip::address_v4::broadcast())
    return "is the address of a group; give that of one machine";
  if (endpoint.v6 && address.to_v6().is_link_local() && endpoint.scope == 0)
    return "is valid on one interface only, which is missing; give it too, as in [fe80::1%eth0]:45001";
  return {};
}

}  // namespace

std::string to_string(const Endpoint& endpoint) {
  const std::string address = to_asio(endpoint).address().to_string();
  return (endpoint.v6 ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port);
}

Endpoint parse_endpoint(std::string_view text, std::string_view option) {
  const auto refuse = [&] {
    return ConfigError(std::string{option} + ": '" + std::string{text} +
                       "' is not ADDR:PORT with an IP address or host name and a port from 0 to 65535; allowed is for "
                       "example 127.0.0.1:45001, [::1]:45001 or robot.local:45001");
  };
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) throw refuse();
  std::string_view address = text.substr(0, colon);
  const std::string_view port = text.substr(colon + 1);
  const bool bracketed = address.size() > 2 && address.front() == '[' && address.back() == ']';
  if (bracketed) address = address.substr(1, address.size() - 2);

  const std::optional<std::uint16_t> number = number_from<std::uint16_t>(port);
  if (!number) throw refuse();
  Error error;
  const asio::ip::address parsed = asio::ip::make_address(std::string{address}, error);
  if (!error && parsed.is_v6() == bracketed) return from_asio({parsed, *number});
  if (!error || bracketed || !may_be_host_name(address)) throw refuse();
  // RFC 6761, 6.3: this name is the loopback address, whether or not the machine's resolver knows it.
  if (address == "localhost") return from_asio({asio::ip::address_v4::loopback(), *number});
  asio::io_context context;
  const auto found = udp::resolver{context}.resolve(std::string{address}, "", error);
  if (error || found.empty())
    throw ConfigError(std::string{option} + ": '" + std::string{text} + "': the host name " + std::string{address} +
                      " cannot be looked up (" + error.message() + "); correct it or give an IP address");
  const auto v4 =
      std::find_if(found.begin(), found.end(), [](const auto& e) { return e.endpoint().address().is_v4(); });
  return from_asio({(v4 != found.end() ? v4 : found.begin())->endpoint().address(), *number});
}

Endpoint parse_allowed_endpoint(std::string_view text, std::string_view option, bool has_key, bool insecure) {
  const Endpoint endpoint = parse_endpoint(text, option);
  if (const std::string_view why = why_nobody(endpoint); !why.empty())
    throw ConfigError(std::string{option} + ": '" + std::string{text} + "' " + std::string{why});
  if (has_key || insecure || endpoint.loopback()) return endpoint;
  throw ConfigError(std::string{option} + " " + std::string{text} +
                    ": without a key only addresses of this machine are allowed (127.0.0.1, [::1]); make a key with "
                    "twoport-keygen FILE and start both programs with " +
                    (option.starts_with("--")
                         ? "--key FILE, or accept with --insecure that anyone who reaches the address "
                           "can take over"
                         : "key=FILE"));
}

StopInput::StopInput(std::uint16_t port) : fd_{::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)} {
  const udp::endpoint all{asio::ip::address_v4{{127, 255, 255, 255}}, port};
  if (set(fd_, SOL_SOCKET, SO_REUSEADDR, 1) && bind(fd_, all)) return;
  const Error error{errno, boost::system::system_category()};
  ::close(fd_);
  throw ConfigError("--stop-port " + std::to_string(port) + ": cannot listen on it: " + bind_advice(error));
}
StopInput::~StopInput() {
  ::close(fd_);
}
bool StopInput::is_asked() const noexcept {
  sockaddr_in from{};
  socklen_t size = sizeof from;
  if (::recvfrom(fd_, nullptr, 0, MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size) < 0) return false;
  ::sendto(fd_, "stop", 4, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&from), size);
  return true;
}

Endpoint any_port_toward(const Endpoint& peer) {
  Endpoint any;
  any.v6 = peer.v6;
  return any;
}

// Asio opens and binds the socket. Datagrams use system calls directly: a poll that finds one then needs one call
// instead of two, and costs 0.4 us less.
struct UdpSocket::Impl {
  asio::io_context context{1};
  udp::socket socket{context};
  int fd = -1, peer_fd = -1;
  Endpoint local;
  std::optional<Endpoint> peer;  ///< that peer_fd is connected with, or fd where there is no peer_fd
  std::uint64_t unsent = 0;
  int code_point = 0;

  std::array<std::array<std::byte, kBuffer>, kBatch> buffers{};
  std::array<sockaddr_storage, kBatch> sources{};
  std::array<iovec, kBatch> vectors{};
  std::array<mmsghdr, kBatch> headers{};
  std::array<Control, kBatch> controls{};
  unsigned filled = 0, taken = 0;
  unsigned in_a_row = 0;     ///< fetched since a fetch found nothing
  bool emptied = false;      ///< by the last batch
  bool of_peer = false;      ///< the datagrams fetched last
  Endpoint from_peer;        ///< whose they are then
  bool catching_up = false;  ///< in the first tick after pairing this one is read before the peer's
  bool listening = false;    ///< the peer's socket has been emptied, and this one is read
  std::optional<Duration> listened_at;

  /// Who has called this machine at which of its addresses, by a hash of the caller: it is answered from there.
  struct Caller {
    Endpoint from, at;
  };
  std::array<Caller, kCallers> callers{};
  bool on_all_addresses = false;  ///< bound to none, and not connected
  Duration heard_at{0}, routed_at{0};

  Duration span = Duration::max();
  std::optional<Duration> tick;
  std::chrono::steady_clock::time_point tick_began;

  Impl() = default;
  Impl(const Impl&) = delete;
  ~Impl() { close_peer(); }

  [[nodiscard]] bool mark(int of) const noexcept;
  bool over(Duration now) noexcept;
  void open(const Endpoint& wanted);
  void connect(const Endpoint& with) noexcept;
  void drain(int of) const noexcept;
  void listen_to_all_addresses(bool yes) noexcept;
  void follow_route(Duration now) noexcept;
  Caller& place_of(const Endpoint& caller) noexcept;
  bool open_peer(const Endpoint& with) noexcept;
  void close_peer() noexcept;
  [[nodiscard]] ssize_t send(std::span<const std::byte> bytes, const Endpoint& to) noexcept;
  bool fetch(Duration now) noexcept;
  bool fetch_from(int from) noexcept;
  int fetch_one(int from) noexcept;
  int fetch_batch(int from, unsigned most) noexcept;
};

UdpSocket::UdpSocket(const Endpoint& local) : impl_{std::make_unique<Impl>()} {
  impl_->open(local);
}
UdpSocket::UdpSocket(const Endpoint& local, const Endpoint& peer) : UdpSocket{local} {
  if (peer.port == 0 || peer.address == Endpoint{}.address)
    throw ConfigError("peer " + to_string(peer) + ": address and port must both be given, as in 127.0.0.1:45001");
  impl_->connect(peer);
}
UdpSocket::~UdpSocket() = default;
UdpSocket::UdpSocket(UdpSocket&&) noexcept = default;
UdpSocket& UdpSocket::operator=(UdpSocket&&) noexcept = default;

const Endpoint& UdpSocket::local() const noexcept {
  return impl_->local;
}
SocketCounts UdpSocket::counts() const noexcept {
  return {.unsent = impl_->unsent};
}

void UdpSocket::Impl::open(const Endpoint& wanted) {
  const udp::endpoint where = to_asio(wanted);
  Error error;
  socket.open(where.protocol(), error);
  if (!error) socket.bind(where, error);
  if (error) throw ConfigError("cannot listen on " + to_string(wanted) + ": " + bind_advice(error));
  local = from_asio(socket.local_endpoint());
  fd = socket.native_handle();
  for (std::size_t i = 0; i < kBatch; ++i) {
    vectors[i] = {buffers[i].data(), kBuffer};
    headers[i].msg_hdr.msg_iov = &vectors[i];
    headers[i].msg_hdr.msg_iovlen = 1;
    headers[i].msg_hdr.msg_name = &sources[i];
  }
  listen_to_all_addresses(local.address == Endpoint{}.address);
}

void UdpSocket::Impl::listen_to_all_addresses(bool yes) noexcept {
  const bool told = local.v6 ? set(fd, IPPROTO_IPV6, IPV6_RECVPKTINFO, yes) : set(fd, IPPROTO_IP, IP_PKTINFO, yes);
  on_all_addresses = yes && told;
}

UdpSocket::Impl::Caller& UdpSocket::Impl::place_of(const Endpoint& caller) noexcept {
  const std::string_view address{reinterpret_cast<const char*>(caller.address.data()), caller.address.size()};
  return callers[(std::hash<std::string_view>{}(address) ^ caller.port) % kCallers];
}

void UdpSocket::Impl::connect(const Endpoint& with) noexcept {
  Error error;
  socket.connect(to_asio(with), error);
  if (error) return;
  peer = with;
  of_peer = true;
  listen_to_all_addresses(false);
}

/// A connected socket keeps the address that it was connected from. When that is no longer the one from which the system reaches the
/// peer, since an interface has another address or another interface leads there, it is connected again, from a new port.
void UdpSocket::Impl::follow_route(Duration now) noexcept {
  routed_at = now;
  const udp::endpoint there = to_asio(*peer);
  const int trial = ::socket(there.data()->sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (trial < 0) return;
  const bool has_route = connect_to(trial, there);
  const std::optional<Endpoint> next = has_route ? name_of(trial) : std::nullopt, last = name_of(fd);
  ::close(trial);
  if (!next || !last || next->address == last->address) return;
  const sockaddr none{.sa_family = AF_UNSPEC, .sa_data = {}};
  if (::connect(fd, &none, sizeof none) != 0 || !connect_to(fd, there)) return;  // again in a second
  drain(fd);
  if (const std::optional<Endpoint> here = name_of(fd)) local.port = here->port;
}

void UdpSocket::paired(const Endpoint& peer, Duration) noexcept {
  Impl& s = *impl_;
  const bool connected = s.peer && s.peer_fd < 0;
  if (connected || s.peer == peer) return;
  s.close_peer();
  if (s.open_peer(peer)) {
    s.peer = peer;
    // What it has sent so far lies in the listener's queue.
    s.catching_up = true;
    s.listened_at.reset();
  } else {
    s.close_peer();
  }
}

/// Drops what came while anybody's datagrams could reach the socket: until it was connected.
void UdpSocket::Impl::drain(int of) const noexcept {
  for (int left = kMostDrained; left > 0 && ::recv(of, nullptr, 0, MSG_DONTWAIT) >= 0;) --left;
}

bool UdpSocket::Impl::open_peer(const Endpoint& of) noexcept {
  const Caller& caller = place_of(of);
  const udp::endpoint here = to_asio(on_all_addresses && caller.from == of ? caller.at : local);
  const udp::endpoint with = to_asio(of);
  peer_fd = ::socket(here.data()->sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (peer_fd < 0) return false;
  // Two sockets of one user may share a port while both allow it: for the moment of binding. SO_REUSEADDR would let in those of other users.
  const auto may_share = [&](int yes) {
    return set(fd, SOL_SOCKET, SO_REUSEPORT, yes) && set(peer_fd, SOL_SOCKET, SO_REUSEPORT, yes);
  };
  const bool open = may_share(1) && bind(peer_fd, here) && connect_to(peer_fd, with);
  may_share(0);
  if (open) drain(peer_fd);
  static_cast<void>(mark(peer_fd));  // fd has taken the same mark
  return open;
}

void UdpSocket::Impl::close_peer() noexcept {
  if (peer_fd < 0) return;
  ::close(peer_fd);
  peer_fd = -1;
  peer.reset();
}

ssize_t UdpSocket::Impl::send(std::span<const std::byte> bytes, const Endpoint& to) noexcept {
  if (peer == to) return ::send(peer_fd < 0 ? fd : peer_fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
  const udp::endpoint there = to_asio(to);
  if (const Caller& caller = place_of(to); on_all_addresses && caller.from == to)
    return send_from(fd, caller.at, bytes, there);
  return ::sendto(fd, bytes.data(), bytes.size(), MSG_DONTWAIT, there.data(), static_cast<socklen_t>(there.size()));
}

bool UdpSocket::send(std::span<const std::byte> bytes, const Endpoint& to, Duration) noexcept {
  bool sent = impl_->send(bytes, to) >= 0;
  // An ICMP error of an earlier datagram is reported here instead of this send.
  for (int left = kMostErrors; !sent && errno != EAGAIN && left > 0; --left) sent = impl_->send(bytes, to) >= 0;
  if (!sent) ++impl_->unsent;
  return sent;
}

int UdpSocket::Impl::fetch_one(int from) noexcept {
  if (on_all_addresses && from == fd) return fetch_batch(from, 1);
  const bool has_source = !of_peer;
  socklen_t size = sizeof(sockaddr_storage);
  const ssize_t length =
      ::recvfrom(from, buffers[0].data(), kBuffer, MSG_DONTWAIT,
                 has_source ? reinterpret_cast<sockaddr*>(sources.data()) : nullptr, has_source ? &size : nullptr);
  if (length < 0) return -1;
  headers[0].msg_len = static_cast<unsigned>(length);
  return 1;
}

int UdpSocket::Impl::fetch_batch(int from, unsigned most) noexcept {
  for (unsigned i = 0; i < most; ++i) {
    msghdr& header = headers[i].msg_hdr;
    header.msg_namelen = sizeof(sockaddr_storage);
    header.msg_control = on_all_addresses ? controls[i].bytes.data() : nullptr;
    header.msg_controllen = on_all_addresses ? controls[i].bytes.size() : 0;
  }
  return ::recvmmsg(from, headers.data(), most, MSG_DONTWAIT, nullptr);
}

/// False when nothing was there. A batch that was not full has emptied the queue: no further call.
bool UdpSocket::Impl::fetch_from(int from) noexcept {
  filled = taken = 0;
  if (!std::exchange(emptied, false)) {
    const auto fetch_some = [&] { return in_a_row < kSingles ? fetch_one(from) : fetch_batch(from, kBatch); };
    int n = fetch_some();
    // An ICMP error of a datagram that was sent comes before what was received.
    for (int left = kMostErrors; n < 0 && errno != EAGAIN && left > 0; --left) n = fetch_some();
    if (n > 0) {
      filled = static_cast<unsigned>(n);
      emptied = in_a_row >= kSingles && filled < kBatch;
      in_a_row += filled;
      return true;
    }
  }
  in_a_row = 0;
  return false;
}

bool UdpSocket::Impl::fetch(Duration now) noexcept {
  if (catching_up) {
    if (!listened_at) listened_at = now;
    of_peer = false;
    if (listened_at == now && fetch_from(fd)) return true;
    catching_up = emptied = false;
  }
  if (listening && listened_at != now)
    listening = emptied = false;  // the others' queue never ended: the peer comes first in every tick
  if (peer_fd >= 0 && !listening) {
    of_peer = true;
    from_peer = *peer;
    if (fetch_from(peer_fd)) return true;
    if (listened_at && now - *listened_at < kListenEvery) return false;
    listened_at = now;
    listening = true;
  }
  of_peer = peer && peer_fd < 0;
  if (of_peer) from_peer = *peer;
  if (fetch_from(fd)) {
    if (of_peer) heard_at = now;
    return true;
  }
  if (of_peer && std::min(now - heard_at, now - routed_at) >= kSilent) [[unlikely]]
    follow_route(now);
  listening = false;
  return false;
}

void UdpSocket::wait(Duration span) const noexcept {
  std::array<pollfd, 2> sockets{pollfd{impl_->fd, POLLIN, 0}, pollfd{impl_->peer_fd, POLLIN, 0}};
  const auto whole = std::chrono::duration_cast<std::chrono::seconds>(span);
  const timespec at_most{static_cast<std::time_t>(whole.count()), static_cast<long>((span - whole).count())};
  // One datagram may lie here already. A negative descriptor is skipped; a signal may end it early.
  if (impl_->taken == impl_->filled) ::ppoll(sockets.data(), sockets.size(), &at_most, nullptr);
}

/// The upper six bits of the octet that says the class of traffic.
bool UdpSocket::Impl::mark(int of) const noexcept {
  const int octet = code_point << 2;
  return local.v6 ? set(of, IPPROTO_IPV6, IPV6_TCLASS, octet) : set(of, IPPROTO_IP, IP_TOS, octet);
}

void UdpSocket::mark(int code_point) {
  impl_->code_point = code_point;
  if (!impl_->mark(impl_->fd) || (impl_->peer_fd >= 0 && !impl_->mark(impl_->peer_fd)))
    throw ConfigError("--dscp " + std::to_string(code_point) +
                      ": the system refuses it: " + Error{errno, boost::system::system_category()}.message());
}

void UdpSocket::limit(Duration span) noexcept {
  impl_->span = span;
}

/// Has the time of this tick been spent?
bool UdpSocket::Impl::over(Duration now) noexcept {
  if (span == Duration::max()) return false;
  const auto moment = std::chrono::steady_clock::now();
  if (tick != now) {
    tick = now;
    tick_began = moment;
    return false;
  }
  return moment - tick_began >= span;
}

std::optional<ReceivedDatagram> UdpSocket::receive(Duration now) noexcept {
  Impl& s = *impl_;
  if (s.taken == s.filled && (s.over(now) || !s.fetch(now))) return std::nullopt;
  const unsigned i = s.taken++;
  const std::span<const std::byte> bytes{s.buffers[i].data(), s.headers[i].msg_len};
  if (s.of_peer) return ReceivedDatagram{bytes, s.from_peer, now - Duration{1}};
  const Endpoint from = from_system(s.sources[i]);
  if (s.on_all_addresses) s.place_of(from) = {from, called_at(s.headers[i].msg_hdr, s.local.port)};
  return ReceivedDatagram{bytes, from, now - Duration{1}};
}

}  // namespace twoport
