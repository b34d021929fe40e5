#include "common/base/file.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "common/base/check.h"

namespace twoport {
namespace {

std::string partial(const std::string& path) {
  return path + ".partial";
}

std::string reason(int error) {
  return std::generic_category().message(error);
}

}  // namespace

std::string read_whole(const std::string& path, std::string_view name, std::size_t most) {
  const auto fail = [&](const std::string& why) -> ConfigError {
    return ConfigError{std::string{name.empty() ? path : name} + ": cannot be read: " + why};
  };
  // Checked before opening: opening a pipe waits for its writer.
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (error) throw fail(error.message());
  if (std::filesystem::is_directory(status)) throw fail(reason(EISDIR));
  if (!std::filesystem::is_regular_file(status)) throw fail("it is not a regular file");

  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(path.c_str(), "rb"), std::fclose};
  if (!file) throw fail(reason(errno));
  std::string text;
  std::array<char, 65536> chunk;
  for (std::size_t n; (n = std::fread(chunk.data(), 1, chunk.size(), file.get())) > 0;) {
    text.append(chunk.data(), n);
    if (text.size() > most) throw fail("it is larger than " + std::to_string(most) + " bytes");
  }
  if (std::ferror(file.get()) != 0) throw fail(reason(errno));
  return text;
}

void write_whole(const std::string& path, std::string_view text) {
  WholeFile file{path};
  file.write(text);
  file.commit();
}

WholeFile::WholeFile(std::string path) : path_{std::move(path)}, file_{std::fopen(partial(path_).c_str(), "wb")} {
  if (file_ == nullptr) throw ConfigError{path_ + ": cannot be written: " + reason(errno)};
}

WholeFile::~WholeFile() {
  if (file_ == nullptr) return;
  std::fclose(file_);
  std::remove(partial(path_).c_str());
}

void WholeFile::write(std::string_view text) noexcept {
  if (std::fwrite(text.data(), 1, text.size(), file_) != text.size() && error_ == 0) error_ = errno;
}

void WholeFile::commit() {
  if (std::fclose(std::exchange(file_, nullptr)) != 0 && error_ == 0) error_ = errno;
  if (error_ == 0 && std::rename(partial(path_).c_str(), path_.c_str()) != 0) error_ = errno;
  if (error_ == 0) return;
  std::remove(partial(path_).c_str());
  throw IoError{path_ + ": cannot be written: " + reason(error_)};
}

}  // namespace twoport
