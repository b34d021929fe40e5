#pragma once

#include <functional>
#include <string>

namespace CLI {
class App;
}

namespace twoport {

/// Parses the command line of `program` into `app`, runs `body`, and returns the exit status: that of `body`; 2 with a sentence of a
/// ConfigError, as of usage that is wrong: what is missing, unknown or empty, and where help is; 1 with that of another
/// exception, or where standard output takes not all. No option takes an empty value.
int run_program(CLI::App& app, const std::string& program, int argc, char** argv, const std::function<int()>& body);

}  // namespace twoport
