#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "lab/plot/label.h"
#include "lab/study/sweep.h"

namespace twoport::lab {

/// Is the text a number?
std::optional<double> number_of(const std::string& text);

/// gnuplot's ticks for a logarithmic axis of less than three decades, at 1, 2, 5 of each; empty for a longer one, where
/// gnuplot's own serve.
std::string log_ticks(char name, double low, double high);

/// Where a picture puts the values of an axis, and how far the cell of each reaches. Values that are no numbers have a
/// spacing of one, from 0.
class Scale {
 public:
  explicit Scale(const Axis& axis);

  [[nodiscard]] const Label& label() const { return label_; }
  [[nodiscard]] bool words() const { return words_; }
  [[nodiscard]] bool logarithmic() const { return logarithmic_; }
  [[nodiscard]] double at(const std::string& value) const { return at_.at(value); }
  /// From where to where the cell at a place reaches: half way to its neighbours, `part` of that.
  [[nodiscard]] std::pair<double, double> reach(double place, double part = 1.0) const;

  /// Range, ticks and scale of gnuplot's axis `name`; ticks without their numbers or words where a panel further left has
  /// them, and slanted where they would not fit side by side.
  [[nodiscard]] std::string commands(char name, bool with_tick_labels = true, bool slanted = false) const;
  /// Characters of the longest word at a tick; 0 where there are numbers.
  [[nodiscard]] std::size_t longest_word() const;
  [[nodiscard]] std::size_t size() const { return at_.size(); }

 private:
  Label label_;
  bool words_ = false, logarithmic_ = false;
  std::map<std::string, double> at_;
  std::map<double, std::pair<double, double>> reach_;
};

}  // namespace twoport::lab
