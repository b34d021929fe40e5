#include "common/wire/codec.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "proto/report.pb.h"
#include "tests/support/no_alloc.h"

namespace twoport::codec_test {
namespace {

using Bytes = std::vector<std::byte>;

template <int N>
struct Dof {
  static constexpr int value = N;
};

template <class Rng, int N>
void fill(Rng& rng, Position<N>& x) {
  std::normal_distribution<double> number{0.0, 10.0};
  if constexpr (N == 6) {
    const Eigen::Vector3d p = Eigen::Vector3d::NullaryExpr([&] { return number(rng); });
    x = Position<6>{p, rotation(Eigen::Vector3d::NullaryExpr([&] { return number(rng) * 0.1; }))};
  } else {
    x = Position<N>{Position<N>::Vector::NullaryExpr([&] { return number(rng); })};
  }
}
template <class Rng, class Kind, int N>
void fill(Rng& rng, Coords<Kind, N>& c) {
  std::normal_distribution<double> number{0.0, 10.0};
  c = Coords<Kind, N>{Coords<Kind, N>::Vector::NullaryExpr([&] { return number(rng); })};
}

template <int N>
Envelope<N> some(std::mt19937_64& rng) {
  Envelope<N> e;
  e.session = rng() | 1;
  e.peer_session = rng();
  e.report.sequence = rng() | 1;
  e.report.sent_ns = static_cast<std::int64_t>(rng() >> 4);
  e.report.echo_ns = static_cast<std::int64_t>(rng() >> 4);
  fill(rng, e.report.x);
  fill(rng, e.report.v);
  fill(rng, e.report.f);
  fill(rng, e.report.f_coupling);
  fill(rng, e.report.f_environment);
  e.report.energy_in_j = std::normal_distribution<double>{0.0, 1.0}(rng);
  e.report.energy_net_j = std::normal_distribution<double>{0.0, 1.0}(rng);
  e.report.mode = static_cast<Mode>(rng() % 4);
  return e;
}

template <class Vector>
std::vector<std::uint64_t> bits(const Vector& v) {
  std::vector<std::uint64_t> out;
  for (double d : v) out.push_back(std::bit_cast<std::uint64_t>(d));
  return out;
}
template <int N>
std::vector<std::uint64_t> bits(const Position<N>& x) {
  std::vector<std::uint64_t> out = bits(x.translation());
  if constexpr (N == 6)
    for (std::uint64_t b : bits(x.attitude().coeffs())) out.push_back(b);
  return out;
}

template <int N>
void expect_same(const Report<N>& a, const Report<N>& b) {
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.sent_ns, b.sent_ns);
  EXPECT_EQ(a.echo_ns, b.echo_ns);
  EXPECT_EQ(a.mode, b.mode);
  EXPECT_EQ(std::bit_cast<std::uint64_t>(a.energy_in_j), std::bit_cast<std::uint64_t>(b.energy_in_j));
  EXPECT_EQ(std::bit_cast<std::uint64_t>(a.energy_net_j), std::bit_cast<std::uint64_t>(b.energy_net_j));
  EXPECT_EQ(bits(a.x), bits(b.x));
  EXPECT_EQ(bits(a.v.vec()), bits(b.v.vec()));
  EXPECT_EQ(bits(a.f.vec()), bits(b.f.vec()));
  EXPECT_EQ(bits(a.f_coupling.vec()), bits(b.f_coupling.vec()));
  EXPECT_EQ(bits(a.f_environment.vec()), bits(b.f_environment.vec()));
}

template <int N>
Bytes encoded(const Envelope<N>& e) {
  Codec<N> codec;
  const auto bytes = codec.encode(e);
  return {bytes.begin(), bytes.end()};
}
template <int N>
Decoded decoded(const Bytes& bytes) {
  Codec<N> codec;
  Envelope<N> e;
  return codec.decode(bytes, e);
}

/// As proto/report.proto has it.
unsigned wire_type_of(const google::protobuf::FieldDescriptor& field) {
  using Field = google::protobuf::FieldDescriptor;
  switch (field.type()) {
    case Field::TYPE_FIXED64:
    case Field::TYPE_SFIXED64:
      return 1;
    case Field::TYPE_DOUBLE:
      return field.is_repeated() ? 2 : 1;
    case Field::TYPE_BYTES:
      return 2;
    case Field::TYPE_FIXED32:
      return 5;
    default:
      return 0;
  }
}

template <class D>
class CodecOf : public ::testing::Test {};
using Dofs = ::testing::Types<Dof<1>, Dof<3>, Dof<6>>;
TYPED_TEST_SUITE(CodecOf, Dofs);

TYPED_TEST(CodecOf, ReturnsEveryBit) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{20240611};
  Codec<N> sender, receiver;
  Envelope<N> got;
  for (int k = 0; k < 1000; ++k) {
    const Envelope<N> sent = some<N>(rng);
    const auto bytes = sender.encode(sent);
    ASSERT_LE(bytes.size(), kMaxDatagram);
    ASSERT_EQ(receiver.decode(bytes, got), Decoded::ok) << k;
    EXPECT_EQ(got.version, kProtocolVersion);
    EXPECT_EQ(got.session, sent.session);
    EXPECT_EQ(got.peer_session, sent.peer_session);
    EXPECT_FALSE(got.identity);
    EXPECT_TRUE(got.refusal.empty());
    expect_same(got.report, sent.report);
  }
}

