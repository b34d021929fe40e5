#include "common/recording/recording.h"

#include <fmt/format.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/text_format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <iterator>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/recording/hand.h"
#include "proto/recording.pb.h"

namespace twoport {
namespace {

using Numbers = google::protobuf::RepeatedField<double>;

// A message that says nothing takes 2 bytes in another and up to 300 in memory.
constexpr std::size_t kLongestHeader = std::size_t{4} << 20, kLongestTick = std::size_t{1} << 20;  // [bytes]

// ---- descriptors, units

std::string descriptors(const google::protobuf::Descriptor& message) {
  google::protobuf::FileDescriptorSet set;
  message.file()->CopyTo(set.add_file());  // which imports none
  return set.SerializeAsString();
}

mcap::Metadata units(int dof) {
  mcap::Metadata all;
  const auto add = [&](std::initializer_list<const char*> names, std::string_view linear, std::string_view angular) {
    std::string unit{linear};
    if (dof == 6 && !angular.empty()) unit.append(", ").append(angular);
    for (const char* name : names) all.emplace(name, unit);
  };
  add({"x", "x_d"}, "m", "unit quaternion w x y z");
  add({"v", "v_d"}, "m/s", "rad/s");
  add({"applied", "f_environment", "command", "wanted", "f", "f_coupling"}, "N", "N m");
  add({"position_error"}, "m", "rad");
  add({"dissipated_j", "undissipated_j", "energy_in_j", "energy_net_j"}, "J", "");
  add({"now_ns", "sent_ns", "echo_ns", "session_since_ns"}, "ns", "");
  add({"dt_s", "ended_s", "t_s"}, "s", "");
  return all;
}

// ---- values to messages

constexpr std::size_t kMostNumbers = std::max(7, kJointPort);  // of a quantity

template <class Quantity>
void put(const Quantity& from, Numbers& to) {
  std::array<double, kMostNumbers> all;
  to.Clear();
  to.Add(all.data(), payload::put(all.data(), from));
}

template <int N>
void put(const Report<N>& from, schema::RecordedReport& to) {
  to.set_sequence(from.sequence);
  to.set_sent_ns(from.sent_ns);
  to.set_echo_ns(from.echo_ns);
  put(from.x, *to.mutable_x());
  put(from.v, *to.mutable_v());
  put(from.f, *to.mutable_f());
  put(from.f_coupling, *to.mutable_f_coupling());
  put(from.f_environment, *to.mutable_f_environment());
  put(from.position_error, *to.mutable_position_error());
  to.set_energy_in_j(from.energy_in_j);
  to.set_energy_net_j(from.energy_net_j);
  to.set_mode(static_cast<std::uint32_t>(from.mode));
  to.set_epoch(from.epoch);
  to.mutable_words()->Clear();
  to.mutable_words()->Add(from.words.at.begin(), from.words.at.begin() + from.words.count);
  to.set_running_totals(from.words.totals);
}

// ---- messages to values; false where the lengths do not fit

template <class Quantity>
bool take(const Numbers& from, Quantity& to) {
  std::array<double, kMostNumbers> all;
  if (from.size() != payload::put(all.data(), to) - all.data()) return false;
  payload::take(from.data(), to);
  return true;
}
bool take(std::uint32_t from, Mode& to) {
  if (!is_mode(from)) return false;
  to = static_cast<Mode>(from);
  return true;
}

template <int N>
bool take(const schema::RecordedReport& from, Report<N>& to) {
  if (from.words_size() > static_cast<int>(Words::kMost)) return false;
  to.sequence = from.sequence();
  to.sent_ns = from.sent_ns();
  to.echo_ns = from.echo_ns();
  to.energy_in_j = from.energy_in_j();
  to.energy_net_j = from.energy_net_j();
  to.epoch = from.epoch();
  std::copy(from.words().begin(), from.words().end(), to.words.at.begin());
  to.words.count = static_cast<std::uint8_t>(from.words_size());
  to.words.totals = from.running_totals();
  return take(from.x(), to.x) && take(from.v(), to.v) && take(from.f(), to.f) &&
         take(from.f_coupling(), to.f_coupling) && take(from.f_environment(), to.f_environment) &&
         take(from.position_error(), to.position_error) && take(from.mode(), to.mode);
}

/// In the order of HardwareProperties.limits.
constexpr double PortLimits::*kRecordedLimits[] = {
    &PortLimits::force_n,          &PortLimits::torque_n_m,    &PortLimits::force_rate_n_per_s,
    &PortLimits::power_w,          &PortLimits::speed_m_per_s, &PortLimits::angular_speed_rad_per_s,
    &PortLimits::set_point_step_m, &PortLimits::workspace_m};
/// Behind them, for each joint of a port of joints.
constexpr JointLimits::Axes JointLimits::*kRecordedOfJoint[] = {&JointLimits::effort, &JointLimits::speed,
                                                                &JointLimits::lower, &JointLimits::upper};

/// What a node makes of its reading and the reports.
template <int N>
void put_results(const TickRecord<N>& tick, bool of_master, schema::RecordedTick& message) {
  message.set_epoch(tick.epoch);
  put(tick.command, *message.mutable_command());
  if (of_master) {
    put(tick.wanted, *message.mutable_wanted());
    message.set_undissipated_j(tick.undissipated_j);
  } else {
    put(tick.x_d, *message.mutable_x_d());
    put(tick.v_d, *message.mutable_v_d());
  }
  message.set_dissipated_j(tick.dissipated_j);
  message.set_mode(static_cast<std::uint32_t>(tick.mode));
  if (tick.sends) put(tick.sent, *message.mutable_sent());
}

// ---- differences

namespace pb = google::protobuf;

/// `path`: of the block, with a dot. Two numbers have the same text where they have the same bits.
std::string first_difference(const pb::Message& recorded, const pb::Message& replayed, const std::string& path) {
  const pb::Reflection& r = *recorded.GetReflection();
  for (int i = 0; i < recorded.GetDescriptor()->field_count(); ++i) {
    const pb::FieldDescriptor& field = *recorded.GetDescriptor()->field(i);
    const std::string name = path + field.name();
    const bool list = field.is_repeated(), block = field.message_type() != nullptr;
    const auto size = [&](const pb::Message& of) {
      return list ? r.FieldSize(of, &field) : !block || r.HasField(of, &field) ? 1 : 0;
    };
    if (size(recorded) != size(replayed))
      return fmt::format("{} is there {} times, recorded {}", name, size(replayed), size(recorded));
    for (int k = 0; k < size(recorded); ++k) {
      if (block) {
        const auto& before = list ? r.GetRepeatedMessage(recorded, &field, k) : r.GetMessage(recorded, &field);
        const auto& now = list ? r.GetRepeatedMessage(replayed, &field, k) : r.GetMessage(replayed, &field);
        if (std::string found = first_difference(before, now, name + "."); !found.empty()) return found;
        continue;
      }
      std::string before, now;
      pb::TextFormat::PrintFieldValueToString(recorded, &field, list ? k : -1, &before);
      pb::TextFormat::PrintFieldValueToString(replayed, &field, list ? k : -1, &now);
      const auto with_bits = [&](const pb::Message& of, const std::string& value) {
        if (field.cpp_type() != pb::FieldDescriptor::CPPTYPE_DOUBLE) return value;
        const double number = list ? r.GetRepeatedDouble(of, &field, k) : r.GetDouble(of, &field);
        return fmt::format("{} ({:016x})", value, std::bit_cast<std::uint64_t>(number));
      };
      if (now != before)
        return fmt::format("{}{} is {}, recorded {}", name, list ? fmt::format("[{}]", k) : "",
                           with_bits(replayed, now), with_bits(recorded, before));
    }
  }
  return {};
}

}  // namespace

RecordingSide::RecordingSide(mcap::Channels& to, const RecordingHeader& header)
    : to_{&to}, start_unix_ns_{header.start_unix_ns}, master_{header.of_master()} {
  const std::string prefix = "/" + header.side;
  const std::string schemas = descriptors(*schema::RecordedTick::descriptor());
  const std::uint16_t of_header = to.add_channel(prefix + "/header", schema::RecordingHeader::descriptor()->full_name(),
                                                 schemas, {{"side", header.side}});
  mcap::Metadata metadata = units(header.dof);
  metadata["side"] = header.side;
  channel_ = to.add_channel(prefix + "/tick", schema::RecordedTick::descriptor()->full_name(), schemas, metadata);

  schema::RecordingHeader message;
  message.set_program(header.program);
  message.set_side(header.side);
  message.set_dof(static_cast<std::uint32_t>(header.dof));
  message.set_rate_hz(header.rate_hz);
  message.set_scene_file(header.scene_file);
  message.set_scene_text(header.scene_text);
  for (const std::string& each : header.overrides) message.add_override(each);
  message.set_live(header.live);
  message.set_hardware(header.hardware);
  message.set_start_unix_ns(header.start_unix_ns);
  message.set_joints(static_cast<std::uint32_t>(header.joints));
  if (header.properties) {
    schema::HardwareProperties& p = *message.mutable_properties();
    p.set_max_force_n(header.properties->max_force_n);
    p.set_mass_kg(header.properties->mass_kg);
    p.set_inertia_kg_m2(header.properties->inertia_kg_m2);
    for (const auto limit : kRecordedLimits) p.add_limits(header.properties->limits.*limit);
    for (int i = 0; i < header.joints; ++i)
      for (const auto limit : kRecordedOfJoint) p.add_limits((header.properties->limits.joints.*limit)[i]);
  }
  to.write(of_header, log_time_ns(Duration{0}), message.SerializeAsString());
}

std::uint64_t RecordingSide::log_time_ns(Duration now) const {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(start_unix_ns_ + now.count(), 0));
}

