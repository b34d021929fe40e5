#pragma once

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include <optional>
#include <string>

// Protobuf text to messages, and its errors as sentences. Internal to common/scene.

namespace twoport {

/// What is wrong with a text, and where.
struct ParseError {
  std::string place;  ///< "LINE:COLUMN", both from 1; columns count bytes
  std::string sentence;
};

/// Reads Protobuf text into `message`. Returns the first error, or nothing.
std::optional<ParseError> parse_text(const std::string& text, google::protobuf::Message& message);

/// Names for error sentences: "a, b, c".
std::string field_names(const google::protobuf::Descriptor& block);
std::string value_names(const google::protobuf::EnumDescriptor& choice);

}  // namespace twoport
