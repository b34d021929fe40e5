#include "common/mcap/writer.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/mcap/bytes.h"

namespace twoport::mcap {
namespace {

constexpr std::uint64_t kFlushAfter_ns = 500'000'000;
constexpr std::size_t kLargestChunk = std::size_t{4} << 20;  // [bytes]
constexpr int kCompression = 1;

std::uint32_t crc(std::string_view bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
}

/// Empty where zstd fails.
std::string compressed(const std::string& bytes) {
  std::string z(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size = ZSTD_compress(z.data(), z.size(), bytes.data(), bytes.size(), kCompression);
  z.resize(ZSTD_isError(size) != 0 ? 0 : size);
  return z;
}

}  // namespace

void Writer::CloseFile::operator()(std::FILE* file) const noexcept {
  std::fclose(file);
}

Writer::Writer(std::string path, std::string_view program) : path_{std::move(path)}, file_{take_file(path_, kMagic)} {
  // A flush is one write, and nothing stays in the program.
  std::setvbuf(file_.get(), nullptr, _IONBF, 0);
  unwritten_ = Output{}.raw(kMagic).record(Op::header, Output{}.string("").string(program)).bytes;
}

Writer::~Writer() {
  if (file_) flush();
}

std::uint16_t Writer::add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                                  const Metadata& metadata) {
  channels_.emplace_back();
  const auto id = static_cast<std::uint16_t>(channels_.size());  // from 1
  Output entries;
  for (const auto& [key, value] : metadata) entries.string(key).string(value);
  Output both;
  both.record(Op::schema, Output{}.number(id).string(schema).string("protobuf").string(descriptors));
  both.record(Op::channel, Output{}.number(id).number(id).string(topic).string("protobuf").string(entries.bytes));
  definitions_ += both.bytes;
  unwritten_ += both.bytes;
  return id;
}

void Writer::write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) {
  if (!error_.empty()) return;
  if (chunk_.empty()) chunk_first_ns_ = chunk_last_ns_ = log_time_ns;
  if (messages_ == 0) first_ns_ = last_ns_ = log_time_ns;
  chunk_first_ns_ = std::min(chunk_first_ns_, log_time_ns), chunk_last_ns_ = std::max(chunk_last_ns_, log_time_ns);
  first_ns_ = std::min(first_ns_, log_time_ns), last_ns_ = std::max(last_ns_, log_time_ns);
  Channel& of = channels_[channel - 1U];
  of.index += Output{}.number(log_time_ns).number(static_cast<std::uint64_t>(chunk_.size())).bytes;
  chunk_ += Output{}
                .number(static_cast<std::uint8_t>(Op::message))
                .number(static_cast<std::uint64_t>(2 + 4 + 8 + 8 + message.size()))
                .number(channel)
                .number(static_cast<std::uint32_t>(of.messages))
                .number(log_time_ns)
                .number(log_time_ns)
                .bytes;
  chunk_.append(message);
  ++of.messages, ++of.in_chunk, ++messages_;
  const bool due = chunk_last_ns_ - chunk_first_ns_ >= kFlushAfter_ns && chunk_.size() >= chunk_indices_.size();
  if (due || chunk_.size() >= kLargestChunk) flush();
}

void Writer::flush() {
  if (!error_.empty() || !file_ || (chunk_.empty() && unwritten_.empty() && !end_.empty())) return;
  const std::uint64_t old_size = offset_ + end_.size();
  Output out;
  out.raw(unwritten_);
  if (!chunk_.empty()) {
    const std::string body = compressed(chunk_);
    if (body.empty()) return fail("zstd failed", old_size);
    const std::uint64_t start = offset_ + out.bytes.size();
    out.record(Op::chunk, Output{}
                              .number(chunk_first_ns_)
                              .number(chunk_last_ns_)
                              .number(static_cast<std::uint64_t>(chunk_.size()))
                              .number(crc(chunk_))
                              .string("zstd")
                              .number(static_cast<std::uint64_t>(body.size()))
                              .raw(body));
    const std::uint64_t indices = offset_ + out.bytes.size();
    Output offsets;
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      Channel& each = channels_[i];
      if (each.in_chunk == 0) continue;
      const auto id = static_cast<std::uint16_t>(i + 1);
      offsets.number(id).number(offset_ + static_cast<std::uint64_t>(out.bytes.size()));
      out.record(Op::message_index, Output{}.number(id).string(each.index));
      each.index.clear(), each.in_chunk = 0;
    }
    chunk_indices_ += Output{}
                          .record(Op::chunk_index, Output{}
                                                       .number(chunk_first_ns_)
                                                       .number(chunk_last_ns_)
                                                       .number(start)
                                                       .number(indices - start)
                                                       .string(offsets.bytes)
                                                       .number(offset_ + out.bytes.size() - indices)
                                                       .string("zstd")
                                                       .number(static_cast<std::uint64_t>(body.size()))
                                                       .number(static_cast<std::uint64_t>(chunk_.size())))
                          .bytes;
    ++chunks_;
    chunk_.clear();
  }
  unwritten_.clear();
  const std::uint64_t at = offset_;
  offset_ += out.bytes.size();
  std::string end = end_of_file();
  errno = 0;
  if (std::fseek(file_.get(), static_cast<long>(at), SEEK_SET) != 0 ||
      std::fwrite((out.bytes + end).data(), 1, out.bytes.size() + end.size(), file_.get()) !=
          out.bytes.size() + end.size()) {
    offset_ = at;
    return fail(std::generic_category().message(errno), old_size);
  }
  end_ = std::move(end);
}

void Writer::close() {
  if (file_) flush();
  if (file_ && std::fclose(file_.release()) != 0)
    error_ = path_ + ": cannot be written: " + std::generic_category().message(errno);
  if (!error_.empty()) throw IoError{error_};
}

std::string Writer::end_of_file() const {
  Output end;
  end.record(Op::data_end, Output{}.number(std::uint32_t{0}));
  const std::uint64_t summary = offset_ + end.bytes.size();
  Output counts;
  for (std::size_t i = 0; i < channels_.size(); ++i)
    counts.number(static_cast<std::uint16_t>(i + 1)).number(channels_[i].messages);
  Output rest;
  rest.raw(definitions_);
  rest.record(Op::statistics, Output{}
                                  .number(messages_)
                                  .number(static_cast<std::uint16_t>(channels_.size()))
                                  .number(static_cast<std::uint32_t>(channels_.size()))
                                  .number(std::uint32_t{0})  // attachments
                                  .number(std::uint32_t{0})  // metadata
                                  .number(chunks_)
                                  .number(first_ns_)
                                  .number(last_ns_)
                                  .string(counts.bytes));
  rest.raw(chunk_indices_);
  // The footer's CRC is of the summary and of the footer up to the CRC.
  rest.number(static_cast<std::uint8_t>(Op::footer)).number(std::uint64_t{20}).number(summary).number(std::uint64_t{0});
  rest.number(crc(rest.bytes));
  return end.raw(rest.bytes).raw(kMagic).bytes;
}

/// Leaves the file as it was before the write that has failed.
void Writer::fail(const std::string& why, std::uint64_t old_size) {
  error_ = path_ + ": cannot be written: " + why;
  chunk_ = {};
  // The place of the old end is the file's already: no further room is needed.
  if (std::fseek(file_.get(), static_cast<long>(offset_), SEEK_SET) == 0)
    std::fwrite(end_.data(), 1, end_.size(), file_.get());
  file_.reset();
  std::error_code ignored;
  std::filesystem::resize_file(path_, old_size, ignored);
}

}  // namespace twoport::mcap