template <int N>
void RecordingSide::add(const TickRecord<N>& tick, std::span<const Report<N>> received) {
  thread_local schema::RecordedTick message;  // keeps its memory
  message.Clear();
  message.set_number(tick.number);
  message.set_now_ns(tick.now.count());
  message.set_dt_s(tick.dt.si());
  message.set_ended_s(tick.ended.si());
  message.set_t_s(tick.t_s);
  message.set_epoch_before(tick.epoch_before);
  message.set_peer_restarted(tick.peer_restarted);
  if (tick.peer_restarted) message.set_session_since_ns(tick.session_since.count());
  put(tick.x, *message.mutable_x());
  put(tick.v, *message.mutable_v());
  put(tick.f, master_ ? *message.mutable_applied() : *message.mutable_f_environment());
  message.set_ideal(tick.ideal);
  message.set_status(static_cast<std::uint32_t>(tick.status));
  message.set_buttons(tick.buttons);
  message.set_held(tick.held);
  if ((tick.ratio.array() != 1.0).any()) message.mutable_ratio()->Add(tick.ratio.begin(), tick.ratio.end());
  for (const Report<N>& each : received) put(each, *message.add_received());
  put_results(tick, master_, message);
  message.SerializeToString(&bytes_);
  to_->write(channel_, log_time_ns(tick.now), bytes_);
}