TYPED_TEST(CodecOf, ReturnsZerosAndExtremes) {
  constexpr int N = TypeParam::value;
  Envelope<N> sent;
  sent.session = 1;
  sent.report.sequence = 1;
  sent.report.v = Velocity<N>{Velocity<N>::Vector::Constant(-0.0)};
  sent.report.f = Force<N>{Force<N>::Vector::Constant(std::numeric_limits<double>::denorm_min())};
  sent.report.f_coupling = Force<N>{Force<N>::Vector::Constant(std::numeric_limits<double>::max() / 64)};
  Codec<N> codec;
  Envelope<N> got;
  ASSERT_EQ(codec.decode(encoded(sent), got), Decoded::ok);
  expect_same(got.report, sent.report);
  EXPECT_EQ(got.report.echo_ns, -1);
}

TYPED_TEST(CodecOf, CarriesIdentityAndForgetsItInTheNext) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{3};
  Envelope<N> sent = some<N>(rng);
  const std::string fields{"\0\xff\x80 of fields", 13};
  sent.identity = Identity{N, 2000.0, 0xfedcba9876543210, Side::slave, fields};
  Codec<N> sender, receiver;
  Envelope<N> got;
  ASSERT_EQ(receiver.decode(sender.encode(sent), got), Decoded::ok);
  ASSERT_TRUE(got.identity);
  EXPECT_EQ(got.identity->dof, N);
  EXPECT_EQ(got.identity->rate_hz, 2000.0);
  EXPECT_EQ(got.identity->scene_digest, 0xfedcba9876543210);
  EXPECT_EQ(got.identity->side, Side::slave);
  EXPECT_EQ(got.identity->scene_fields, fields);
  expect_same(got.report, sent.report);

  sent.identity.reset();
  ASSERT_EQ(receiver.decode(sender.encode(sent), got), Decoded::ok);
  EXPECT_FALSE(got.identity);
}

TYPED_TEST(CodecOf, CarriesARefusalCutAndPrintable) {
  constexpr int N = TypeParam::value;
  Envelope<N> sent;
  sent.session = 1;
  const std::string words = "no\x1b[31m \xff way, " + std::string(1000, 'x');
  sent.refusal = words;
  Codec<N> sender, receiver;
  Envelope<N> got;
  ASSERT_EQ(receiver.decode(sender.encode(sent), got), Decoded::ok);
  EXPECT_EQ(got.refusal.size(), kMaxRefusal);
  EXPECT_EQ(got.refusal.substr(0, 17), "no?[31m ? way, xx");
}

