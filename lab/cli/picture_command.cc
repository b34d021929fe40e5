#include <fmt/format.h>

#include <memory>
#include <string>

#include "lab/cli/commands.h"
#include "lab/plot/document_pictures.h"
#include "lab/study/cells.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string name, out;
  int jobs = all_cores();
};

int picture_command(const Arguments& a) {
  make_folder(a.out);
  fmt::print("{}\n", a.name == "torus" ? draw_torus(a.out) : draw_deadband(a.out, a.jobs));
  return 0;
}

}  // namespace

Subcommand add_picture_command(Command app) {
  const auto a = std::make_shared<Arguments>();
  Command picture = app.add("picture", "Run and draw a figure of the documents");
  picture.option("name", a->name, "deadband (docs/reference/network.md) or torus (docs/reference/shapes.md)")
      .one_of({"deadband", "torus"})
      .required();
  picture.option("--out", a->out, "Folder for the picture").required();
  add_jobs(picture, a->jobs);
  return {picture, [a] { return picture_command(*a); }};
}

}  // namespace twoport::lab
