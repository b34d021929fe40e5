#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/summary.pb.h"

namespace twoport {

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
