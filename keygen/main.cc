#include <cstdio>
#include <exception>
#include <string>

#include "common/base/check.h"
#include "common/platform/key_file.h"

namespace {

constexpr char kHelp[] =
    "twoport-keygen FILE: a new key for --key FILE of twoport-master and twoport-slave\n\n"
    "FILE must not exist. It gets 64 hexadecimal digits from the system's random generator, readable by its owner "
    "only.\n"
    "Copy it to the other machine over a secured connection (scp), and keep it there as readable by its owner only.\n";

}  // namespace

int main(int argc, char** argv) {
  const std::string argument = argc == 2 ? argv[1] : "";
  if (argument == "-h" || argument == "--help") {
    std::fputs(kHelp, stdout);
    return 0;
  }
  if (argument == "--version") {
    std::puts("twoport-keygen " TWOPORT_VERSION);
    return 0;
  }
  if (argument.empty() || argument.front() == '-') {
    std::fputs("twoport-keygen: one FILE is needed that does not exist yet; see twoport-keygen --help\n", stderr);
    return 2;
  }
  try {
    twoport::make_key_file(argument);
  } catch (const twoport::ConfigError& e) {
    std::fprintf(stderr, "twoport-keygen: %s\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "twoport-keygen: %s\n", e.what());
    return 1;
  }
  return 0;
}