template <int N>
std::string difference(const TickRecord<N>& recorded, const TickRecord<N>& replayed, bool of_master) {
  schema::RecordedTick before, now;
  put_results(recorded, of_master, before);
  put_results(replayed, of_master, now);
  return before.SerializeAsString() == now.SerializeAsString() ? std::string{} : first_difference(before, now, "");
}

RecordingReader::RecordingReader(const std::string& path) : name_{path} {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) fail("it is not there, or no regular file");
  in_ = std::make_unique<std::ifstream>(path, std::ios::binary);
  if (!*in_) fail("it cannot be read");
  reader_ = std::make_unique<mcap::Reader>(*in_, name_);
}

RecordingReader::RecordingReader(std::unique_ptr<std::istream> in, std::string name)
    : name_{std::move(name)}, in_{std::move(in)}, reader_{std::make_unique<mcap::Reader>(*in_, name_)} {}

RecordingReader::Kind RecordingReader::next() {
  if (!reader_->next(message_)) return Kind::end;
  const mcap::Channel& channel = *message_.channel;
  if (channel.schema == schema::RecordedTick::descriptor()->full_name()) {
    if (message_.data.size() > kLongestTick) fail("a tick is longer than " + std::to_string(kLongestTick) + " bytes");
    return Kind::tick;
  }
  if (channel.schema != schema::RecordingHeader::descriptor()->full_name()) return Kind::other;
  if (message_.data.size() > kLongestHeader)
    fail("a header is longer than " + std::to_string(kLongestHeader) + " bytes");

  schema::RecordingHeader m;
  if (!m.ParseFromArray(message_.data.data(), static_cast<int>(message_.data.size()))) fail("a header is damaged");
  const std::string_view hardware = std::string_view{m.side()}.substr(0, m.side().find('/'));
  if ((hardware != "master" && hardware != "slave") ||
      (hardware != m.side() && m.side() != std::string{hardware}.append(kOfGripper)))
    fail("a header is of neither master nor slave");
  if (m.dof() != 1 && m.dof() != 3 && m.dof() != 6 && m.dof() != kJointPort)
    fail("a header has no dof of 1, 3, 6 or 8");
  if (m.joints() > kJointPort || (m.joints() > 0) != (m.dof() == kJointPort))
    fail("a header has another number of joints than 1 to 8 with dof 8, and none else");
  header_ = {.program = m.program(),
             .side = m.side(),
             .dof = static_cast<int>(m.dof()),
             .rate_hz = m.rate_hz(),
             .scene_file = m.scene_file(),
             .scene_text = m.scene_text(),
             .overrides = {m.override().begin(), m.override().end()},
             .live = m.live(),
             .hardware = m.hardware(),
             .properties = std::nullopt,
             .start_unix_ns = m.start_unix_ns(),
             .joints = static_cast<int>(m.joints())};
  if (m.has_properties()) {
    const schema::HardwareProperties& p = m.properties();
    constexpr int kOfPort = std::size(kRecordedLimits), kOfJoint = std::size(kRecordedOfJoint);
    // Programs before kRecordedOfJoint recorded none of them.
    const int joints = p.limits_size() == kOfPort ? 0 : header_.joints;
    if (p.limits_size() != kOfPort + joints * kOfJoint) fail("a header has other limits");
    DeviceInfo& info = header_.properties.emplace();
    info.name = m.hardware();
    info.max_force_n = p.max_force_n();
    info.mass_kg = p.mass_kg();
    info.inertia_kg_m2 = p.inertia_kg_m2();
    for (int i = 0; i < kOfPort; ++i) info.limits.*kRecordedLimits[i] = p.limits(i);
    for (int i = 0; i < joints * kOfJoint; ++i)
      (info.limits.joints.*kRecordedOfJoint[i % kOfJoint])[i / kOfJoint] = p.limits(kOfPort + i);
  }
  return Kind::header;
}

