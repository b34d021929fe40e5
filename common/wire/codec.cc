#include "common/wire/codec.h"

#include <google/protobuf/io/coded_stream.h>

#include <algorithm>
#include <array>
#include <boost/endian/conversion.hpp>
#include <cmath>
#include <string>
#include <tuple>

#include "common/base/built_for.h"
#include "proto/report.pb.h"

namespace twoport {
namespace {

template <int N>
constexpr int kSampleSize = (N == 6 ? 7 : N) + 5 * N + 1;
constexpr int kGripperSize = kSampleSize<1> + 1;  // and the energy
/// Doubles of a packet's report; a gripper moved by joints is one of them.
template <int N>
constexpr std::size_t kReportSize = kSampleSize<N> + kMostWords<N> +
                                    (N == kJointPort ? 0 : kGripperSize + kMostWords<1>);

// Moments are durations since a loop began: 73 years, and no sum of two of them overflows.
constexpr std::int64_t kLatest = std::int64_t{1} << 61;
constexpr double kUnitTolerance = 1e-6;  // of |q|^2

/// The port, in the order of the schema.
template <class Report>
auto fields(Report& r) {
  return std::tie(r.x, r.v, r.f, r.f_coupling, r.f_environment, r.position_error, r.energy_net_j);
}
template <int N>
double* write(double* to, const PortReport<N>& r) {
  std::apply([&](const auto&... field) { ((to = payload::put(to, field)), ...); }, fields(r));
  return to;
}
template <int N>
const double* read(const double* from, PortReport<N>& r) {
  std::apply([&](auto&... field) { ((from = payload::take(from, field)), ...); }, fields(r));
  return from;
}

/// False if there are more than `most`.
bool read(const google::protobuf::RepeatedField<double>& from, std::uint32_t totals, std::size_t most, Words& words) {
  if (from.size() > static_cast<int>(most)) return false;
  words.count = static_cast<std::uint8_t>(from.size());
  words.totals = totals;
  std::copy_n(from.data(), words.count, words.at.begin());
  return true;
}

/// Do the bytes begin like a datagram of any protocol version: field 1, fixed32, "TP" in its high half? Keeps other
/// data away from the parser.
bool ours(std::span<const std::byte> bytes) {
  return bytes.size() > 5 && bytes.size() <= kMaxDatagram && bytes[0] == std::byte{0x0d} &&
         bytes[3] == std::byte{(kProtocolVersion >> 16) & 0xff} && bytes[4] == std::byte{kProtocolVersion >> 24};
}

/// Of such a datagram: the field comes first.
std::uint32_t version(std::span<const std::byte> bytes) {
  return boost::endian::load_little_u32(reinterpret_cast<const unsigned char*>(bytes.data()) + 1);
}

template <int N>
bool read_report(const schema::Datagram& message, Report<N>& r) {
  if (message.sample_size() != kSampleSize<N> || !is_mode(message.mode())) return false;
  if (message.sequence() == 0 || message.sent_ns() < 0 || message.sent_ns() > kLatest || message.echo_ns() < -1 ||
      message.echo_ns() > kLatest)
    return false;
  r.sequence = message.sequence();
  r.sent_ns = message.sent_ns();
  r.echo_ns = message.echo_ns();
  r.mode = static_cast<Mode>(message.mode());
  r.energy_in_j = message.energy_in_j();
  r.epoch = message.epoch();
  read(message.sample().data(), r);
  if (!read(message.words(), message.running_totals(), kMostWords<N>, r.words) || !r.finite()) return false;
  if constexpr (N == 6) return std::abs(r.x.attitude().squaredNorm() - 1.0) < kUnitTolerance;
  return true;
}

void write_gripper(schema::Datagram& message, const Report<1>& r) {
  message.set_gripper_mode(static_cast<std::uint32_t>(r.mode));
  *write(message.mutable_gripper()->AddNAlreadyReserved(kGripperSize), r) = r.energy_in_j;
  if (r.words.count == 0) return;
  std::copy_n(r.words.at.begin(), r.words.count, message.mutable_gripper_words()->AddNAlreadyReserved(r.words.count));
  message.set_gripper_running_totals(r.words.totals);
}

/// Of the gripper, after the report: what both share is already there.
template <int N>
bool read_gripper(const schema::Datagram& message, const Report<N>& shared, Report<1>& r) {
  if (message.gripper_size() != kGripperSize || !is_mode(message.gripper_mode())) return false;
  r.sequence = shared.sequence;
  r.sent_ns = shared.sent_ns;
  r.echo_ns = shared.echo_ns;
  r.epoch = shared.epoch;
  r.mode = static_cast<Mode>(message.gripper_mode());
  r.energy_in_j = *read(message.gripper().data(), r);
  return read(message.gripper_words(), message.gripper_running_totals(), kMostWords<1>, r.words) && r.finite();
}

/// An object is there only where the ports are joints.
template <int N>
constexpr int kObjectSize = N == kJointPort ? 3 : 0;

template <int N>
void write_environment(schema::Datagram& message, const EnvironmentMessage& e) {
  message.set_environment_number(e.number);
  message.set_environment_answer(static_cast<std::uint32_t>(e.answer));
  message.set_environment_energy_j(e.energy_j);
  message.set_link_energy_j(e.link_energy_j);
  message.set_zero_number(e.zero_number);
  message.set_zero_answer(static_cast<std::uint32_t>(e.zero_answer));
  message.set_sensor_drift_n(e.sensor_drift_n);
  if (e.joints > 0)
    std::copy_n(e.joint_rad.begin(), e.joints, message.mutable_joint_rad()->AddNAlreadyReserved(e.joints));
  if constexpr (N == kJointPort)
    if (e.has_object)
      std::copy_n(e.object_m.begin(), kObjectSize<N>, message.mutable_object_m()->AddNAlreadyReserved(kObjectSize<N>));
  if (e.count == 0) return;
  double* to = message.mutable_environment()->AddNAlreadyReserved(2 * e.count);
  for (std::size_t i = 0; i < e.count; ++i) *to++ = e.surface[i].stiffness_n_per_m, *to++ = e.surface[i].friction;
}

/// False if it is invalid: something is said of the environment without a number, or numbers that are none.
template <int N>
bool read_environment(const schema::Datagram& message, EnvironmentMessage& e) {
  e = {};
  const int size = message.environment_size();
  if (message.environment_number() == 0)
    return size == 0 && message.environment_answer() == 0 && message.environment_energy_j() == 0.0 &&
           message.link_energy_j() == 0.0 && message.joint_rad_size() == 0 && message.object_m_size() == 0 &&
           message.zero_number() == 0 && message.zero_answer() == 0 && message.sensor_drift_n() == 0.0;
  if (size % 2 != 0 || message.joint_rad_size() > static_cast<int>(kMostJoints) ||
      (message.object_m_size() != 0 && message.object_m_size() != kObjectSize<N>) ||
      size > static_cast<int>(2 * kAdjustableSurfaces) || message.environment_answer() >= kEnvironmentAnswers ||
      message.zero_answer() >= kZeroAnswers)
    return false;
  e.number = message.environment_number();
  e.answer = static_cast<EnvironmentAnswer>(message.environment_answer());
  e.energy_j = message.environment_energy_j();
  e.count = static_cast<std::uint8_t>(size / 2);
  for (int i = 0; i < e.count; ++i)
    e.surface[static_cast<std::size_t>(i)] = {message.environment(2 * i), message.environment(2 * i + 1)};
  e.link_energy_j = message.link_energy_j();
  e.zero_number = message.zero_number();
  e.zero_answer = static_cast<ZeroAnswer>(message.zero_answer());
  e.sensor_drift_n = message.sensor_drift_n();
  e.joints = static_cast<std::uint8_t>(message.joint_rad_size());
  std::copy_n(message.joint_rad().data(), e.joints, e.joint_rad.begin());
  e.has_object = message.object_m_size() > 0;
  std::copy_n(message.object_m().data(), message.object_m_size(), e.object_m.begin());
  return e.finite();
}

/// False if the identity is invalid. Without one (dof 0) `identity` is unchanged.
bool read_identity(const schema::Datagram& message, std::optional<Identity>& identity) {
  if (message.dof() == 0) return true;
  if (message.dof() > kJointPort || !(message.rate_hz() > 0.0) || !std::isfinite(message.rate_hz())) return false;
  if (message.side() != static_cast<std::uint32_t>(Side::master) &&
      message.side() != static_cast<std::uint32_t>(Side::slave))
    return false;
  identity = Identity{static_cast<int>(message.dof()), message.rate_hz(), message.scene_digest(),
                      static_cast<Side>(message.side()), message.scene_fields()};
  return true;
}

/// The refusal may be printed on a terminal: no control characters.
std::string_view read_refusal(schema::Datagram& message) {
  if (message.refusal().empty()) return {};
  std::string& text = *message.mutable_refusal();
  text.resize(std::min(text.size(), kMaxRefusal));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

}  // namespace

template <int N>
struct Codec<N>::Impl {
  schema::Datagram outgoing, incoming;
  std::array<std::byte, kMaxDatagram> buffer{};

