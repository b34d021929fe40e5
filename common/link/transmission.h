#pragma once

#include <optional>

#include "common/link/impairment.h"

namespace twoport {

/// Perceptual deadband of one direction (common/link/deadband.h).
struct DeadbandOptions {
  double ratio = 0.1;  ///< Weber fraction
  double position_m = 2e-4, velocity_m_per_s = 5e-3, force_n = 0.05;
  double energy_j = 1e-4;
  double silence_s = 0.02;  ///< a packet is sent at least this often
};

/// What the two sides of one direction do with its packets, beside what the network does to them.
struct TransmissionOptions {
  double playout_s = 0.0;  ///< 0: each packet is used when it arrives
  std::optional<DeadbandOptions> deadband{};
};

/// The network with the wait in the playout buffer: for whoever needs the delays that a packet may have on its way.
inline ImpairmentOptions with_playout(ImpairmentOptions network, const TransmissionOptions& transmission) {
  network.delay_s += transmission.playout_s;
  for (DelayStep& step : network.delay_step) step.delay_s += transmission.playout_s;
  for (double& delay : network.recorded_delay_s) delay += transmission.playout_s;
  return network;
}

}  // namespace twoport
