#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>

// Protocol 2.0 of Dynamixel servos (emanual.robotis.com/docs/en/dxl/protocol2) and the control table of their X series.
namespace twoport::dynamixel {

using Bytes = std::span<const std::uint8_t>;

enum class Instruction : std::uint8_t {
  ping = 1,
  read = 2,
  write = 3,
  status = 0x55,
  sync_read = 0x82,
  sync_write = 0x83
};
inline constexpr std::uint8_t kEveryServo = 0xFE;
inline constexpr std::uint8_t kAlert = 0x80;  ///< in the error of a status: kHardwareError says more
inline constexpr std::size_t kLongestPacket = 128;
inline constexpr std::array<std::uint8_t, 4> kHeader{0xFF, 0xFF, 0xFD, 0x00};
inline constexpr std::size_t kBefore = 7;  ///< header, id, length

/// Polynomial x^16 + x^15 + x^2 + 1, highest bit first, from 0.
constexpr std::uint16_t crc16(Bytes bytes) noexcept {
  unsigned crc = 0;
  for (const std::uint8_t byte : bytes) {
    crc ^= static_cast<unsigned>(byte) << 8;
    for (int bit = 0; bit < 8; ++bit) crc = ((crc & 0x8000u) != 0 ? crc << 1 ^ 0x8005u : crc << 1) & 0xFFFFu;
  }
  return static_cast<std::uint16_t>(crc);
}
/// Do the bytes before `end` look like a header, so that one more byte is put there?
constexpr bool is_stuffed(const std::uint8_t* end) noexcept {
  return end[-3] == kHeader[0] && end[-2] == kHeader[1] && end[-1] == kHeader[2];
}

/// What a packet says. The first parameter of a status is its error.
struct Message {
  std::uint8_t id = 0;
  Instruction instruction = Instruction::status;
  std::array<std::uint8_t, kLongestPacket> parameters{};
  std::size_t size = 0;  ///< of them

  /// A number, lowest byte first.
  Message& add(std::uint32_t value, std::size_t bytes) noexcept {
    for (std::size_t i = 0; i < bytes && size < parameters.size(); ++i)
      parameters[size++] = static_cast<std::uint8_t>(value >> 8 * i);
    return *this;
  }
  [[nodiscard]] std::uint32_t at(std::size_t offset, std::size_t bytes) const noexcept {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < bytes && offset + i < size; ++i)
      value |= static_cast<std::uint32_t>(parameters[offset + i]) << 8 * i;
    return value;
  }
};

/// The bytes of a message, which must fit.
class Packet {
 public:
  explicit constexpr Packet(const Message& m) noexcept {
    for (const std::uint8_t byte : kHeader) put(byte);
    put(m.id);
    size_ = kBefore;
    put(static_cast<std::uint8_t>(m.instruction));
    for (std::size_t i = 0; i < m.size && size_ + 4 <= bytes_.size(); ++i) {
      put(m.parameters[i]);
      if (is_stuffed(&bytes_[size_ - 1] + 1)) put(kHeader[2]);
    }
    const std::size_t length = size_ + 2 - kBefore;
    bytes_[5] = static_cast<std::uint8_t>(length);
    bytes_[6] = static_cast<std::uint8_t>(length >> 8);
    const std::uint16_t crc = crc16(bytes());
    put(static_cast<std::uint8_t>(crc));
    put(static_cast<std::uint8_t>(crc >> 8));
  }
  [[nodiscard]] constexpr Bytes bytes() const noexcept { return {bytes_.data(), size_}; }

 private:
  constexpr void put(std::uint8_t byte) noexcept { bytes_[size_++] = byte; }

  std::array<std::uint8_t, kLongestPacket> bytes_{};
  std::size_t size_ = 0;
};

