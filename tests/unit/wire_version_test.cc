#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <iterator>
#include <map>
#include <string>
#include <string_view>

#include "common/wire/header.h"
#include "proto/report.pb.h"

namespace twoport::wire_version_test {
namespace {

namespace pb = google::protobuf;

/// What each version of the wire is. Rows of a release stay as they are; the last row may change until it is released.
struct WireVersion {
  std::uint32_t version;     ///< low half of kProtocolVersion
  std::uint64_t digest;      ///< of the schema, see schema_text
  std::string_view release;  ///< first release that speaks it; empty: none yet
};
constexpr WireVersion kWireVersions[] = {
    {1, 0x569f0f783e77e61f, "0.1.0"},
    {2, 0xfa5cb7548d5b5c70, "0.2.0"},
};

/// Everything about a message that decides its bytes: number, type and repetition of each field, in the order of numbers.
/// Names do not travel. Recursive messages are not expected.
std::string schema_text(const pb::Descriptor& message) {
  std::map<int, std::string> fields;
  for (int i = 0; i < message.field_count(); ++i) {
    const pb::FieldDescriptor& field = *message.field(i);
    std::string& text = fields[field.number()];
    text = fmt::format("{} {}{}", field.number(), field.type_name(), field.is_repeated() ? " repeated" : "");
    if (field.is_packed()) text += " packed";
    if (field.message_type() != nullptr) text += fmt::format(" {{ {}}}", schema_text(*field.message_type()));
  }
  std::string all;
  for (const auto& [number, text] : fields) all += text + "; ";
  return all;
}

/// FNV-1a, 64 bits.
std::uint64_t digest(std::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  return hash;
}

TEST(WireVersion, ChangesWithTheSchemaOfARelease) {
  const WireVersion& newest = kWireVersions[std::size(kWireVersions) - 1];
  const std::string text = schema_text(*schema::Datagram::descriptor());
  ASSERT_EQ(newest.version, kProtocolVersion & 0xffff)
      << "kProtocolVersion is not that of the last row of kWireVersions: add the row {" << (kProtocolVersion & 0xffff)
      << fmt::format(", {:#018x}, \"\"}}.", digest(text));
  if (newest.release.empty()) {
    EXPECT_EQ(newest.digest, digest(text)) << fmt::format(
        "The schema changed and version {} is not released: write {:#018x} into the last row of kWireVersions.",
        newest.version, digest(text));
  } else {
    EXPECT_EQ(newest.digest, digest(text)) << fmt::format(
        "proto/report.proto differs from release {}: raise kProtocolVersion in common/wire/header.h to {:#x} and "
        "append "
        "{{{}, {:#018x}, \"\"}} to kWireVersions.",
        newest.release, kProtocolVersion + 1, newest.version + 1, digest(text));
  }
}

TEST(WireVersion, RowsAreInOrderAndOnlyTheLastIsUnreleased) {
  for (std::size_t i = 1; i < std::size(kWireVersions); ++i) {
    EXPECT_EQ(kWireVersions[i].version, kWireVersions[i - 1].version + 1);
    EXPECT_NE(kWireVersions[i].digest, kWireVersions[i - 1].digest);
    EXPECT_FALSE(kWireVersions[i - 1].release.empty()) << "version " << kWireVersions[i - 1].version;
  }
}

}  // namespace
}  // namespace twoport::wire_version_test