template <int N>
bool RecordingReader::tick(RecordedTick<N>& into) {
  thread_local schema::RecordedTick m;
  if (!m.ParseFromArray(message_.data.data(), static_cast<int>(message_.data.size()))) fail("a tick is damaged");
  TickRecord<N>& t = into.tick;
  t.number = m.number();
  t.now = Duration{m.now_ns()};
  t.dt = Seconds{m.dt_s()};
  t.ended = Seconds{m.ended_s()};
  t.t_s = m.t_s();
  t.epoch_before = m.epoch_before();
  t.peer_restarted = m.peer_restarted();
  t.session_since = Duration{m.session_since_ns()};
  t.epoch = m.epoch();
  t.ideal = m.ideal();
  if (m.status() > static_cast<std::uint32_t>(HardwareStatus::stopped)) return false;
  t.status = static_cast<HardwareStatus>(m.status());
  t.buttons = m.buttons();
  t.held = m.held();
  t.ratio.setOnes();
  if (m.ratio_size() != 0 && m.ratio_size() != N) return false;
  std::copy(m.ratio().begin(), m.ratio().end(), t.ratio.begin());
  t.dissipated_j = m.dissipated_j();
  t.undissipated_j = m.undissipated_j();
  const bool master = m.applied_size() > 0;
  bool fits = take(m.x(), t.x) && take(m.v(), t.v) && take(master ? m.applied() : m.f_environment(), t.f) &&
              take(m.command(), t.command) && take(m.mode(), t.mode);
  fits = fits && (master ? take(m.wanted(), t.wanted) : take(m.x_d(), t.x_d) && take(m.v_d(), t.v_d));
  into.received.clear();
  for (const schema::RecordedReport& each : m.received()) fits = fits && take(each, into.received.emplace_back());
  t.sends = m.has_sent();
  return fits && (!t.sends || take(m.sent(), t.sent));
}

