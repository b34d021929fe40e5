#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/scene/scene.h"

namespace twoport {

/// What a scene is read for. The laboratory needs `duration_s`; a live run may go on until somebody ends it.
enum class SceneFor : std::uint8_t { laboratory, live };

/// A scene file with overrides "PATH=VALUE" applied in order, checked. Every error is a ConfigError whose sentence
/// names file, line and column, or the path, and the value and what is allowed.
/// PATH is dotted (`control.passivity.method`, `environment[0].wall.stiffness_n_per_m`); VALUE is what the text format
/// would hold there, lists included (`[1, 0, 0]`). Setting a field of an absent block creates the block; an index
/// one past the end appends.
/// A scene for a live run may leave `duration_s` out, which is infinity then.
Scene load_scene(const std::string& path, std::span<const std::string> overrides = {},
                 SceneFor whom = SceneFor::laboratory);

/// The same from text; `name` stands for the file in error sentences.
Scene parse_scene(const std::string& text, const std::string& name, std::span<const std::string> overrides = {},
                  SceneFor whom = SceneFor::laboratory);

/// Error sentence if `assignment` has no "=" and is therefore no override of any scene, else empty. For command lines,
/// which would otherwise report the VALUE of `--set PATH VALUE` as a separate argument.
std::string assignment_error(const std::string& assignment);

/// What the nodes must know of the system. Of the device: What gives way to the force: the device, or of an ideal one the hand
/// that holds it. Sets control.handle_mass_kg, handle_inertia_kg_m2 and max_force_n, and control.known.
void tell_system(Scene& scene);

/// E(0) of a scene that does not state control.passivity.initial_energy_j. Of a layer that says so (initial_energy_by_round_trip) the energy that a spring K_c takes over
/// the way that a hand goes behind a surface before the master hears of it:
///
///     E(0) = K_c (v R)²/2,   v = 50 mm/s,   at least 1 mJ, at most 20 mJ
///
/// K_c: the coupling's stiffness in the master's units; R: nominal round trip. Other methods over a link: 1 mJ; RENDER: 0.
Energy default_initial_energy(const ControlOptions& o);

/// Digest of the values that both sides of a link must share (dof, rates, architecture, scales, coupling, passivity):
/// FNV-1a, the same on every machine.
std::uint64_t scene_digest(const Scene& scene);

/// One of these values: the path in the scene, and a digest of it alone.
struct SharedField {
  std::string_view path;
  std::uint64_t digest;
};
/// All of them, in a fixed order.
std::vector<SharedField> shared_fields(const Scene& scene);

namespace schema {
class Scene;
}

/// A scene's text, read once, of which many scenes are made.
class SceneText {
 public:
  /// `name` stands for the file in error sentences; `overrides` are those of every scene. Throws as parse_scene().
  SceneText(const std::string& text, std::string name, std::span<const std::string> overrides = {},
            SceneFor whom = SceneFor::laboratory);

  /// What parse_scene() makes of the text, the overrides of every scene and these, in this order. May be called from several threads at once.
  [[nodiscard]] Scene with(std::span<const std::string> overrides = {}) const;

  /// Do `later` overrides leave what `earlier` ones set? Both are applied after those of every scene.
  [[nodiscard]] bool keeps(std::span<const std::string> earlier, std::span<const std::string> later) const;

 private:
  /// A block that is not in the text, and the override that has created it.
  struct Created {
    std::string block, assignment;
  };
  static void apply(std::span<const std::string> overrides, schema::Scene& message, std::vector<Created>& created);
  [[nodiscard]] Scene read(const std::shared_ptr<const SceneSource>& source, const std::vector<Created>& created) const;

  std::string name_;
  std::shared_ptr<const SceneSource> source_;
  std::vector<Created> created_;
};

}  // namespace twoport
