#pragma once

#include <cctype>
#include <cstddef>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/text.h"

namespace twoport::test {

/// As much of URScript as a program of the driver needs: one `def` without parameters, local variables, if, elif, else, while, numbers,
/// strings, lists, poses p[...], sums, comparisons, and calls with named arguments.
class UrScript {
 public:
  struct Value {
    std::vector<double> numbers;
    std::string text;
    [[nodiscard]] double number() const {
      if (numbers.size() != 1) throw std::runtime_error{"a number is expected"};
      return numbers.front();
    }
  };
  struct Arguments {
    std::vector<Value> in_order;
    std::map<std::string, Value> named;
  };
  using Call = std::function<Value(const std::string& name, const Arguments&)>;

  /// Throws std::runtime_error for what is no such program.
  explicit UrScript(std::string_view text) {
    while (!text.empty())
      if (const std::string_view line = take_line(text); !line.empty()) lines_.emplace_back(line);
    if (lines_.empty() || !lines_.front().starts_with("def ") || lines_.back() != "end")
      throw std::runtime_error{"a program is def NAME(): ... end"};
    matching_.resize(lines_.size());
    std::vector<std::size_t> open;
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      const std::string& line = lines_[i];
      const bool branch = line.starts_with("elif ") || line == "else:";
      if (branch || line == "end") {
        if (open.empty()) throw std::runtime_error{line + " without a block"};
        matching_[open.back()] = i;
        if (line == "end" && lines_[open.back()].starts_with("while ")) matching_[i] = open.back();
        open.pop_back();
      }
      const bool opens = branch || line.starts_with("def ") || line.starts_with("if ") || line.starts_with("while ");
      if (opens && line.back() != ':') throw std::runtime_error{line + " does not end with a colon"};
      if (opens) open.push_back(i);
    }
    if (!open.empty()) throw std::runtime_error{"an end is missing"};
  }
  void run(const Call& call) {
    call_ = &call;
    variables_.clear();
    block(1, lines_.size() - 1);
  }

 private:
  void block(std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < to;) {
      const std::string& line = lines_[i];
      if (line.starts_with("while ")) {
        while (is_true(i)) block(i + 1, matching_[i]);
        i = matching_[i] + 1;
      } else if (line.starts_with("if ")) {
        bool done = false;
        for (; lines_[i] != "end"; i = matching_[i])
          if (!done && (done = lines_[i] == "else:" || is_true(i))) block(i + 1, matching_[i]);
        ++i;
      } else {
        statement(line);
        ++i;
      }
    }
  }
  bool is_true(std::size_t i) {
    const std::string& line = lines_[i];
    const std::size_t begin = line.find(' ');
    return evaluate(line.substr(begin, line.size() - 1 - begin)).number() != 0.0;
  }
  void statement(std::string line) {
    if (line.starts_with("local ")) line.erase(0, 6);
    std::size_t name = 0;
    while (name < line.size() && is_of_name(line[name])) ++name;
    const std::size_t equals = line.find_first_not_of(' ', name);
    if (equals != line.npos && line[equals] == '=' && line[equals + 1] != '=')
      variables_[line.substr(0, name)] = evaluate(line.substr(equals + 1));
    else
      evaluate(line);
  }
  Value evaluate(const std::string& expression) {
    rest_ = expression;
    Value value = comparison();
    if (!rest_.empty()) throw std::runtime_error{"not understood: " + expression};
    return value;
  }

  static bool is_of_name(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }
  bool takes(std::string_view token) {
    while (!rest_.empty() && rest_.front() == ' ') rest_.erase(0, 1);
    if (!rest_.starts_with(token)) return false;
    rest_.erase(0, token.size());
    return true;
  }
  void needs(std::string_view token) {
    if (!takes(token)) throw std::runtime_error{"expected " + std::string{token} + " before " + rest_};
  }
  Value comparison() {
    Value left = sum();
    const auto answer = [&](bool is) { return Value{{is ? 1.0 : 0.0}, {}}; };
    if (takes("==")) return answer(left.number() == sum().number());
    if (takes("<")) return answer(left.number() < sum().number());
    if (takes(">")) return answer(left.number() > sum().number());
    return left;
  }
  Value sum() {
    Value left = term();
    for (;;) {
      if (takes("+"))
        left = {{left.number() + term().number()}, {}};
      else if (takes("-"))
        left = {{left.number() - term().number()}, {}};
      else
        return left;
    }
  }
  Value term() {
    if (takes("-")) return {{-term().number()}, {}};
    if (takes("p[") || takes("[")) return list();
    if (takes("\"")) {
      const std::size_t end = rest_.find('"');
      if (end == rest_.npos) throw std::runtime_error{"a string does not end"};
      Value text{{}, rest_.substr(0, end)};
      rest_.erase(0, end + 1);
      return text;
    }
    std::size_t size = 0;
    while (size < rest_.size() && (is_of_name(rest_[size]) || rest_[size] == '.')) ++size;
    const std::string word = rest_.substr(0, size);
    rest_.erase(0, size);
    takes("");
    if (const auto number = number_from<double>(word)) return {{*number}, {}};
    if (word == "True" || word == "False") return {{word == "True" ? 1.0 : 0.0}, {}};
    if (takes("(")) return called(word);
    const auto found = variables_.find(word);
    if (found == variables_.end()) throw std::runtime_error{"no variable " + word};
    return found->second;
  }
  Value list() {
    Value all;
    if (takes("]")) return all;
    do all.numbers.push_back(comparison().number());
    while (takes(","));
    needs("]");
    return all;
  }
  Value called(const std::string& name) {
    Arguments given;
    if (!takes(")")) {
      do {
        takes("");
        std::size_t size = 0;
        while (size < rest_.size() && is_of_name(rest_[size])) ++size;
        if (size > 0 && size + 1 < rest_.size() && rest_[size] == '=' && rest_[size + 1] != '=') {
          const std::string of = rest_.substr(0, size);
          rest_.erase(0, size + 1);
          given.named[of] = comparison();
        } else {
          given.in_order.push_back(comparison());
        }
      } while (takes(","));
      needs(")");
    }
    std::string rest = std::move(rest_);
    Value value = (*call_)(name, given);
    rest_ = std::move(rest);
    return value;
  }

  std::vector<std::string> lines_;
  std::vector<std::size_t> matching_;  ///< of a line that opens a block the one that closes it
  std::map<std::string, Value> variables_;
  std::string rest_;
  const Call* call_ = nullptr;
};

}  // namespace twoport::test
