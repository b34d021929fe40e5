#include "common/record/trace_channel.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include <bit>
#include <filesystem>
#include <iterator>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/fmt.h"
#include "common/record/columns.h"

namespace twoport {
namespace {

namespace pb = google::protobuf;
using Wire = pb::internal::WireFormatLite;

constexpr const char* kSchema = "twoport.schema.TraceRow";

/// The schema of a row, from the list of columns.
template <int N>
std::string descriptors() {
  pb::FileDescriptorSet set;
  pb::FileDescriptorProto& file = *set.add_file();
  file.set_name("proto/trace_row.proto");
  file.set_package("twoport.schema");
  file.set_syntax("proto3");
  pb::DescriptorProto& message = *file.add_message_type();
  message.set_name("TraceRow");
  for_each_column(Row<N>{}, [&]<class V>(const Column& column, const V&) {
    pb::FieldDescriptorProto& field = *message.add_field();
    field.set_name(std::string{column.name});
    field.set_number(message.field_size());
    field.set_type(pb::FieldDescriptorProto::TYPE_DOUBLE);
    field.set_label(std::is_same_v<V, double> ? pb::FieldDescriptorProto::LABEL_OPTIONAL
                                              : pb::FieldDescriptorProto::LABEL_REPEATED);
  });
  return set.SerializeAsString();
}

template <int N>
mcap::Metadata units() {
  mcap::Metadata all;
  for_each_column(Row<N>{}, [&](const Column& column, const auto&) {
    std::string unit{column.unit};
    if (N == 6 && !column.rotational_unit.empty()) unit += ", " + std::string{column.rotational_unit};
    if (!unit.empty()) all[std::string{column.name}] = unit;
  });
  return all;
}

void append_varint(std::string& to, std::uint32_t value) {
  for (; value >= 0x80U; value >>= 7U) to.push_back(static_cast<char>(value | 0x80U));
  to.push_back(static_cast<char>(value));
}
void append_double(std::string& to, double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  for (int i = 0; i < 8; ++i) to.push_back(static_cast<char>(bits >> (8 * i) & 0xFFU));
}

/// A column of a recorded trace, with the values of a row.
struct TraceColumn {
  std::string name;
  bool vector;
  std::vector<double> values;
};

std::vector<TraceColumn> columns_of(const mcap::Channel& channel, const RecordingReader& recording) {
  pb::FileDescriptorSet set;
  if (!set.ParseFromString(channel.descriptors) || set.file_size() != 1 || set.file(0).message_type_size() != 1)
    recording.fail("the schema of its trace is damaged");
  std::vector<TraceColumn> all;
  for (const pb::FieldDescriptorProto& field : set.file(0).message_type(0).field()) {
    if (field.number() != static_cast<int>(all.size()) + 1 || field.type() != pb::FieldDescriptorProto::TYPE_DOUBLE)
      recording.fail("the schema of its trace is of another program");
    all.push_back({field.name(), field.label() == pb::FieldDescriptorProto::LABEL_REPEATED, {}});
  }
  return all;
}

/// Of one row; false when it is damaged.
bool read_row(std::string_view data, std::vector<TraceColumn>& columns) {
  for (TraceColumn& each : columns) each.values.clear();
  pb::io::CodedInputStream in{reinterpret_cast<const std::uint8_t*>(data.data()), static_cast<int>(data.size())};
  while (const std::uint32_t tag = in.ReadTag()) {
    const auto number = static_cast<std::size_t>(Wire::GetTagFieldNumber(tag));
    if (number < 1 || number > columns.size()) return false;
    TraceColumn& column = columns[number - 1];
    std::uint32_t size = sizeof(double);
    if (Wire::GetTagWireType(tag) == Wire::WIRETYPE_LENGTH_DELIMITED) {
      if (!column.vector || !in.ReadVarint32(&size) || size % sizeof(double) != 0 || size > data.size()) return false;
    } else if (Wire::GetTagWireType(tag) != Wire::WIRETYPE_FIXED64) {
      return false;
    }
    for (std::size_t left = size / sizeof(double); left > 0; --left) {
      std::uint64_t bits = 0;
      if (!in.ReadLittleEndian64(&bits)) return false;
      column.values.push_back(std::bit_cast<double>(bits));
    }
  }
  return in.ConsumedEntireMessage();
}

void append_names(std::string& line, const std::vector<TraceColumn>& columns) {
  for (const TraceColumn& each : columns) {
    if (!each.vector) fmt::format_to(std::back_inserter(line), "{},", each.name);
    for (std::size_t i = 0; each.vector && i < each.values.size(); ++i)
      fmt::format_to(std::back_inserter(line), "{}_{},", each.name, i);
  }
}

}  // namespace

template <int N>
TraceChannel<N>::TraceChannel(mcap::Channels& to, const std::string& topic, int size)
    : to_{&to}, size_{size}, channel_{to.add_channel(topic, kSchema, descriptors<N>(), units<N>())} {}

template <int N>
void TraceChannel<N>::add(std::uint64_t log_time_ns, const Row<N>& row) {
  bytes_.clear();
  std::uint32_t number = 0;
  const auto append = [&]<class V>(const Column&, const V& value) {
    ++number;
    if constexpr (std::is_same_v<V, double>) {
      append_varint(bytes_, number << 3U | Wire::WIRETYPE_FIXED64);
      append_double(bytes_, value);
    } else {
      append_varint(bytes_, number << 3U | Wire::WIRETYPE_LENGTH_DELIMITED);
      append_varint(bytes_, static_cast<std::uint32_t>(value.size()) * sizeof(double));
      for (int i = 0; i < value.size(); ++i) append_double(bytes_, value[i]);
    }
  };
  for_each_column(row, append, size_);
  to_->write(channel_, log_time_ns, bytes_);
}

TWOPORT_COMPILE(TraceChannel);

namespace {

/// A trace of a recording, row by row, each as wide as the first.
class TraceRows {
 public:
  virtual ~TraceRows() = default;

