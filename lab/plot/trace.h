#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace twoport::lab {

/// Columns of a trace.csv, of at most some rows, evenly chosen.
class TraceFile {
 public:
  /// Throws ConfigError where the file is missing or no table of numbers.
  explicit TraceFile(const std::string& path, std::size_t most_rows = 1500);

  [[nodiscard]] std::size_t rows() const { return t_.size(); }
  [[nodiscard]] double end_s() const { return t_.empty() ? 0.0 : t_.back(); }
  /// Throws ConfigError where there is none.
  [[nodiscard]] const std::vector<double>& operator[](const std::string& column) const;
  [[nodiscard]] const std::vector<double>& t_s() const { return t_; }
  /// √(Σ column_i²) over `count` axes, from `first` on, of one row; those that the trace has.
  [[nodiscard]] double norm(const std::string& column, std::size_t row, int first = 0, int count = 3) const;

 private:
  std::string path_;
  std::vector<double> t_;
  std::map<std::string, std::vector<double>> columns_;
};

}  // namespace twoport::lab
