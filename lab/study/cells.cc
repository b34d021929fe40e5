#include "lab/study/cells.h"

#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "common/base/check.h"
#include "common/base/text.h"

namespace twoport::lab {
namespace {

namespace pb = google::protobuf;

std::string list(const std::vector<std::string>& texts) {
  std::vector<std::string> all;
  for (const std::string& text : texts) all.push_back(json_string(text));
  return fmt::format("[{}]", fmt::join(all, ", "));
}

constexpr std::string_view kCheck = ", \"check\": \"";

/// Ends the object `{…` with a digest of itself and of the sweep that it belongs to.
std::string with_check(const std::string& object, std::string_view of_sweep) {
  Digest digest;
  digest.add(of_sweep);
  digest.add(object);
  return fmt::format("{}{}{}\"}}\n", object, kCheck, digest.text());
}

/// Does this line, its newline included, end with its own check?
bool is_as_written(const std::string& line, std::string_view of_sweep) {
  const std::size_t end = line.rfind(kCheck);
  return end != line.npos && with_check(line.substr(0, end), of_sweep) == line;
}

std::string line_of(const Plan& plan, std::size_t cell, const Values& row) {
  std::vector<std::string> texts;
  for (const Value& value : row) texts.push_back(value.text());
  return with_check(fmt::format("{{\"cell\": {}, \"row\": {}", cell, list(texts)), plan.digest);
}

std::vector<std::string> texts(const pb::Value& value) {
  std::vector<std::string> all;
  for (const pb::Value& each : value.list_value().values()) all.push_back(each.string_value());
  return all;
}

/// A member of an object; an empty value where there is none. What it returns refers to the object, not to the name.
const pb::Value& member(const pb::Struct& object, const char* name) {
  static const pb::Value kNone;
  const auto found = object.fields().find(name);
  return found == object.fields().end() ? kNone : found->second;
}

/// Cell and row of a line as line() writes it; none where it reads otherwise.
std::optional<std::pair<std::size_t, std::vector<std::string>>> parse_cell(const Plan& plan, const std::string& line) {
  pb::Struct object;
  if (!is_as_written(line, plan.digest) || !pb::util::JsonStringToMessage(line, &object).ok()) return std::nullopt;
  const auto cell = static_cast<std::size_t>(member(object, "cell").number_value());
  std::vector<std::string> row = texts(member(object, "row"));
  if (cell >= plan.grid.cells() || row.size() != plan.columns.size()) return std::nullopt;
  const std::vector<std::string> varied = plan.varied_columns(cell);
  if (!std::equal(varied.begin(), varied.end(), row.begin())) return std::nullopt;
  return std::pair{cell, std::move(row)};
}

/// Line 1 of `path`. Throws ConfigError when it is not what a sweep has written.
Plan parse_plan(const std::string& path, const std::string& line) {
  pb::Struct object;
  Plan plan;
  if (!is_as_written(line, "") || !pb::util::JsonStringToMessage(line, &object).ok())
    throw ConfigError{
        fmt::format("{}:1: is not what a sweep has written; remove the file to run its cells again", path)};
  plan.digest = member(object, "digest").string_value();
  plan.seeds = static_cast<std::size_t>(member(object, "seeds").number_value());
  plan.columns = texts(member(object, "columns"));
  for (const pb::Value& axis : member(object, "axes").list_value().values())
    plan.grid.axes.push_back({.paths = parse_paths(member(axis.struct_value(), "path").string_value(), path + ":1"),
                              .values = texts(member(axis.struct_value(), "values")),
                              .logarithmic = member(axis.struct_value(), "log").bool_value()});
  double cells = 1.0;
  for (const Axis& axis : plan.grid.axes) cells *= static_cast<double>(axis.values.size());
  if (!(cells >= 1.0 && cells <= static_cast<double>(kMostCells)))
    throw ConfigError{fmt::format("{}:1: {:.0f} cells; there must be 1 to {}", path, cells, kMostCells)};
  return plan;
}

}  // namespace

std::vector<std::string> Plan::varied_columns(std::size_t cell) const {
  const std::vector<std::string> of_axis = grid.values(cell);
  std::vector<std::string> all;
  for (std::size_t i = 0; i < of_axis.size(); ++i) all.insert(all.end(), grid.axes[i].paths.size(), of_axis[i]);
  return all;
}

std::string Plan::line() const {
  std::vector<std::string> of_axes;
  for (const Axis& a : grid.axes)
    of_axes.push_back(fmt::format(R"({{"path": {}, "log": {}, "values": {}}})", json_string(a.name()), a.logarithmic,
                                  list(a.values)));
  return with_check(fmt::format("{{\"digest\": {}, \"axes\": [{}], \"seeds\": {}, \"columns\": {}", json_string(digest),
                                fmt::join(of_axes, ", "), seeds, list(columns)),
                    "");
}

CellFile::CellFile(const std::string& folder) : path_{cells_in(folder)} {
  if (!std::ifstream{path_}) throw ConfigError{fmt::format("{}: cannot be read; a sweep with --out leaves it", path_)};
  if (!read()) throw ConfigError{fmt::format("{}: is empty", path_)};
}

CellFile::CellFile(const std::string& folder, const Plan& plan) : path_{cells_in(folder)} {
  make_folder(folder);
  lock_.emplace(folder, "--out");
  if (!read()) {
    const std::string first = plan.line();
    write_whole(path_, first);
    plan_ = plan;
    begins_.assign(plan.grid.cells(), kMissing);
    end_ = first.size();
    in_.close();
    in_.open(path_, std::ios::binary);
  } else if (plan_.line() != plan.line()) {
    throw ConfigError{
        fmt::format("{}: holds cells of another scene, overrides, axes, seeds, verdict or version; name another --out, "
                    "or remove it",
                    path_)};
  } else if (std::error_code error; std::filesystem::file_size(path_, error) > end_ && !error) {
    std::filesystem::resize_file(path_, end_, error);
    if (error) throw IoError{fmt::format("{}: cannot be written: {}", path_, error.message())};
  }
  out_.open(path_, std::ios::app | std::ios::binary);
}

/// Every line of the file. False when there is not one.
bool CellFile::read() {
  in_.open(path_, std::ios::binary);
  std::string line;
  for (int number = 1; std::getline(in_, line) && !in_.eof(); ++number) {
    line += '\n';
    if (number == 1) {
      plan_ = parse_plan(path_, line);
      begins_.assign(plan_.grid.cells(), kMissing);
    } else if (!add(line)) {
      throw ConfigError{
          fmt::format("{}:{}: is not a cell of this sweep as it was written; remove the line to run its cell again",
                      path_, number)};
    }
    end_ += line.size();
  }
  in_.clear();
  return end_ > 0;
}

/// One more line, at end_. False if it is not of the sweep, or was changed.
bool CellFile::add(const std::string& line) {
  const auto found = parse_cell(plan_, line);
  if (!found) return false;
  // Files put together by hand may hold the same row twice.
  if (holds(found->first)) {
    const auto here = in_.tellg();
    const bool same = this->line(found->first) == line;
    in_.seekg(here);
    return same;
  }
  begins_[found->first] = end_;
  return true;
}

void CellFile::append(std::size_t cell, const Values& row) {
  if (failure_.empty()) {
    errno = 0;
    const std::string text = line_of(plan_, cell, row);
    out_ << text << std::flush;
    if (out_) {
      begins_[cell] = std::exchange(end_, end_ + text.size());
      return;
    }
    failure_ =
        fmt::format("{}: cannot be written{}", path_, errno != 0 ? ": " + std::generic_category().message(errno) : "");
  }
  throw IoError{failure_};
}

std::string CellFile::line(std::size_t cell) {
  std::string text;
  in_.seekg(static_cast<std::streamoff>(begins_[cell]));
  if (!std::getline(in_, text)) throw IoError{fmt::format("{}: cannot be read any more", path_)};
  return text + '\n';
}

Values CellFile::row(std::size_t cell) {
  auto found = parse_cell(plan_, line(cell));
  if (!found || found->first != cell) throw IoError{fmt::format("{}: was changed meanwhile", path_)};
  // Figures stand between the varied paths and the texts.
  const std::size_t varied = plan_.varied_columns(cell).size(), texts = 5 + (plan_.seeds > 0 ? 1 : 0);
  Values row;
  for (std::size_t i = 0; i < found->second.size(); ++i) {
    const bool figure = i >= varied && i + texts < found->second.size();
    const std::optional<double> number = figure ? number_from<double>(found->second[i]) : std::nullopt;
    row.push_back(number ? Value{*number} : Value{std::move(found->second[i])});
  }
  return row;
}

std::string cells_in(const std::string& folder) {
  return (std::filesystem::path{folder} / "cells.jsonl").string();
}

void make_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw ConfigError{fmt::format("--out {}: cannot be created: {}", folder, error.message())};
}

}  // namespace twoport::lab