/// Messages from bytes that come in any pieces, some of them damaged.
class PacketReader {
 public:
  void clear() noexcept { size_ = 0; }
  void add(Bytes bytes) noexcept {
    if (bytes.size() > heard_.size()) bytes = bytes.last(heard_.size());
    if (const std::size_t room = heard_.size() - size_; bytes.size() > room) drop(bytes.size() - room);
    std::copy(bytes.begin(), bytes.end(), &heard_[0] + size_);
    size_ += bytes.size();
  }
  /// The next whole message with the right CRC, whatever stands before it.
  std::optional<Message> next() noexcept {
    for (;; drop(1)) {
      const auto* const begin = heard_.data();
      drop(static_cast<std::size_t>(std::find(begin, begin + size_, kHeader[0]) - begin));
      if (size_ < kBefore) return {};
      if (!std::equal(kHeader.begin(), kHeader.end(), heard_.begin())) continue;
      const std::size_t whole = kBefore + (heard_[5] | static_cast<std::size_t>(heard_[6]) << 8);
      if (whole < kBefore + 3 || whole > kLongestPacket) continue;
      if (size_ < whole) return {};
      if (crc16({heard_.data(), whole - 2}) != (heard_[whole - 2] | heard_[whole - 1] << 8)) continue;
      Message m{.id = heard_[4], .instruction = static_cast<Instruction>(heard_[kBefore])};
      for (std::size_t i = kBefore + 1; i < whole - 2; ++i) {
        m.add(heard_[i], 1);
        if (is_stuffed(&heard_[i] + 1)) ++i;
      }
      drop(whole);
      return m;
    }
  }

 private:
  void drop(std::size_t n) noexcept {
    std::copy(&heard_[0] + n, &heard_[0] + size_, &heard_[0]);
    size_ -= n;
  }

  std::array<std::uint8_t, 8 * kLongestPacket> heard_{};
  std::size_t size_ = 0;
};

/// A value of the control table.
struct Item {
  std::uint16_t address;
  std::uint8_t bytes;
};
inline constexpr Item kReturnDelay{9, 1}, kOperatingMode{11, 1}, kTemperatureLimit{31, 1}, kCurrentLimit{38, 2},
    kTorqueEnable{64, 1}, kStatusReturn{68, 1}, kHardwareError{70, 1}, kBusWatchdog{98, 1}, kGoalCurrent{102, 2},
    kPosition{132, 4},
    // From the present current on: with velocity and position; and with what follows up to the temperature.
    kMotion{126, 10}, kMotionAndHeat{126, 21};
inline constexpr std::size_t kPositionInMotion = 6, kTemperatureInMotion = 20;
inline constexpr std::uint32_t kCurrentMode = 0;
inline constexpr int kCountsPerTurn = 4096, kWatchdogStepMs = 20;

struct Model {
  std::uint32_t number;
  const char* name;
  double current_unit_a, torque_per_current_n_m_per_a;  ///< stall torque over stall current
};
inline constexpr std::array<Model, 10> kModels{{{1020, "XM430-W350", 2.69e-3, 1.78},
                                                {1030, "XM430-W210", 2.69e-3, 1.30},
                                                {1120, "XM540-W270", 2.69e-3, 2.41},
                                                {1130, "XM540-W150", 2.69e-3, 1.66},
                                                {1190, "XL330-M077", 1e-3, 0.146},
                                                {1200, "XL330-M288", 1e-3, 0.354},
                                                {1210, "XC330-T181", 1e-3, 0.95},
                                                {1220, "XC330-T288", 1e-3, 1.15},
                                                {1230, "XC330-M181", 1e-3, 0.333},
                                                {1240, "XC330-M288", 1e-3, 0.517}}};
/// Null: none with current control that is known.
inline const Model* model_of(std::uint32_t number) noexcept {
  const auto* at = std::find_if(kModels.begin(), kModels.end(), [&](const Model& m) { return m.number == number; });
  return at == kModels.end() ? nullptr : at;
}
/// Of kHardwareError.
inline std::string hardware_error_words(std::uint32_t status) {
  std::string words;
  for (const auto& [bit, name] :
       {std::pair{0, "input voltage"}, {2, "overheating"}, {3, "encoder"}, {4, "electrical shock"}, {5, "overload"}})
    if ((status >> bit & 1u) != 0) words += (words.empty() ? "" : " and ") + std::string{name};
  return words.empty() ? "an error of its hardware" : words;
}

}  // namespace twoport::dynamixel
