#include "common/record/trace.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <iterator>
#include <utility>

#include "common/base/check.h"

namespace twoport {
namespace {

std::string partial(const std::string& path) {
  return path + ".partial";
}

template <class Vector>
void append(std::string& line, const Vector& v) {
  for (int i = 0; i < v.size(); ++i) fmt::format_to(std::back_inserter(line), ",{:.9g}", v[i]);
}

}  // namespace

template <int N>
Trace<N>::Trace(std::string path) : path_{std::move(path)}, file_{std::fopen(partial(path_).c_str(), "w")} {
  if (file_ == nullptr) throw ConfigError(fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
  line_ = "t_s";
  for (const char* name :
       {"master_x", "master_v", "master_f", "master_f_wanted", "slave_x", "slave_v", "slave_f", "env_f"})
    for (int i = 0; i < N; ++i) fmt::format_to(std::back_inserter(line_), ",{}_{}", name, i);
  line_ += ",master_energy_j,slave_energy_j\n";
  std::fputs(line_.c_str(), file_);
}

template <int N>
Trace<N>::~Trace() {
  if (file_ == nullptr) return;
  std::fclose(file_);
  std::remove(partial(path_).c_str());
}

template <int N>
void Trace<N>::add(const Row<N>& row) {
  line_.clear();
  fmt::format_to(std::back_inserter(line_), "{:.9g}", row.t_s);
  append(line_, coordinates(row.master_x));
  append(line_, row.master_v.vec());
  append(line_, row.master_f.vec());
  append(line_, row.master_f_wanted.vec());
  append(line_, coordinates(row.slave_x));
  append(line_, row.slave_v.vec());
  append(line_, row.slave_f.vec());
  append(line_, row.env_f.vec());
  fmt::format_to(std::back_inserter(line_), ",{:.9g},{:.9g}\n", row.master_energy_j, row.slave_energy_j);
  if (std::fwrite(line_.data(), 1, line_.size(), file_) != line_.size() && error_ == 0) error_ = errno;
}

template <int N>
void Trace<N>::close() {
  if (std::fclose(std::exchange(file_, nullptr)) != 0 && error_ == 0) error_ = errno;
  if (error_ == 0 && std::rename(partial(path_).c_str(), path_.c_str()) != 0) error_ = errno;
  if (error_ == 0) return;
  std::remove(partial(path_).c_str());
  throw IoError(fmt::format("{}: cannot be written: {}", path_, std::strerror(error_)));
}

template class Trace<1>;
template class Trace<3>;
template class Trace<6>;

}  // namespace twoport
