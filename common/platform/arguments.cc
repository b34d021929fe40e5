#include "common/platform/arguments.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/check.h"
#include "common/base/print_error.h"
#include "common/base/text.h"

namespace twoport {
namespace {

/// CLI11 cannot tell `--page ""` from `--page`.
void refuse_empty_values(int argc, char** argv) {
  std::string_view option;
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument{argv[i]};
    const bool is_option = argument.starts_with("--");
    if (is_option && argument.find('=') == argument.size() - 1)
      throw ConfigError{
          fmt::format("{} is empty; give a value, or leave it out", argument.substr(0, argument.size() - 1))};
    if (argument.empty())
      throw ConfigError{option.empty() ? std::string{"an argument is empty"}
                                       : fmt::format("{} is empty; give a value, or leave it out", option)};
    option = is_option && argument.find('=') == argument.npos ? argument : std::string_view{};
  }
}

/// What follows `begin` in what CLI11 says, up to `end`; empty where it says something else.
std::string_view between(std::string_view text, std::string_view begin, std::string_view end) {
  const std::size_t from = text.find(begin), to = text.rfind(end);
  if (from == text.npos || to == text.npos || from + begin.size() > to) return {};
  return text.substr(from + begin.size(), to - from - begin.size());
}

/// `what`: a command or an option that does not exist.
std::string no_such(const char* what, const std::string& typed, const CLI::App& command, const std::string& help) {
  std::vector<std::string> names;
  if (typed.starts_with("-")) {
    for (const CLI::Option* option : command.get_options())
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  } else {
    for (const CLI::App* each : command.get_subcommands([](const CLI::App*) { return true; }))
      names.push_back(each->get_name());
  }
  const std::string nearest = fmt::format("{}", fmt::join(nearest_names(typed, names, 1), ""));
  return fmt::format("{}: there is no such {}, the nearest is {}; {}", typed, what, nearest, help);
}

std::string sentence(const CLI::App& app, const std::string& program, const CLI::ParseError& e) {
  const CLI::App* command = &app;
  std::string name = program;
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().front();
    name += ' ' + command->get_name();
  }
  const std::string help = fmt::format("see {} --help", name);
  const std::string_view said{e.what()};
  const std::vector<std::string> unknown = app.remaining(true);
  if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::RequiredError)) {
    if (said.find("subcommand") != said.npos)
      return unknown.empty() ? fmt::format("a command is missing; {}", help)
                             : no_such("command", unknown.front(), *command, help);
    const std::string missing{between(said, "", " is required")};
    const CLI::Option* option = command->get_option_no_throw(missing);
    return option == nullptr ? fmt::format("{}; {}", said, help)
                             : fmt::format("{} is missing: {}; {}", missing, option->get_description(), help);
  }
  if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::ExtrasError) && !unknown.empty())
    return unknown.front().starts_with("-") ? no_such("option", unknown.front(), *command, help)
                                            : fmt::format("{}: one argument too many; {}", unknown.front(), help);
  if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::ArgumentMismatch) && said.find("required") != said.npos) {
    const std::string which{said.substr(0, said.find(':'))};
    const CLI::Option* option = command->get_option_no_throw(which);
    const bool repeated = option != nullptr && option->count() > 1;
    return fmt::format("{}: {}; {}", which, repeated ? "it is given more than once" : "its value is missing", help);
  }
  if (e.get_exit_code() == static_cast<int>(CLI::ExitCodes::ConversionError))
    if (const std::string_view pair = between(said, "Could not convert: ", ""); pair.find(" = ") != pair.npos)
      return fmt::format("{} is {}; it must be a number", pair.substr(0, pair.find(" = ")),
                         pair.substr(pair.find(" = ") + 3));
  return std::string{said};
}

void parse(CLI::App& app, const std::string& program, int argc, char** argv) {
  refuse_empty_values(argc, argv);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) throw;
    throw ConfigError{sentence(app, program, e)};
  }
}

}  // namespace

int run_program(CLI::App& app, const std::string& program, int argc, char** argv, const std::function<int()>& body) {
  int status = 0;
  try {
    parse(app, program, argc, argv);
    status = body();
  } catch (const CLI::Success& e) {  // --help, --version, and options that only list
    status = app.exit(e);
  } catch (const ConfigError& e) {
    print_error("{}: {}\n", program, e.what());
    status = 2;
  } catch (const std::exception& e) {
    print_error("{}: {}\n", program, e.what());
    status = 1;
  }
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  if (status != 1) print_error("{}: standard output: not all could be written\n", program);
  return 1;
}

}  // namespace twoport
