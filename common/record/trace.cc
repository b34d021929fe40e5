#include "common/record/trace.h"

#include <array>
#include <charconv>
#include <iterator>

#include "common/base/built_for.h"
#include "common/base/fmt.h"
#include "common/record/columns.h"

namespace twoport {
namespace {

void append_names(std::string& line, std::string_view name, double) {
  fmt::format_to(std::back_inserter(line), "{},", name);
}
template <class Vector>
void append_names(std::string& line, std::string_view name, const Vector& v) {
  for (int i = 0; i < v.size(); ++i) fmt::format_to(std::back_inserter(line), "{}_{},", name, i);
}

/// As "%.9g", in half of the time that {fmt} takes.
void append(std::string& line, double value) {
  std::array<char, 32> text;
  char* const end = std::to_chars(text.begin(), text.end(), value, std::chars_format::general, 9).ptr;
  line.append(text.begin(), end) += ',';
}
template <class Vector>
void append(std::string& line, const Vector& v) {
  for (int i = 0; i < v.size(); ++i) append(line, v[i]);
}

}  // namespace

template <int N>
Trace<N>::Trace(WholeFile& file, int size) : file_{&file}, size_{size} {
  for_each_column(
      Row<N>{}, [&](const Column& column, const auto& v) { append_names(line_, column.name, v); }, size_);
  line_.back() = '\n';
  file_->write(line_);
}

template <int N>
void Trace<N>::add(const Row<N>& row) {
  line_.clear();
  for_each_column(
      row, [&](const Column&, const auto& value) { append(line_, value); }, size_);
  line_.back() = '\n';
  file_->write(line_);
}

TWOPORT_COMPILE(Trace);

}  // namespace twoport