void RecordingReader::fail(const std::string& why) const {
  throw ConfigError{name_ + ": " + why};
}

RecordedHand read_recorded_hand(const std::string& path, bool of_gripper) {
  const std::string side = of_gripper ? std::string{"master"}.append(kOfGripper) : "master";
  RecordingReader recording{path};
  RecordedHand hand;
  schema::RecordedTick m;
  for (RecordingReader::Kind kind; (kind = recording.next()) != RecordingReader::Kind::end;) {
    if (kind == RecordingReader::Kind::header && recording.header().side == side) hand.dof = recording.header().dof;
    if (kind != RecordingReader::Kind::tick || recording.topic() != "/" + side + "/tick" || hand.dof == 0) continue;
    const std::string_view data = recording.message().data;
    if (!m.ParseFromArray(data.data(), static_cast<int>(data.size()))) recording.fail("a tick is damaged");
    if (m.x_size() != (hand.dof == 6 ? 7 : hand.dof) || m.v_size() != hand.dof)
      recording.fail("a tick has another dof");
    if (!(m.t_s() >= 0.0)) continue;
    if (!hand.t_s.empty() && !(m.t_s() > hand.t_s.back())) recording.fail("its times do not increase");
    hand.t_s.push_back(m.t_s());
    hand.x.insert(hand.x.end(), m.x().begin(), m.x().end());
    hand.v.insert(hand.v.end(), m.v().begin(), m.v().end());
  }
  if (hand.t_s.empty() && of_gripper && hand.dof == 0) recording.fail("it has no gripper");
  if (hand.t_s.empty()) recording.fail("it has no tick of a master in contact with its slave");
  const auto finite = [](double value) { return std::isfinite(value); };
  if (!std::ranges::all_of(hand.x, finite) || !std::ranges::all_of(hand.v, finite))
    recording.fail("a position of the hand is not finite");
  return hand;
}

#define TWOPORT_COMPILE_TICKS(N, ...)                                                    \
  template void RecordingSide::add<N>(const TickRecord<N>&, std::span<const Report<N>>); \
  template std::string difference<N>(const TickRecord<N>&, const TickRecord<N>&, bool);  \
  template bool RecordingReader::tick<N>(RecordedTick<N>&);
TWOPORT_EACH_DOF(TWOPORT_COMPILE_TICKS)

}  // namespace twoport
