#include "common/recording/foxglove.h"

#include <fmt/format.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/wrappers.pb.h>

#include <cmath>
#include <optional>

#include "common/base/text.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;

/// With its quotes.
std::string base64(std::string_view bytes) {
  pb::BytesValue value;
  value.set_value(std::string{bytes});
  std::string json;
  static_cast<void>(pb::util::MessageToJsonString(value, &json));
  return json;
}

/// An integer of 32 bits.
std::optional<std::uint32_t> integer(const pb::Value& of) {
  const double value = of.number_value();
  if (!of.has_number_value() || !(value >= 0.0 && value < 4294967296.0) || value != std::floor(value)) return {};
  return static_cast<std::uint32_t>(value);
}

}  // namespace

std::string foxglove_channel(std::uint16_t id, std::string_view topic, std::string_view schema,
                             std::string_view descriptors) {
  return fmt::format(
      R"({{"id":{},"topic":{},"encoding":"protobuf","schemaName":{},"schema":{},"schemaEncoding":"protobuf"}})", id,
      json_string(topic), json_string(schema), base64(descriptors));
}

FoxgloveCommand parse_foxglove_command(std::string_view text) {
  FoxgloveCommand command;
  pb::Struct message;
  if (!pb::util::JsonStringToMessage(std::string{text}, &message).ok()) {
    command.complaints.emplace_back("not JSON");
    return command;
  }
  auto& fields = *message.mutable_fields();
  const std::string op = fields["op"].string_value();
  if (op == "subscribe") {
    for (pb::Value& each : *fields["subscriptions"].mutable_list_value()->mutable_values()) {
      auto& of = *each.mutable_struct_value()->mutable_fields();
      const auto id = integer(of["id"]), channel = integer(of["channelId"]);
      if (id && channel) {
        command.subscribe.push_back({*id, *channel});
      } else {
        command.complaints.emplace_back("a subscription needs id and channelId, integers of 32 bits");
      }
    }
  } else if (op == "unsubscribe") {
    for (const pb::Value& each : fields["subscriptionIds"].list_value().values())
      if (const auto id = integer(each)) command.unsubscribe.push_back(*id);
  } else {
    command.complaints.emplace_back("only subscribe and unsubscribe are known here");
  }
  return command;
}

}  // namespace twoport