TYPED_TEST(CodecOf, DoesNotAllocate) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{5};
  std::vector<Envelope<N>> sent;
  for (int k = 0; k < 64; ++k) sent.push_back(some<N>(rng));
  for (int k = 0; k < 8; ++k) sent.push_back(sent[0]), sent.back().identity = Identity{N, 1e3, 7, Side::master};
  for (int k = 0; k < 8; ++k) sent.push_back(sent[0]), sent.back().environment = {.number = 3, .count = 4};
  const std::string words(kMaxRefusal, 'x');
  sent.push_back(sent[0]), sent.back().refusal = words;
  Codec<N> sender, receiver;
  Envelope<N> got;
  int bad = 0;
  const NoAlloc guard;
  for (int round = 0; round < 20; ++round)
    for (const Envelope<N>& e : sent)
      if (receiver.decode(sender.encode(e), got) != Decoded::ok) ++bad;
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(bad, 0);
}

TYPED_TEST(CodecOf, NoiseDoesNotAllocate) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{6};
  std::vector<Bytes> noise(200, Bytes(200));
  for (Bytes& b : noise) std::generate(b.begin(), b.end(), [&] { return static_cast<std::byte>(rng()); });
  Codec<N> codec;
  Envelope<N> got;
  int accepted = 0;
  const NoAlloc guard;
  for (const Bytes& b : noise)
    if (codec.decode(b, got) != Decoded::malformed) ++accepted;
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(accepted, 0);
}

TYPED_TEST(CodecOf, RejectsWhatIsTruncatedAnywhere) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{7};
  Envelope<N> sent = some<N>(rng);
  sent.report.energy_in_j = 0.25;
  const Bytes whole = encoded(sent);
  for (std::size_t n = 0; n < whole.size(); ++n) {
    const Decoded result = decoded<N>({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n)});
    // Only the last field can go without being missed: zero is written as nothing.
    if (n + 9 == whole.size()) continue;
    EXPECT_EQ(result, Decoded::malformed) << n << " of " << whole.size();
  }
}

TYPED_TEST(CodecOf, RejectsWhatIsTooLong) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{7};
  Bytes bytes = encoded(some<N>(rng));
  // Field 100, length-delimited, up to just above the limit: well-formed Protobuf.
  const std::size_t filler = kMaxDatagram + 1 - bytes.size() - 4;
  for (unsigned b : {0xa2U, 0x06U, static_cast<unsigned>(filler & 0x7f) | 0x80U, static_cast<unsigned>(filler >> 7)})
    bytes.push_back(static_cast<std::byte>(b));
  bytes.resize(bytes.size() + filler);
  ASSERT_EQ(bytes.size(), kMaxDatagram + 1);
  EXPECT_EQ(decoded<N>(bytes), Decoded::malformed);
}

/// Appends a field of this number and wire type, of a valid length.
void append_field(Bytes& bytes, unsigned number, unsigned wire_type) {
  const unsigned tag = number << 3 | wire_type;
  if (tag >= 0x80) bytes.push_back(static_cast<std::byte>((tag & 0x7f) | 0x80));
  bytes.push_back(static_cast<std::byte>(tag >= 0x80 ? tag >> 7 : tag));
  switch (wire_type) {
    case 0:
      return bytes.push_back(std::byte{1});
    case 1:
      return bytes.resize(bytes.size() + 8);
    case 2:
      bytes.push_back(std::byte{8});
      return bytes.resize(bytes.size() + 8);
    case 3:  // a group, and its end
      return append_field(bytes, number, 4);
    case 5:
      return bytes.resize(bytes.size() + 4);
  }
}

