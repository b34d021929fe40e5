#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/scene/load.h"

namespace twoport {

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
