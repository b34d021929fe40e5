#pragma once

#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace twoport::mcap {

/// Name and unit of each field, or whatever else a channel says of itself.
using Metadata = std::map<std::string, std::string>;

/// Where the messages of a recording go: a file, whoever listens, or both.
class Channels {
 public:
  virtual ~Channels() = default;
  /// A channel of Protobuf messages; the first is 1. `schema`: their full name; `descriptors`: a serialised FileDescriptorSet.
  virtual std::uint16_t add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                                    const Metadata& metadata) = 0;
  virtual void write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) = 0;
};

/// Writes an MCAP file (mcap.dev/spec, version 0): chunks with zstd, message index, chunk index, statistics, CRC.
///
/// The file is whole after every flush(): data end, summary and footer stand behind the last chunk, and the next chunk
/// replaces them. A killed program loses what came after its last flush. A flush that ends within its write leaves a file
/// without footer; Reader, and what recovers MCAP files, read it up to the chunk before.
///
/// When a write fails, as on a full disk, the end is written again where it was, so that the file stays readable. Everything
/// after that is ignored; error() and close() say why. One thread.
class Writer final : public Channels {
 public:
  /// Throws ConfigError with the path and the reason when the file cannot be written.
  Writer(std::string path, std::string_view program);
  /// Flushes.
  ~Writer() override;
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  std::uint16_t add_channel(std::string_view topic, std::string_view schema, std::string_view descriptors,
                            const Metadata& metadata) override;
  /// Flushes by itself when half a second of log time has passed since the last flush, and the chunk is as long as the
  /// summary, so that summaries take at most half of what is written.
  void write(std::uint16_t channel, std::uint64_t log_time_ns, std::string_view message) override;
  void flush();
  /// Flushes and closes the file. Throws IoError with error() if not everything has been written.
  void close();
  /// Path and reason of the write that has failed; empty: none has.
  [[nodiscard]] const std::string& error() const { return error_; }

  [[nodiscard]] const std::string& path() const { return path_; }
  /// Bytes of the file so far, without its end.
  [[nodiscard]] std::uint64_t size() const { return offset_; }

 private:
  struct Channel {
    std::string index;  ///< of the messages in the chunk: log time and offset of each
    std::uint64_t messages = 0;
    std::uint32_t in_chunk = 0;
  };
  struct CloseFile {
    void operator()(std::FILE* file) const noexcept;
  };

  [[nodiscard]] std::string end_of_file() const;
  void fail(const std::string& why, std::uint64_t old_size);

  std::string path_;
  std::unique_ptr<std::FILE, CloseFile> file_;
  std::uint64_t offset_ = 0;  ///< of the end
  std::string end_;           ///< as last written
  std::string definitions_;   ///< schemas and channels
  std::string unwritten_;     ///< those that are not in the file yet
  std::string chunk_, chunk_indices_;
  std::vector<Channel> channels_;
  std::uint64_t chunk_first_ns_ = 0, chunk_last_ns_ = 0, first_ns_ = 0, last_ns_ = 0, messages_ = 0;
  std::uint32_t chunks_ = 0;
  std::string error_;
};

}  // namespace twoport::mcap
