#pragma once

#include <string>

namespace CLI {
class App;
}

namespace twoport {

/// Parses the command line of `program` into `app`. Usage that is wrong is a ConfigError with a sentence: what is missing, unknown or empty, and
/// where help is. No option takes an empty value. --help and --version are CLI::Success, as CLI11 throws it.
void parse_arguments(CLI::App& app, const std::string& program, int argc, char** argv);

}  // namespace twoport
