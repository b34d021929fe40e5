#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/scene/scene.h"

namespace twoport {

/// A scene file with overrides "PATH=VALUE" applied in order, checked. Every error is a ConfigError whose sentence
/// names file, line and column, or the path, and the value and what is allowed.
/// PATH is dotted (`control.passivity.method`, `environment[0].wall.stiffness_n_per_m`); VALUE is what the text format
/// would hold there, lists included (`[1, 0, 0]`). Setting a field of an absent block creates the block; an index
/// one past the end appends.
Scene load_scene(const std::string& path, std::span<const std::string> overrides = {});

/// The same from text; `name` stands for the file in error sentences.
Scene parse_scene(const std::string& text, const std::string& name, std::span<const std::string> overrides = {});

/// Why `assignment` is no override whatever the scene: it has no "=". Empty: it may be one. For command lines, which would
/// otherwise refuse the VALUE of `--set PATH VALUE` as an argument of its own.
std::string assignment_error(const std::string& assignment);

/// The mass that answers the force at the master, as its controller may know it: the device, or of an ideal one the hand that
/// holds it. Sets control.handle_mass_kg and handle_inertia_kg_m2.
void tell_handle(Scene& scene);

/// The two sides of a link must mean the same world: FNV-1a over what both must share (dof, rates, architecture,
/// scales, coupling, passivity), the same on every machine.
std::uint64_t scene_digest(const Scene& scene);

}  // namespace twoport
