// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "FOUR_CHANNEL", FourChannelMaster, FourChannelSlave, .summary = "positions and forces in both directions",
    .replaces_force_sensor = [](const ControlOptions& o) -> std::string_view {
      return o.four_channel.reaction_force_observer ? "" : "control.passivity.four_channel.reaction_force_observer";
    })
#endif
#ifdef TWOPORT_LAYER_OPTIONS
#include "common/method/transparency/four_channel/options.h"
TWOPORT_LAYER_OPTIONS(four_channel, FourChannelOptions)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/four_channel/four_channel.h"
#endif