  // Allocates once for the longest message; clearing a message keeps the memory.
  Impl() {
    for (schema::Datagram* message : {&outgoing, &incoming}) {
      for (auto* list : {message->mutable_sample(), message->mutable_words(), message->mutable_gripper(),
                         message->mutable_gripper_words(), message->mutable_environment(), message->mutable_joint_rad(),
                         message->mutable_object_m()})
        list->Reserve(static_cast<int>(kMaxDatagram / sizeof(double)));
      message->mutable_refusal()->reserve(kMaxDatagram);
      message->mutable_scene_fields()->reserve(kMaxDatagram);
    }
  }
};

template <int N>
Codec<N>::Codec() : impl_{std::make_unique<Impl>()} {}
template <int N>
Codec<N>::~Codec() = default;
template <int N>
Codec<N>::Codec(Codec&&) noexcept = default;
template <int N>
Codec<N>& Codec<N>::operator=(Codec&&) noexcept = default;

template <int N>
std::span<const std::byte> Codec<N>::encode(const Envelope<N>& envelope) noexcept {
  schema::Datagram& message = impl_->outgoing;
  message.Clear();
  message.set_protocol_version(envelope.version);
  message.set_session_id(envelope.session);
  message.set_peer_session_id(envelope.peer_session);
  if (!envelope.refusal.empty()) {
    const std::string_view text = envelope.refusal.substr(0, kMaxRefusal);
    message.mutable_refusal()->assign(text.data(), text.size());
  } else {
    const Report<N>& r = envelope.report;
    message.set_sequence(r.sequence);
    message.set_sent_ns(r.sent_ns);
    message.set_echo_ns(r.echo_ns);
    message.set_mode(static_cast<std::uint32_t>(r.mode));
    message.set_energy_in_j(r.energy_in_j);
    message.set_epoch(r.epoch);
    write(message.mutable_sample()->AddNAlreadyReserved(kSampleSize<N>), r);
    if (r.words.count > 0) {
      std::copy_n(r.words.at.begin(), r.words.count, message.mutable_words()->AddNAlreadyReserved(r.words.count));
      message.set_running_totals(r.words.totals);
    }
    if (envelope.has_gripper) [[unlikely]]
      write_gripper(message, envelope.gripper);
    if (envelope.environment.number > 0) [[unlikely]]
      write_environment<N>(message, envelope.environment);
  }
  if (envelope.identity) {
    message.set_dof(static_cast<std::uint32_t>(envelope.identity->dof));
    message.set_rate_hz(envelope.identity->rate_hz);
    message.set_scene_digest(envelope.identity->scene_digest);
    message.set_side(static_cast<std::uint32_t>(envelope.identity->side));
    const std::string_view fields = envelope.identity->scene_fields.substr(0, kMaxSceneFields);
    message.mutable_scene_fields()->assign(fields.data(), fields.size());
  }
  const std::size_t size = message.ByteSizeLong();
  // Tags, lengths and single numbers of all fields take less than 20 doubles.
  static_assert(kMaxDatagram >=
                8 * (kReportSize<N> + 2 * kAdjustableSurfaces + kMostJoints + kObjectSize<N> + 20) + kMaxSceneFields);
  message.SerializeWithCachedSizesToArray(reinterpret_cast<std::uint8_t*>(impl_->buffer.data()));
  return {impl_->buffer.data(), size};
}

template <int N>
Decoded Codec<N>::decode(std::span<const std::byte> bytes, Envelope<N>& envelope) noexcept {
  if (!ours(bytes)) return Decoded::malformed;
  schema::Datagram& message = impl_->incoming;
  if (version(bytes) != kProtocolVersion) {
    if (!read_stable_fields(bytes, envelope) || envelope.session == 0) return Decoded::malformed;
    message.mutable_refusal()->assign(envelope.refusal.data(), envelope.refusal.size());
    envelope.refusal = read_refusal(message);
    return Decoded::other_version;
  }
  if (!only_known_fields(bytes) || !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())) ||
      message.protocol_version() != kProtocolVersion || message.session_id() == 0)
    return Decoded::malformed;
  envelope.version = kProtocolVersion;
  envelope.session = message.session_id();
  envelope.peer_session = message.peer_session_id();
  envelope.refusal = read_refusal(message);
  envelope.identity.reset();
  if (!read_identity(message, envelope.identity)) return Decoded::malformed;
  if (envelope.identity && envelope.identity->dof != N) return Decoded::other_dof;
  if (!envelope.refusal.empty()) return Decoded::ok;
  if (!read_report(message, envelope.report)) return Decoded::malformed;
  envelope.has_gripper = message.gripper_size() > 0;
  if (envelope.has_gripper && !read_gripper(message, envelope.report, envelope.gripper)) [[unlikely]]
    return Decoded::malformed;
  if (!read_environment<N>(message, envelope.environment)) return Decoded::malformed;
  return Decoded::ok;
}

