#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <string>
#include <type_traits>

#include "common/base/file.h"
#include "common/record/columns.h"
#include "common/record/summary.h"

namespace twoport::documented_test {
namespace {

/// The tables below a heading of docs/reference/summary-and-trace.md: unit by name. A row may name several.
std::map<std::string, std::string> documented(const std::string& heading) {
  const std::string page = read_whole(TWOPORT_DOCS "/reference/summary-and-trace.md");
  const std::size_t begin = page.find("\n## " + heading + "\n");
  EXPECT_NE(begin, page.npos) << heading;
  const std::string section = page.substr(begin, page.find("\n## ", begin + 1) - begin);
  std::map<std::string, std::string> units;
  static const std::regex kRow{"\n\\| (`[^|]*`) \\| ?([^|]*?) ?\\|[^\n|]+\\|(?=\n)"}, kName{"`([^`]+)`"};
  for (std::sregex_iterator row{section.begin(), section.end(), kRow}, end; row != end; ++row) {
    const std::string names = (*row)[1].str();
    for (std::sregex_iterator name{names.begin(), names.end(), kName}; name != end; ++name)
      EXPECT_TRUE(units.emplace((*name)[1].str(), (*row)[2].str()).second) << (*name)[1] << " is there twice";
  }
  return units;
}

std::set<std::string> names(const std::map<std::string, std::string>& units) {
  std::set<std::string> all;
  for (const auto& [name, unit] : units) all.insert(name);
  return all;
}

TEST(Documented, IsEveryFieldOfTheSummaryAndNoOther) {
  std::set<std::string> fields;
  for (const auto& [name, value] : numbers(Summary{})) fields.insert(name);
  for (int i = 0; i < Summary::descriptor()->field_count(); ++i)
    if (const auto& field = *Summary::descriptor()->field(i); !field.message_type()) fields.insert(field.name());
  EXPECT_EQ(names(documented("summary.json")), fields);
}

TEST(Documented, IsEveryColumnOfATraceWithItsUnitAndNoOther) {
  std::map<std::string, std::string> columns;
  for_each_column(Row<6>{}, [&]<class Value>(const Column& c, const Value&) {
    constexpr bool kNumber = std::is_same_v<Value, double>;
    columns.emplace(std::string{c.name} + (kNumber ? "" : "_i"),
                    std::string{c.unit} + (kNumber ? "" : ", ") + std::string{c.rotational_unit});
  });
  for_each_column(Row<kJointPort>{}, [&]<class Value>(const Column& c, const Value&) {
    if (!std::is_same_v<Value, double>) columns.emplace(std::string{c.name} + "_i", c.unit);  // of joints only
  });
  EXPECT_EQ(documented("trace.csv"), columns);
}

}  // namespace
}  // namespace twoport::documented_test