TYPED_TEST(CodecOf, RejectsFieldsThatNobodyKnowsWithoutAllocating) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{7};
  const Bytes good = encoded(some<N>(rng));
  Codec<N> codec;
  Envelope<N> got;
  int of_known_type = 0;
  for (unsigned number : {1U,  2U,  3U,  4U,  5U,  6U,  7U,  8U,  9U,  10U, 11U, 12U, 13U, 14U, 15U, 16U, 17U,
                          18U, 19U, 20U, 21U, 22U, 23U, 24U, 25U, 26U, 27U, 28U, 29U, 30U, 31U, 32U, 100U}) {
    for (unsigned wire_type : {0U, 1U, 2U, 3U, 5U}) {
      Bytes bytes = good;
      append_field(bytes, number, wire_type);
      const NoAlloc guard;
      const Decoded result = codec.decode(bytes, got);
      EXPECT_EQ(guard.seen(), 0) << number << " " << wire_type;
      const auto* field = schema::Datagram::descriptor()->FindFieldByNumber(static_cast<int>(number));
      if (field != nullptr && wire_type == wire_type_of(*field)) {
        ++of_known_type;
      } else {
        EXPECT_EQ(result, Decoded::malformed) << number << " " << wire_type;
      }
    }
  }
  EXPECT_EQ(of_known_type, schema::Datagram::descriptor()->field_count());
  EXPECT_EQ(codec.decode(good, got), Decoded::ok);
}

TYPED_TEST(CodecOf, RejectsNumbersThatAreNone) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{8};
  const Envelope<N> good = some<N>(rng);
  ASSERT_EQ(decoded<N>(encoded(good)), Decoded::ok);
  for (double bad : {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
                     std::numeric_limits<double>::quiet_NaN()}) {
    const auto with = [&](auto change) {
      Envelope<N> e = good;
      change(e.report);
      return decoded<N>(encoded(e));
    };
    typename Force<N>::Vector last = Force<N>::Vector::Zero();
    last[N - 1] = bad;
    EXPECT_EQ(with([&](auto& r) { r.energy_in_j = bad; }), Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.energy_net_j = bad; }), Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.x = r.x + Displacement<N>{bad * Displacement<N>::Vector::Unit(0)}; }),
              Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.v = Velocity<N>{last}; }), Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.f = Force<N>{last}; }), Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.f_coupling = Force<N>{last}; }), Decoded::malformed);
    EXPECT_EQ(with([&](auto& r) { r.f_environment = Force<N>{last}; }), Decoded::malformed);
  }
}

TYPED_TEST(CodecOf, RejectsTimesModesAndSequencesThatAreNone) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{9};
  const Envelope<N> good = some<N>(rng);
  const auto with = [&](auto change) {
    Envelope<N> e = good;
    change(e);
    return decoded<N>(encoded(e));
  };
  constexpr auto kMax = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(with([](auto&) {}), Decoded::ok);
  EXPECT_EQ(with([](auto& e) { e.report.sent_ns = -1; }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.report.sent_ns = kMax; }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.report.echo_ns = -2; }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.report.echo_ns = kMax; }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.report.mode = static_cast<Mode>(7); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.report.sequence = 0; }), Decoded::malformed);
  EXPECT_EQ(with([](auto& e) { e.session = 0; }), Decoded::malformed);
}

TYPED_TEST(CodecOf, RejectsAnIdentityThatIsNone) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{10};
  Envelope<N> e = some<N>(rng);
  e.identity = Identity{N, 1000.0, 0, Side::master};
  EXPECT_EQ(decoded<N>(encoded(e)), Decoded::ok);
  e.identity = Identity{N, 0.0, 0, Side::master};
  EXPECT_EQ(decoded<N>(encoded(e)), Decoded::malformed);
  e.identity = Identity{N, std::numeric_limits<double>::infinity(), 0, Side::master};
  EXPECT_EQ(decoded<N>(encoded(e)), Decoded::malformed);
  e.identity = Identity{N, 1000.0, 0, static_cast<Side>(3)};
  EXPECT_EQ(decoded<N>(encoded(e)), Decoded::malformed);
}

