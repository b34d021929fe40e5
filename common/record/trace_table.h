#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/record/columns.h"

namespace twoport {

/// The rows of trace.csv in memory, all digits kept: doubles, one row after the other.
class TraceTable {
 public:
  /// A column, or the columns of one vector.
  struct Field {
    std::string name;
    std::size_t size;
    bool vector;
    std::string unit, rotational_unit;  ///< as of Column
  };

  /// `size`: number of coordinates of a port. Room for `rows`, as far as that is not more than kReserved; more rows may come.
  TraceTable(int dof, int size, double rows) : size_{size} {
    for_dof(dof, [&]<int N>() { name_fields<N>(); });
    numbers_.reserve(static_cast<std::size_t>(std::min(rows * static_cast<double>(width_), kReserved)));
  }

  explicit TraceTable(std::vector<Field> fields) : fields_{std::move(fields)} {
    for (const Field& each : fields_) width_ += each.size;
  }

  template <int N>
  void add(const Row<N>& row) {
    for_each_column(
        row, [&](const Column&, const auto& value) { append(value); }, size_);
  }

  /// The next number of a row.
  void append(double value) { numbers_.push_back(value); }

  [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }
  [[nodiscard]] std::size_t width() const { return width_; }  ///< numbers in a row
  [[nodiscard]] std::size_t rows() const { return numbers_.size() / width_; }
  [[nodiscard]] const double* data() const { return numbers_.data(); }

 private:
  static constexpr double kReserved = 16e6;  ///< numbers

  template <class Vector>
  void append(const Vector& v) {
    for (int i = 0; i < v.size(); ++i) numbers_.push_back(v[i]);
  }
  static std::size_t size_of(double) { return 1; }
  template <class Vector>
  static std::size_t size_of(const Vector& v) {
    return static_cast<std::size_t>(v.size());
  }

  template <int N>
  void name_fields() {
    for_each_column(
        Row<N>{},
        [&]<class Value>(const Column& c, const Value& value) {
          fields_.push_back({.name = std::string{c.name},
                             .size = size_of(value),
                             .vector = !std::is_same_v<Value, double>,
                             .unit = std::string{c.unit},
                             .rotational_unit = std::string{c.rotational_unit}});
          width_ += fields_.back().size;
        },
        size_);
  }

  std::vector<Field> fields_;
  std::size_t width_ = 0;
  int size_ = 0;
  std::vector<double> numbers_;
};

}  // namespace twoport
