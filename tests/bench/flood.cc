// Sends datagrams to a port of 127.0.0.1, RATE a second for SECONDS, as whoever has no key would:
//
//   noise     random bytes, 1 to 1400
//   fields    1,014 bytes of fields that proto/report.proto does not have, after a correct beginning
//   hello     introductions of another version
//   client    ClientHellos of DTLS
//   record    records of DTLS of this epoch, with no key
//
// usage: flood PORT KIND [RATE [SECONDS]]; prints how many were sent a second.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string_view>
#include <thread>
#include <vector>

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes datagram(std::string_view kind, std::mt19937_64& random) {
  const auto noise = [&](std::size_t size, Bytes begin = {}) {
    while (begin.size() < size) begin.push_back(static_cast<std::uint8_t>(random()));
    return begin;
  };
  const Bytes version{0x0d, 2, 0, 0x50, 0x54};
  if (kind == "fields") {
    Bytes d = version;
    while (d.size() < 1014) d.insert(d.end(), {0xa2, 0x06, 1, 7});  // field 100, one byte
    return d;
  }
  if (kind == "hello") {
    Bytes d{0x0d, 99, 0, 0x50, 0x54, 0x11};
    return noise(14, d);
  }
  if (kind == "client") {
    Bytes d{22, 0xfe, 0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0, 87, 1, 0, 0, 75, 0, 0, 0, 0, 0, 0, 0, 75, 0xfe, 0xfd};
    d = noise(59, d);
    for (const int b : {0, 0, 0, 2, 0xcc, 0xac, 1, 0}) d.push_back(static_cast<std::uint8_t>(b));
    d.resize(100);
    return d;
  }
  if (kind == "record") {
    const std::size_t size = 300;
    return noise(13 + size, {23, 0xfe, 0xfd, 0, 1, 0, 1, 0, 0, 0, 0, size >> 8, size & 255});
  }
  return noise(1 + random() % 1400);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: flood PORT noise|fields|hello|client|record [RATE [SECONDS]]\n");
    return 2;
  }
  const double rate = argc > 3 ? std::atof(argv[3]) : 1e5, seconds = argc > 4 ? std::atof(argv[4]) : 5.0;
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  to.sin_port = htons(static_cast<std::uint16_t>(std::atoi(argv[1])));
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  std::mt19937_64 random{1};
  std::vector<Bytes> some;
  for (int i = 0; i < 1000; ++i) some.push_back(datagram(argv[2], random));

  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  std::uint64_t sent = 0;
  const auto passed = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  while (passed() < seconds) {
    for (const auto due = static_cast<std::uint64_t>(rate * passed()); sent < due; ++sent) {
      const Bytes& d = some[sent % some.size()];
      sendto(fd, d.data(), d.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    }
    std::this_thread::sleep_for(std::chrono::microseconds{200});
  }
  std::printf("%s: %.0f datagrams a second\n", argv[2], static_cast<double>(sent) / passed());
}
