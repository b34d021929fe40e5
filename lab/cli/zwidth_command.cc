#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "lab/cli/commands.h"
#include "lab/plot/zwidth_picture.h"
#include "lab/study/parallel.h"
#include "lab/study/zwidth.h"

namespace twoport::lab {
namespace {

int zwidth_command(const ZWidthOptions& options) {
  const ZWidth z = z_width(options, show_progress);
  std::fputs(to_text(z).c_str(), stdout);
  if (options.out.empty()) return 0;
  fmt::print("{}\n", draw(z, options.out));
  return 0;
}

}  // namespace

Subcommand add_zwidth_command(CLI::App& app) {
  const auto options = std::make_shared<ZWidthOptions>();
  options->jobs = all_cores();
  CLI::App* zwidth =
      app.add_subcommand("zwidth", "Map the stiffness and damping that a scene displays stably, with theory");
  add_scene(zwidth, options->scene, options->set);
  zwidth->get_option("scene")->description("Scene file (.textproto): one axis, RENDER, one wall or spring");
  zwidth->add_option("--damping", options->damping, "Values of B [N s/m], as for --vary")->capture_default_str();
  zwidth->add_option("--stiffness", options->stiffness, "Values of K [N/m], from small to large")
      ->capture_default_str();
  zwidth->add_option("--methods", options->methods, "Controllers; one map per controller")->capture_default_str();
  add_jobs(zwidth, options->jobs);
  zwidth->add_option("--out", options->out, "Folder for table.csv, the map, and the cells finished so far");
  return {zwidth, [options] { return zwidth_command(*options); }};
}

}  // namespace twoport::lab
