#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <optional>

#include "lab/cli/commands.h"
#include "lab/lanes/lanes.h"
#include "lab/plot/pictures.h"
#include "lab/study/parallel.h"
#include "lab/study/zwidth.h"

namespace twoport::lab {
namespace {

int zwidth_command(ZWidthOptions options, const std::optional<int>& lanes) {
  options.lanes = checked_lanes(lanes.value_or(0));
  const ZWidth z = z_width(options, show_progress);
  if (lanes) say_lanes(z.table.use);
  std::fputs(to_text(z).c_str(), stdout);
  if (options.out.empty()) return 0;
  fmt::print("{}\n", draw(z, options.out));
  return 0;
}

}  // namespace

void add_zwidth_command(CLI::App& app, Chosen& chosen) {
  const auto options = std::make_shared<ZWidthOptions>();
  const auto lanes = std::make_shared<std::optional<int>>();
  CLI::App& zwidth =
      *app.add_subcommand("zwidth", "Map the stiffness and damping that a scene displays stably, with theory");
  add_scene(zwidth, options->scene, options->set);
  zwidth.get_option("scene")->description("Scene file (.textproto): one axis, RENDER, one wall or spring");
  zwidth.add_option("--damping", options->damping, "Values of B [N s/m], as for --vary")->capture_default_str();
  zwidth.add_option("--stiffness", options->stiffness, "Values of K [N/m], from small to large")->capture_default_str();
  zwidth.add_option("--methods", options->methods, "Controllers; one map per controller")->capture_default_str();
  add_jobs(zwidth, options->jobs);
  add_lanes(zwidth, *lanes);
  zwidth.add_option("--out", options->out, "Folder for table.csv, the map, and the cells finished so far");
  zwidth.callback(
      [options, lanes, &chosen] { chosen = [options, lanes] { return zwidth_command(*options, *lanes); }; });
}

}  // namespace twoport::lab
