#include "lab/study/cells.h"

#include <fmt/format.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <iterator>
#include <string_view>
#include <system_error>

#include "common/base/check.h"
#include "common/base/file.h"
#include "lab/study/digest.h"

namespace twoport::lab {
namespace {

namespace pb = google::protobuf;

std::string json_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string list(const std::vector<std::string>& texts) {
  std::vector<std::string> all;
  for (const std::string& text : texts) all.push_back(json_text(text));
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

std::string line(const Plan& plan) {
  std::vector<std::string> axes;
  for (const Axis& a : plan.axes)
    axes.push_back(
        fmt::format(R"({{"path": {}, "log": {}, "values": {}}})", json_text(a.name()), a.logarithmic, list(a.values)));
  return with_check(fmt::format("{{\"digest\": {}, \"axes\": [{}], \"seeds\": {}, \"columns\": {}",
                                json_text(plan.digest), fmt::join(axes, ", "), plan.seeds, list(plan.columns)),
                    "");
}

std::string line(const Plan& plan, std::size_t cell, const std::vector<std::string>& row) {
  return with_check(fmt::format("{{\"cell\": {}, \"row\": {}", cell, list(row)), plan.digest);
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

/// What the whole lines of a file say, and how many bytes they are.
struct Contents {
  Plan plan;
  Cells cells;
  std::size_t whole = 0;
};

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
    plan.axes.push_back({.paths = parse_paths(member(axis.struct_value(), "path").string_value(), path + ":1"),
                         .values = texts(member(axis.struct_value(), "values")),
                         .logarithmic = member(axis.struct_value(), "log").bool_value()});
  return plan;
}

/// One line of a cell into `cells`. False if it is not of the sweep, or was changed.
bool add_cell(const Plan& plan, const std::string& line, Cells& cells) {
  pb::Struct object;
  if (!is_as_written(line, plan.digest) || !pb::util::JsonStringToMessage(line, &object).ok()) return false;
  const double number = member(object, "cell").number_value();
  if (!(number >= 0.0 && number < static_cast<double>(plan.cells()))) return false;
  const auto cell = static_cast<std::size_t>(number);
  std::vector<std::string> row = texts(member(object, "row"));
  const std::vector<std::string> varied = plan.varied_columns(cell);
  if (static_cast<double>(cell) != number || row.size() != plan.columns.size() ||
      !std::equal(varied.begin(), varied.end(), row.begin()))
    return false;
  // Files put together by hand may hold the same row twice.
  return cells.emplace(cell, row).first->second == row;
}

Contents parse(const std::string& path, const std::string& text) {
  Contents found;
  int number = 0;
  for (std::size_t end; (end = text.find('\n', found.whole)) != text.npos; found.whole = end + 1) {
    const std::string line = text.substr(found.whole, end + 1 - found.whole);
    if (++number == 1) {
      found.plan = parse_plan(path, line);
    } else if (!add_cell(found.plan, line, found.cells)) {
      throw ConfigError{fmt::format(
          "{}:{}: is not a cell of this sweep as it was written; remove the line to run its cell again", path, number)};
    }
  }
  return found;
}

std::string path_in(const std::string& folder) {
  return (std::filesystem::path{folder} / "cells.jsonl").string();
}

bool read(const std::string& path, std::string& text) {
  std::ifstream file{path, std::ios::binary};
  if (!file) return false;
  text.assign(std::istreambuf_iterator<char>{file}, {});
  return true;
}

}  // namespace

std::size_t Plan::cells() const {
  std::size_t count = 1;
  for (const Axis& axis : axes) count *= axis.values.size();
  return count;
}

std::vector<std::string> Plan::values(std::size_t cell) const {
  std::vector<std::string> all(axes.size());
  for (std::size_t i = axes.size(); i-- > 0;) {
    all[i] = axes[i].values[cell % axes[i].values.size()];
    cell /= axes[i].values.size();
  }
  return all;
}

std::vector<std::string> Plan::varied_columns(std::size_t cell) const {
  const std::vector<std::string> of_axis = values(cell);
  std::vector<std::string> all;
  for (std::size_t i = 0; i < axes.size(); ++i) all.insert(all.end(), axes[i].paths.size(), of_axis[i]);
  return all;
}

std::string Plan::name(std::size_t cell) const {
  const std::vector<std::string> v = values(cell);
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < v.size(); ++i) parts.push_back(axes[i].name() + "=" + v[i]);
  return fmt::format("{}", fmt::join(parts, ", "));
}

CellFile::CellFile(const std::string& folder, const Plan& plan) : path_{path_in(folder)}, plan_{plan} {
  make_folder(folder);
  lock_.emplace(folder, "--out");
  std::string text;
  if (read(path_, text) && text.find('\n') != text.npos) {
    Contents found = parse(path_, text);
    if (found.plan.digest != plan.digest)
      throw ConfigError{fmt::format(
          "{}: holds cells of another scene, overrides, axes, seeds, verdict or version; name another --out, "
          "or remove it",
          path_)};
    kept_ = std::move(found.cells);
    if (found.whole < text.size()) write_whole(path_, text.substr(0, found.whole));
  } else {
    write_whole(path_, line(plan));
  }
  file_.open(path_, std::ios::app | std::ios::binary);
}

void CellFile::append(std::size_t cell, const std::vector<std::string>& row) {
  if (failure_.empty()) {
    errno = 0;
    file_ << line(plan_, cell, row) << std::flush;
    if (file_) return;
    failure_ =
        fmt::format("{}: cannot be written{}", path_, errno != 0 ? ": " + std::generic_category().message(errno) : "");
  }
  throw IoError{failure_};
}

Part read_part(const std::string& folder) {
  const std::string path = path_in(folder);
  std::string text;
  if (!read(path, text)) throw ConfigError{fmt::format("{}: cannot be read; a sweep with --out leaves it", path)};
  if (text.find('\n') == text.npos) throw ConfigError{fmt::format("{}: is empty", path)};
  Contents found = parse(path, text);
  return {path, std::move(found.plan), std::move(found.cells)};
}

void write_part(const std::string& folder, const Plan& plan, const Cells& cells) {
  make_folder(folder);
  std::string text = line(plan);
  for (const auto& [cell, row] : cells) text += line(plan, cell, row);
  write_whole(path_in(folder), text);
}

void make_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw ConfigError{fmt::format("--out {}: cannot be created: {}", folder, error.message())};
}

}  // namespace twoport::lab
