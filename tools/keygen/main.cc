#include <CLI/CLI.hpp>
#include <string>

#include "common/platform/arguments.h"
#include "common/platform/key_file.h"

int main(int argc, char** argv) {
  CLI::App app{"twoport-keygen: a new key for --key FILE of twoport-master and twoport-slave"};
  app.set_version_flag("--version", "twoport-keygen " TWOPORT_VERSION);
  std::string file;
  app.add_option("FILE", file, "New file for the key")->required();
  app.footer(
      "FILE gets 64 hexadecimal digits from the system's random generator, readable by its owner only. Copy it to the "
      "other machine over a secured connection (scp), and keep it there as readable by its owner only.");
  return twoport::run_program(app, "twoport-keygen", argc, argv, [&] {
    twoport::make_key_file(file);
    return 0;
  });
}
