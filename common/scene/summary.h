#pragma once

#include <cstdint>
#include <string>

#include "common/link/mailbox.h"
#include "common/scene/scene.h"

namespace twoport {

struct Packets {
  std::uint32_t sent = 0, received = 0, lost = 0, late = 0, duplicated = 0, rejected = 0;
};
struct Percentiles {
  double p50 = 0, p99 = 0, p999 = 0, max = 0;
};

/// What a run leaves behind: proto/summary.proto as plain values, same names, same meaning.
struct Summary {
  std::string scene, side, architecture, method;
  int dof = 0;
  double rate_hz = 0, duration_s = 0;
  std::uint32_t steps = 0;
  bool stable = true;
  std::string verdict;
  double min_port_energy_j = 0, initial_energy_j = 0, min_observed_energy_j = 0, energy_owed_j = 0, dissipated_j = 0;
  double position_error_rms_m = 0, drift_m = 0, force_error_rms_n = 0;
  double force_direction_error_max_deg = 0, force_direction_error_rms_deg = 0, chatter_rms_n = 0;
  double max_force_n = 0, contact_s = 0, correction_max_n = 0;
  std::uint32_t corrected_ticks = 0;
  Packets to_slave, to_master;
  Percentiles rtt_ms, loop_lateness_us;
  std::uint32_t deadline_misses = 0;
  double step_ns = 0;
  std::string mode;
  std::uint32_t reconnects = 0;
};

/// What the receiver of one direction has counted, of `sent`; and datagrams that were none of ours.
Packets packets(std::uint64_t sent, const PacketCounts& receiver, std::uint64_t rejected = 0);

/// The architecture and method as a scene writes them, e.g. "POSITION_FORCE".
std::string to_string(Architecture architecture);
std::string to_string(Method method);

/// Protobuf JSON, zeros and falses printed.
std::string to_json(const Summary& summary);

/// Writes `text` to `path` whole or not at all: into a file beside it, then renamed. Throws ConfigError with the
/// path and the reason when it cannot.
void write_whole(const std::string& path, const std::string& text);

/// Every number of the summary as (name, value) in the schema's order, nested ones as "rtt_ms.p99"; booleans as 0, 1.
std::vector<std::pair<std::string, double>> numbers(const Summary& summary);

/// What it says in words of a run in the laboratory, as (name, text): scene, architecture, method, verdict.
std::vector<std::pair<std::string, std::string>> words(const Summary& summary);

/// What the scene promised and the run did not keep: one sentence each, with the key, the value and the bound.
/// Empty: all kept. Throws ConfigError for a key that no summary has.
std::vector<std::string> broken_promises(const ExpectSpec& expect, const Summary& summary);

}  // namespace twoport
