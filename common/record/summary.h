#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/link/mailbox.h"
#include "common/scene/scene.h"
#include "proto/summary.pb.h"

namespace twoport {

/// What a run leaves behind. proto/summary.proto is the one list of its figures, with their meaning; a field there that
/// is marked `optional` and not set is not known of this run.
using Summary = schema::Summary;
using Packets = schema::Packets;
using Percentiles = schema::Percentiles;

/// Fills what every run has: which scene it was of, `side` ("lab", "master", "slave"), architecture, method, size.
void describe_run(const Scene& scene, std::string_view side, Summary& summary);

/// What the receiver of one direction has counted, of `sent`; and datagrams that were none of ours.
Packets packets(std::uint64_t sent, const PacketCounts& receiver, std::uint64_t rejected = 0);

/// Protobuf JSON, zeros and falses printed; what is not known is absent.
std::string to_json(const Summary& summary);

/// Every number of the schema as (name, value), in its order, nested ones as "rtt_ms.p99"; booleans as 0, 1; NaN where
/// it is not known.
std::vector<std::pair<std::string, double>> numbers(const Summary& summary);

/// The texts that a table holds of a run, as (name, text): scene, architecture, method, verdict.
std::vector<std::pair<std::string, std::string>> texts(const Summary& summary);

}  // namespace twoport