  void add(const mcap::Message& message, const RecordingReader& recording) {
    const bool first = rows_ == 0;
    if (first) columns_ = columns_of(*message.channel, recording);
    if (columns_.empty() || !read_row(message.data, columns_)) damaged(recording);
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      if (columns_[i].values.empty() || (!first && columns_[i].values.size() != widths_[i])) damaged(recording);
      if (first) widths_.push_back(columns_[i].values.size());
    }
    if (first) begin(columns_, message.channel->metadata);
    take(columns_);
    ++rows_;
  }
  [[nodiscard]] std::uint64_t rows() const { return rows_; }

 private:
  virtual void begin(const std::vector<TraceColumn>& columns, const mcap::Metadata& units) = 0;
  virtual void take(const std::vector<TraceColumn>& columns) = 0;
  [[noreturn]] static void damaged(const RecordingReader& recording) {
    recording.fail("a row of its trace is damaged");
  }

  std::vector<TraceColumn> columns_;
  std::vector<std::size_t> widths_;  // of the first row
  std::uint64_t rows_ = 0;
};

/// A trace on its way into a file.
class CsvTrace final : public TraceRows {
 public:
  explicit CsvTrace(std::string path) : path_{std::move(path)} {}

  /// Nothing where there was no row.
  void commit(std::vector<ExportedTrace>& all) {
    if (!file_) return;
    file_->commit();
    all.push_back({path_, rows()});
  }

 private:
  void begin(const std::vector<TraceColumn>& columns, const mcap::Metadata&) override {
    file_.emplace(path_);
    append_names(line_, columns);
    line_.back() = '\n';
    file_->write(line_);
  }
  void take(const std::vector<TraceColumn>& columns) override {
    line_.clear();
    for (const TraceColumn& each : columns)
      for (const double value : each.values) fmt::format_to(std::back_inserter(line_), "{:.9g},", value);
    line_.back() = '\n';
    file_->write(line_);
  }

  std::string path_;
  std::optional<WholeFile> file_;
  std::string line_;
};

class TraceInMemory final : public TraceRows {
 public:
  std::shared_ptr<TraceTable> table;  ///< null: there was no row

 private:
  void begin(const std::vector<TraceColumn>& columns, const mcap::Metadata& units) override {
    std::vector<TraceTable::Field> fields;
    for (const TraceColumn& each : columns) {
      const auto unit = units.find(each.name);
      const std::string text = unit == units.end() ? "" : unit->second;
      const std::size_t comma = text.find(", ");
      fields.push_back({.name = each.name,
                        .size = each.values.size(),
                        .vector = each.vector,
                        .unit = text.substr(0, comma),
                        .rotational_unit = comma == std::string::npos ? "" : text.substr(comma + 2)});
    }
    table = std::make_shared<TraceTable>(std::move(fields));
  }
  void take(const std::vector<TraceColumn>& columns) override {
    for (const TraceColumn& each : columns)
      for (const double value : each.values) table->append(value);
  }
};

/// Gives the rows of the trace and of the gripper's. Returns the first header.
RecordingHeader read_traces(RecordingReader& recording, TraceRows& main, TraceRows& gripper) {
  std::optional<RecordingHeader> header;
  std::string topic, topic_of_gripper;
  for (RecordingReader::Kind kind; (kind = recording.next()) != RecordingReader::Kind::end;) {
    if (kind == RecordingReader::Kind::header && !header) header = recording.header();
    if (kind != RecordingReader::Kind::other || recording.message().channel->schema != kSchema) continue;
    const bool of_gripper = recording.topic().ends_with(std::string{kOfGripper} + "/trace");
    std::string& wanted = of_gripper ? topic_of_gripper : topic;
    if (wanted.empty()) wanted = recording.topic();
    if (recording.topic() == wanted) (of_gripper ? gripper : main).add(recording.message(), recording);
  }
  if (main.rows() == 0) recording.fail("it holds no trace");
  return header.value_or(RecordingHeader{});
}

}  // namespace

std::string gripper_csv(const std::string& path) {
  const std::filesystem::path csv{path};
  return (csv.parent_path() / (csv.stem().string() + "-gripper" + csv.extension().string())).string();
}

std::vector<ExportedTrace> export_trace(RecordingReader& recording, const std::string& path) {
  CsvTrace main{path}, gripper{gripper_csv(path)};
  read_traces(recording, main, gripper);
  std::vector<ExportedTrace> all;
  main.commit(all);
  gripper.commit(all);
  // One of an earlier recording would pass for this one's.
  if (gripper.rows() == 0 && has_content(gripper_csv(path)))
    std::filesystem::rename(gripper_csv(path), earlier_file(gripper_csv(path)));
  return all;
}

RecordedRun read_run(RecordingReader& recording) {
  TraceInMemory main, gripper;
  RecordingHeader header = read_traces(recording, main, gripper);
  return {std::move(header), main.table, gripper.table};
}

}  // namespace twoport
