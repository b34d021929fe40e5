#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/link/clock_offset.h"
#include "common/link/mailbox.h"
#include "common/link/rejected.h"
#include "common/record/verdict.h"
#include "common/safety/limits.h"
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

/// `n` as a summary holds it: 2^32 - 1 also stands for more.
std::uint32_t count(std::uint64_t n);

/// What the receiver of one direction has counted, and datagrams `rejected` below it. What was sent is not known here.
Packets received_packets(const PacketCounts& receiver, Rejected rejected = {});

/// What `counts` says of the own hardware.
schema::LimitsOfPort limits_of_device(const LimitCounts& counts);
schema::LimitsOfPort limits_of_robot(const LimitCounts& counts);
schema::LimitsOfPeer limits_of_peer(const LimitCounts& counts);

schema::ClockEstimate clock_estimate(const ClockFigures& clock);

/// Adds to the verdict's text where the sampled coupling has given the robot more than `granted`, what its account starts
/// with, and rounding.
void say_if_coupling_feeds(Summary& summary, Energy granted);

/// What `gripper`, the summary of its coupling, says of the figures that `summary.gripper` has.
void fill_gripper(const Summary& gripper, Summary& summary);

/// `stable`, `verdict` and `verdict_kind`.
void set_verdict(const Verdict& verdict, Summary& summary);

/// Protobuf JSON, zeros and falses printed; what is not known is absent.
std::string to_json(const Summary& summary);

/// Leaves `summary` as summary.json in `folder`, on stdout where that is empty. One that cannot be written goes to stdout, so
/// that no result is lost, and the IoError or ConfigError that says why is thrown.
void leave_summary(const Summary& summary, const std::string& folder);

/// Every number of the schema as (name, value), in its order, nested ones as "rtt_ms.p99"; booleans as 0, 1; NaN for what is not known.
std::vector<std::pair<std::string, double>> numbers(const Summary& summary);

/// The texts that a table holds of a run, as (name, text): scene, architecture, method, verdict_kind, verdict.
std::vector<std::pair<std::string, std::string>> texts(const Summary& summary);

/// What the scene expects and the run did not meet: one sentence each, with the key, the value and the bound. Empty: all
/// is met. An UNDECIDED run meets neither `stable: true` nor `stable: false`. Throws ConfigError for a key that no summary
/// has.
std::vector<std::string> violations(const ExpectSpec& expect, const Summary& summary);

/// A number of the summary's schema, found by its name once: "drift_m", nested "rtt_ms.p99"; or of a layer (kLayerFigures). Booleans are 0
/// and 1.
class Figure {
 public:
  /// Every one, in the order of the schema.
  static const std::vector<Figure>& all();
  /// Null where none has this name.
  static const Figure* find(std::string_view name);
  /// Throws ConfigError where none has this name.
  static const Figure& named(std::string_view name);

  [[nodiscard]] const std::string& name() const { return name_; }
  /// Nothing where it is not known of the run.
  [[nodiscard]] std::optional<double> known_of(const schema::Summary& summary) const;
  /// NaN where it is not known of the run.
  [[nodiscard]] double of(const schema::Summary& summary) const;

 private:
  using Path = std::vector<const google::protobuf::FieldDescriptor*>;
  Figure(std::string name, Path path);
  static void add(const google::protobuf::Descriptor& of, const std::string& prefix, const Path& path,
                  std::vector<Figure>& all);

  std::string name_;
  Path path_;  ///< empty: a figure of a layer that the schema does not name
};

/// A figure of a layer: the field of its name where the schema has one, else an entry of `layer_figures`.
void set_layer_figure(schema::Summary& summary, std::string_view name, double value);

}  // namespace twoport
