// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "PLUGIN", PluginMaster, DelayedForceSlave, .summary = "a force computed by a shared library", .is_external = true,
    .refusal = [](const ControlOptions& o) -> std::string_view {
      return o.plugin.file.empty() ? "control.transparency.plugin.file is absent; PLUGIN needs it" : "";
    })
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/plugin/options.h"
TWOPORT_LAYER_OPTIONS(plugin, PluginOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/delayed_force/delayed_force.h"
#include "common/method/transparency/plugin/plugin.h"
#endif
