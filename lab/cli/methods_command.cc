#include <fmt/format.h>

#include "common/method/catalogue.h"
#include "lab/cli/commands.h"

namespace twoport::lab {
namespace {

template <class... Each>
void print_methods(TypeList<Each...>) {
  const auto print_one = []<class M>() {
    for (const std::string_view name : M::kNames) fmt::print("{}\t{}\n", name, M::kSummary);
  };
  (print_one.template operator()<Each>(), ...);
}

}  // namespace

Subcommand add_methods_command(CLI::App& app) {
  CLI::App* methods =
      app.add_subcommand("methods",
                         "List the methods of control.passivity.method over a link, one a line: name, tab, "
                         "summary. The first is the one of a scene that names none");
  return {methods, [] {
            print_methods(Methods{});
            return 0;
          }};
}

}  // namespace twoport::lab