// Any bytes are survived, and what is accepted is fit for use.
TYPED_TEST(CodecOf, SurvivesEveryDamage) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{11};
  Codec<N> codec;
  Envelope<N> got;
  int accepted = 0;
  ::testing::internal::CaptureStderr();
  for (int k = 0; k < 20'000; ++k) {
    Envelope<N> sent = some<N>(rng);
    if (rng() % 4 == 0) sent.identity = Identity{N, 1000.0, rng(), Side::master};
    if (rng() % 8 == 0) sent.refusal = "no";
    Bytes bytes = encoded(sent);
    const std::uint64_t damages = 1 + rng() % 4;
    for (std::uint64_t d = 0; d < damages; ++d) {
      const std::size_t at = rng() % bytes.size();
      switch (rng() % 4) {
        case 0:
          bytes[at] ^= static_cast<std::byte>(1U << rng() % 8);
          break;
        case 1:
          bytes[at] = static_cast<std::byte>(rng());
          break;
        case 2:
          bytes.resize(at + 1);
          break;
        case 3:
          bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), static_cast<std::byte>(rng()));
          break;
      }
    }
    if (codec.decode(bytes, got) != Decoded::ok || !got.refusal.empty()) continue;
    ++accepted;
    ASSERT_TRUE(got.report.finite());
    ASSERT_LE(got.report.mode, Mode::ended);
    ASSERT_NE(got.session, 0U);
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_GT(accepted, 100);  // a flipped bit of a number is a number: the fuzz reaches the end of decode
}

TYPED_TEST(CodecOf, CarriesAReportOfTheGripper) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{12};
  Envelope<N> sent = some<N>(rng);
  const Bytes without = encoded(sent);
  sent.gripper = some<1>(rng).report;
  sent.gripper.words.count = 2, sent.gripper.words.totals = 1;
  sent.gripper.words.at[0] = 3.0, sent.gripper.words.at[1] = -4.0;
  EXPECT_EQ(encoded(sent), without) << "only with has_gripper";
  sent.has_gripper = true;
  const Bytes with = encoded(sent);
  EXPECT_GT(with.size(), without.size() + 7 * sizeof(double));

  Codec<N> codec;
  Envelope<N> got;
  ASSERT_EQ(codec.decode(with, got), Decoded::ok);
  ASSERT_TRUE(got.has_gripper);
  EXPECT_EQ(got.gripper.x.translation()[0], sent.gripper.x.translation()[0]);
  EXPECT_EQ(got.gripper.v[0], sent.gripper.v[0]);
  EXPECT_EQ(got.gripper.f[0], sent.gripper.f[0]);
  EXPECT_EQ(got.gripper.f_coupling[0], sent.gripper.f_coupling[0]);
  EXPECT_EQ(got.gripper.f_environment[0], sent.gripper.f_environment[0]);
  EXPECT_EQ(got.gripper.position_error[0], sent.gripper.position_error[0]);
  EXPECT_EQ(got.gripper.energy_in_j, sent.gripper.energy_in_j);
  EXPECT_EQ(got.gripper.energy_net_j, sent.gripper.energy_net_j);
  EXPECT_EQ(got.gripper.words.count, 2);
  EXPECT_EQ(got.gripper.words.at[1], -4.0);
  EXPECT_EQ(got.gripper.sequence, sent.report.sequence);
  EXPECT_EQ(got.gripper.sent_ns, sent.report.sent_ns);
  // Without one the packet says so, whatever came before.
  ASSERT_EQ(codec.decode(without, got), Decoded::ok);
  EXPECT_FALSE(got.has_gripper);

  sent.gripper.energy_in_j = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(decoded<N>(encoded(sent)), Decoded::malformed);
  schema::Datagram cut;
  ASSERT_TRUE(cut.ParseFromArray(with.data(), static_cast<int>(with.size())));
  cut.mutable_gripper()->RemoveLast();
  Bytes bytes(cut.ByteSizeLong());
  cut.SerializeToArray(bytes.data(), static_cast<int>(bytes.size()));
  EXPECT_EQ(decoded<N>(bytes), Decoded::malformed);
}

