#include "lab/study/gallery.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/study/many_runs.h"
#include "lab/study/map.h"

namespace twoport::lab {

Gallery gallery(const GalleryOptions& o, const std::function<void(const Progress&)>& heard) {
  namespace fs = std::filesystem;
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& each : fs::directory_iterator{o.folder, error})
    if (each.path().extension() == ".textproto") files.push_back(each.path());
  if (error)
    throw ConfigError{fmt::format("{}: {}; name a folder of scenes, such as scenes/edge of the source tree", o.folder,
                                  error.message())};
  if (files.empty()) throw ConfigError{fmt::format("{}: no scene (.textproto) in this folder", o.folder)};
  std::sort(files.begin(), files.end());

  check_methods(o.methods, method_names());
  Gallery all{.methods = o.methods.empty() ? method_names() : o.methods, .entries = {}};
  std::vector<Scene> scenes;
  for (const fs::path& file : files) {
    all.entries.push_back({file.stem().string(), std::vector<Summary>(all.methods.size()), {}});
    for (const std::string& method : all.methods) scenes.push_back(load_scene(file.string(), method_overrides(method)));
  }
  Tally tally{scenes.size(), heard};
  run_cells({scenes.size(), 1, [&](std::size_t i) { return scenes[i]; }}, {.jobs = o.jobs}, tally,
            [&](std::size_t i, std::uint64_t, const std::vector<Summary>& of_seeds) {
              all.entries[i / all.methods.size()].summaries[i % all.methods.size()] = of_seeds.front();
            });
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    Gallery::Entry& entry = all.entries[i / all.methods.size()];
    for (std::string& sentence :
         violations({.stable = {}, .at_least = {}, .at_most = {}, .of_method = scenes[i].expect.of_method},
                    entry.summaries[i % all.methods.size()]))
      entry.missed.push_back(std::move(sentence));
  }
  return all;
}

std::string in_a_word(const Summary& s) {
  if (s.verdict_kind() == "UNSTABLE") return "UNSTABLE";
  if (s.verdict_kind() == "STABLE") return s.has_muted_share() && s.muted_share() > 0.5 ? "mute" : "stable";
  return s.verdict_kind() == "RESTLESS" ? "restless" : "undecided";
}

namespace {

void end_line(std::string& text) {
  text.erase(text.find_last_not_of(' ') + 1);
  text += '\n';
}

}  // namespace

std::string to_text(const Gallery& all) {
  std::size_t wide = 5;
  for (const Gallery::Entry& each : all.entries) wide = std::max(wide, each.scene.size());
  std::string out = fmt::format("{:<{}}", "scene", wide);
  for (const std::string& method : all.methods)
    out += fmt::format("  {:<{}}", method, std::max<std::size_t>(9, method.size()));
  end_line(out);
  for (const Gallery::Entry& each : all.entries) {
    out += fmt::format("{:<{}}", each.scene, wide);
    for (std::size_t m = 0; m < all.methods.size(); ++m)
      out += fmt::format("  {:<{}}", in_a_word(each.summaries[m]), std::max<std::size_t>(9, all.methods[m].size()));
    end_line(out);
  }
  return out;
}

Table to_table(const Gallery& all) {
  Table table;
  table.columns = {"scene", "method", "verdict_kind", "word"};
  for (const Figure& figure : map_figures()) table.columns.push_back(figure.name());
  for (const Gallery::Entry& each : all.entries)
    for (std::size_t m = 0; m < all.methods.size(); ++m) {
      const Summary& s = each.summaries[m];
      Values& row = table.rows.emplace_back(Values{each.scene, all.methods[m], s.verdict_kind(), in_a_word(s)});
      for (const Figure& figure : map_figures()) row.push_back(Value::finite(figure.of(s)));
    }
  return table;
}

}  // namespace twoport::lab
