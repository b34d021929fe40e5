#include <fmt/format.h>

#include <memory>

#include "common/coupling/layers.h"
#include "lab/cli/commands.h"

namespace twoport::lab {

void add_methods_command(CLI::App& app, Chosen& chosen) {
  CLI::App& methods =
      *app.add_subcommand("methods",
                          "List the methods of control.passivity.method over a link, one a line: name, tab, summary. "
                          "The first is the one of a scene that names none");
  const auto layers = std::make_shared<bool>(false);
  methods.add_flag(
      "--layers", *layers,
      "List the layers that control.transparency.layer and control.passivity.layer name: kind, tab, name, "
      "tab, of passivity layers the ports that they bound (none; hand; both; hand, both) and a tab, summary");
  methods.callback([layers, &chosen] {
    chosen = [layers] {
      if (!*layers) {
        for (const MethodName& each : kMethods) fmt::print("{}\t{}\n", each.name, each.summary);
        return 0;
      }
      for (const TransparencyLayerName& each : kTransparencyLayers)
        fmt::print("transparency\t{}\t{}\n", each.name, each.summary);
      for (const PassivityLayerName& each : kPassivityLayers)
        fmt::print("passivity\t{}\t{}\t{}\n", each.name, to_string(*each.claim), each.summary);
      return 0;
    };
  });
}

}  // namespace twoport::lab