TYPED_TEST(CodecOf, CarriesWhatIsSaidOfTheEnvironment) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{15};
  Envelope<N> sent = some<N>(rng);
  const Bytes without = encoded(sent);
  sent.environment = {.number = 7,
                      .answer = EnvironmentAnswer::adjustable,
                      .energy_j = -0.25,
                      .count = 2,
                      .surface = {{{3000.0, 0.2}, {500.0, -1.0}}},
                      .link_energy_j = -0.125,
                      .joints = 6,
                      .joint_rad = {0.1, 0.2, 0.3, 0.4, 0.5, 0.6},
                      .has_object = N == kJointPort,
                      .object_m = {0.01, -0.02, 0.03},
                      .zero_number = 3,
                      .zero_answer = ZeroAnswer::presses,
                      .sensor_drift_n = 0.75};
  const Bytes with = encoded(sent);
  Codec<N> codec;
  Envelope<N> got;
  ASSERT_EQ(codec.decode(with, got), Decoded::ok);
  EXPECT_EQ(got.environment.number, 7U);
  EXPECT_EQ(got.environment.answer, EnvironmentAnswer::adjustable);
  EXPECT_EQ(got.environment.energy_j, -0.25);
  ASSERT_EQ(got.environment.count, 2);
  EXPECT_EQ(got.environment.surface[0].stiffness_n_per_m, 3000.0);
  EXPECT_EQ(got.environment.surface[1].friction, -1.0);
  EXPECT_EQ(got.environment.link_energy_j, -0.125);
  ASSERT_EQ(got.environment.joints, 6);
  EXPECT_EQ(got.environment.joint_rad, sent.environment.joint_rad);
  EXPECT_EQ(got.environment.has_object, N == kJointPort);
  if (N == kJointPort) {
    EXPECT_EQ(got.environment.object_m, sent.environment.object_m);
  }
  EXPECT_EQ(got.environment.zero_number, 3U);
  EXPECT_EQ(got.environment.zero_answer, ZeroAnswer::presses);
  EXPECT_EQ(got.environment.sensor_drift_n, 0.75);
  expect_same(got.report, sent.report);
  // Without one the packet says so, whatever came before.
  ASSERT_EQ(codec.decode(without, got), Decoded::ok);
  EXPECT_EQ(got.environment.number, 0U);
  EXPECT_EQ(got.environment.count, 0);
  EXPECT_FALSE(got.environment.has_object);
  sent.environment.number = 0;
  EXPECT_EQ(encoded(sent), without);
}

TYPED_TEST(CodecOf, RejectsWhatCannotBeSaidOfTheEnvironment) {
  constexpr int N = TypeParam::value;
  std::mt19937_64 rng{16};
  Envelope<N> sent = some<N>(rng);
  sent.environment = {.number = 2, .count = 4, .surface = {{{1.0, 0.0}, {2.0, 0.0}, {3.0, 0.0}, {4.0, 0.0}}}};
  const Bytes good = encoded(sent);
  ASSERT_EQ(decoded<N>(good), Decoded::ok);
  const auto with = [&](auto change) {
    schema::Datagram message;
    EXPECT_TRUE(message.ParseFromArray(good.data(), static_cast<int>(good.size())));
    change(message);
    Bytes bytes(message.ByteSizeLong());
    message.SerializeToArray(bytes.data(), static_cast<int>(bytes.size()));
    return decoded<N>(bytes);
  };
  EXPECT_EQ(with([](auto& m) { m.mutable_environment()->RemoveLast(); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.add_environment(1.0), m.add_environment(1.0); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_environment_number(0); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_environment_answer(kEnvironmentAnswers); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_environment_energy_j(std::nan("")); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_environment(3, HUGE_VAL); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_link_energy_j(HUGE_VAL); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.add_joint_rad(std::nan("")); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_zero_answer(kZeroAnswers); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.set_sensor_drift_n(std::nan("")); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.mutable_joint_rad()->Resize(9, 0.0); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.mutable_joint_rad()->Resize(8, 0.0); }), Decoded::ok);
  EXPECT_EQ(with([](auto& m) { m.mutable_object_m()->Resize(2, 0.0); }), Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.mutable_object_m()->Resize(3, HUGE_VAL); }), Decoded::malformed);
  const Decoded with_object = with([](auto& m) { m.mutable_object_m()->Resize(3, 0.0); });
  EXPECT_EQ(with_object, N == kJointPort ? Decoded::ok : Decoded::malformed);
  EXPECT_EQ(with([](auto& m) { m.clear_environment(); }), Decoded::ok);
}

