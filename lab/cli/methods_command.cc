#include <fmt/format.h>

#include "common/method/catalogue.h"
#include "lab/cli/commands.h"

namespace twoport::lab {
Subcommand add_methods_command(Command app) {
  Command methods = app.add("methods",
                            "List the methods of control.passivity.method over a link, one a line: name, tab, "
                            "summary. The first is the one of a scene that names none");
  return {methods, [] {
            for_each_method([]<class M>(std::string_view name) { fmt::print("{}\t{}\n", name, M::kSummary); });
            return 0;
          }};
}

}  // namespace twoport::lab