TWOPORT_COMPILE(Codec);

namespace {

constexpr std::uint8_t kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5, kNone = 0xff;  // wire types

/// By field number, as in proto/report.proto.
constexpr std::array<std::uint8_t, 33> kTypes = {
    kNone,    kFixed32, kFixed64, kFixed64, kFixed64, kFixed64, kFixed64, kVarint, kBytes,  kFixed64, kVarint,
    kFixed64, kFixed64, kBytes,   kVarint,  kBytes,   kFixed32, kVarint,  kBytes,  kBytes,  kBytes,   kFixed32,
    kVarint,  kVarint,  kBytes,   kFixed64, kVarint,  kFixed64, kBytes,   kBytes,  kVarint, kVarint,  kFixed64};
constexpr std::uint32_t kVersion = 1, kSession = 2, kPeerSession = 3, kRefusal = 13;

}  // namespace

bool Fields::next() noexcept {
  if (rest_.empty() || broken_) return false;
  google::protobuf::io::CodedInputStream in{reinterpret_cast<const std::uint8_t*>(rest_.data()),
                                            static_cast<int>(rest_.size())};
  const auto here = [&] { return static_cast<std::size_t>(in.CurrentPosition()); };
  std::uint64_t tag = 0, size = 0;
  std::uint32_t four = 0;
  broken_ = !in.ReadVarint64(&tag) || tag >> 32 != 0 || tag >> 3 == 0;
  if (broken_) return false;
  number = static_cast<std::uint32_t>(tag >> 3);
  wire_type = static_cast<std::uint32_t>(tag & 7);
  switch (wire_type) {
    case kVarint:
      broken_ = !in.ReadVarint64(&value);
      break;
    case kFixed64:
      broken_ = !in.ReadLittleEndian64(&value);
      break;
    case kFixed32:
      broken_ = !in.ReadLittleEndian32(&four);
      value = four;
      break;
    case kBytes:
      broken_ = !in.ReadVarint64(&size) || size > rest_.size() - here();
      if (broken_) break;
      payload = rest_.subspan(here(), size);
      in.Skip(static_cast<int>(size));
      break;
    default:
      broken_ = true;
  }
  rest_ = rest_.subspan(here());
  return !broken_;
}

bool only_known_fields(std::span<const std::byte> datagram) noexcept {
  Fields field{datagram};
  while (field.next())
    if (field.number >= kTypes.size() || field.wire_type != kTypes[field.number]) return false;
  return field.complete();
}

bool read_stable_fields(std::span<const std::byte> datagram, Header& header) noexcept {
  header = {};
  Fields field{datagram};
  while (field.next()) {
    const bool of_its_type = field.number < kTypes.size() && field.wire_type == kTypes[field.number];
    if (!of_its_type) continue;
    if (field.number == kVersion) header.version = static_cast<std::uint32_t>(field.value);
    if (field.number == kSession) header.session = field.value;
    if (field.number == kPeerSession) header.peer_session = field.value;
    if (field.number == kRefusal)
      header.refusal = {reinterpret_cast<const char*>(field.payload.data()), field.payload.size()};
  }
  return field.complete();
}

}  // namespace twoport