/// Most datagrams are read without Protobuf, which reads those that say a thing twice. Both say the same of whatever bytes arrive.
template <int N>
void expect_read_as_by_protobuf() {
  std::mt19937_64 rng{N};
  int ok = 0, malformed = 0;
  for (int k = 0; k < 20000; ++k) {
    Envelope<N> sent = some<N>(rng);
    if (rng() % 2 == 0) {
      sent.report.epoch = static_cast<std::uint32_t>(rng() % 1000);
      sent.report.words.count = static_cast<std::uint8_t>(rng() % (Words::kMost + 1));
      sent.report.words.totals = static_cast<std::uint32_t>(rng());
      std::fill_n(sent.report.words.at.begin(), sent.report.words.count, 0.5);
    }
    if (rng() % 8 == 0) sent.report.energy_in_j = 0.0;
    Bytes plain = encoded(sent);
    if (k % 2 == 0)
      for (auto flips = rng() % 3 + 1; flips > 0; --flips)
        plain[rng() % plain.size()] ^= static_cast<std::byte>(1U << rng() % 8);
    if (k % 4 == 0) plain.resize(rng() % plain.size());
    Fields field{plain};
    while (field.next()) {
    }
    Codec<N> codec;
    Envelope<N> fast, slow;
    fast.environment.number = slow.environment.number = 7;
    const Decoded what = codec.decode(plain, fast);
    if (!field.complete() || plain.size() < 5) {
      EXPECT_NE(what, Decoded::ok);
      continue;
    }
    Bytes twice = plain;
    twice.insert(twice.end(), plain.begin(), plain.begin() + 5);
    ASSERT_EQ(what, codec.decode(twice, slow)) << k;
    if (what == Decoded::malformed) ++malformed;
    if (what != Decoded::ok) continue;
    ++ok;
    EXPECT_EQ(fast.session, slow.session);
    EXPECT_EQ(fast.peer_session, slow.peer_session);
    EXPECT_EQ(fast.identity.has_value(), slow.identity.has_value());
    EXPECT_EQ(fast.has_gripper, slow.has_gripper);
    EXPECT_EQ(fast.environment.number, slow.environment.number);
    expect_same(fast.report, slow.report);
    EXPECT_EQ(bits(fast.report.position_error.vec()), bits(slow.report.position_error.vec()));
    EXPECT_EQ(fast.report.epoch, slow.report.epoch);
    ASSERT_EQ(fast.report.words.count, slow.report.words.count);
    EXPECT_EQ(fast.report.words.totals, slow.report.words.totals);
    EXPECT_TRUE(std::equal(fast.report.words.at.begin(), fast.report.words.at.begin() + fast.report.words.count,
                           slow.report.words.at.begin()));
  }
  EXPECT_GT(ok, 10000);
  EXPECT_GT(malformed, 200);
}
TEST(Codec, ReadsAsProtobufDoes) {
  expect_read_as_by_protobuf<1>();
  expect_read_as_by_protobuf<3>();
  expect_read_as_by_protobuf<6>();
}

TEST(Codec, SaysWhenTheOtherHasOtherDof) {
  std::mt19937_64 rng{12};
  Envelope<6> sent = some<6>(rng);
  const Bytes silent = encoded(sent);
  sent.identity = Identity{6, 1000.0, 99, Side::slave};
  const Bytes introduced = encoded(sent);
  Codec<3> codec;
  Envelope<3> got;
  EXPECT_EQ(codec.decode(silent, got), Decoded::malformed);
  ASSERT_EQ(codec.decode(introduced, got), Decoded::other_dof);
  EXPECT_EQ(got.session, sent.session);
  ASSERT_TRUE(got.identity);
  EXPECT_EQ(got.identity->dof, 6);
}

