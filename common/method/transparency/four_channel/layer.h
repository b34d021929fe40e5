// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER(
    "FOUR_CHANNEL", FourChannelMaster, FourChannelSlave, .summary = "positions and forces in both directions",
    .replaces_force_sensor = [](const ControlOptions& o) -> std::string_view {
      return o.four_channel.reaction_force_observer ? "" : "control.passivity.four_channel.reaction_force_observer";
    })
#else
#include "common/method/transparency/four_channel/four_channel.h"
#endif