/// Little-endian (Protobuf's encoding).
TEST(Codec, BytesAreTheSameOnEveryMachine) {
  Envelope<1> sent;
  sent.session = 0x0102030405060708, sent.peer_session = 0x1112131415161718;
  sent.identity = Identity{1, 2000.0, 0x2122232425262728, Side::slave, "12"};
  Report<1>& r = sent.report;
  r.sequence = 0x4142434445464748, r.sent_ns = 0x0151525354555657, r.echo_ns = -1;
  r.mode = Mode::coupled, r.epoch = 300, r.energy_in_j = 1.0;
  r.x = Position<1>{Position<1>::Vector{-2.5}};
  r.words.count = 1, r.words.totals = 0x61626364, r.words.at[0] = 0.1;
  const Bytes bytes = encoded(sent);
  std::string hex;
  for (const std::byte b : bytes) hex += fmt::format("{:02x}", std::to_integer<int>(b));
  EXPECT_EQ(hex,
            "0d02005054110807060504030201191817161514131211214847464544434241295756555453525101"
            "31ffffffffffffffff3801423800000000000004c0" +
                std::string(96, '0') +
                "49000000000000f03f5001590000000000409f40612827262524232221"
                "70027a089a9999999999b93f8501646362618801ac029201023132");

  Header stable;
  ASSERT_TRUE(read_stable_fields(bytes, stable));
  EXPECT_EQ(stable.version, kProtocolVersion);
  EXPECT_EQ(stable.session, sent.session);
  EXPECT_EQ(stable.peer_session, sent.peer_session);
}

TEST(Codec, SaysWhenTheOtherHasAnotherVersion) {
  std::mt19937_64 rng{13};
  Envelope<3> sent = some<3>(rng);
  sent.version = kProtocolVersion + 1;
  Codec<3> codec;
  Envelope<3> got;
  ASSERT_EQ(codec.decode(encoded(sent), got), Decoded::other_version);
  EXPECT_EQ(got.version, kProtocolVersion + 1);
  EXPECT_EQ(got.session, sent.session);
  sent.refusal = "too new\x01";
  sent.peer_session = 5;
  Bytes bytes = encoded(sent);
  // A later version may have more fields, and other types.
  append_field(bytes, 100, 2);
  append_field(bytes, 7, 1);
  const NoAlloc guard;
  ASSERT_EQ(codec.decode(bytes, got), Decoded::other_version);
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(got.refusal, "too new?");
  EXPECT_EQ(got.peer_session, 5U);
  bytes.pop_back();
  EXPECT_EQ(codec.decode(bytes, got), Decoded::malformed);
}

TEST(Codec, RejectsAnAttitudeThatIsNone) {
  std::mt19937_64 rng{14};
  Envelope<6> e = some<6>(rng);
  e.report.x = Position<6>{Eigen::Vector3d::Zero(), Eigen::Quaterniond{0.9, 0.0, 0.0, 0.0}};
  EXPECT_EQ(decoded<6>(encoded(e)), Decoded::malformed);
  e.report.x = Position<6>{Eigen::Vector3d::Zero(), Eigen::Quaterniond{0.0, 0.0, 0.0, 0.0}};
  EXPECT_EQ(decoded<6>(encoded(e)), Decoded::malformed);
}

TEST(NoAlloc, SeesAnAllocation) {
  int seen_new = 0, seen_malloc = 0;
  {
    const NoAlloc guard;
    auto* p = new double[64];
    asm volatile("" : : "g"(p) : "memory");  // the compiler may otherwise remove the pair
    seen_new = guard.seen();
    delete[] p;
  }
  {
    const NoAlloc guard;
    void* p = std::malloc(64);
    asm volatile("" : : "g"(p) : "memory");
    seen_malloc = guard.seen();
    std::free(p);
  }
  EXPECT_GT(seen_new, 0);
  EXPECT_GT(seen_malloc, 0);
}

}  // namespace
}  // namespace twoport::codec_test
