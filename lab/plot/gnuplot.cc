#include "lab/plot/gnuplot.h"

#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>

namespace twoport::lab {
namespace {

/// Quoted for a shell, which has no escape within single quotes.
std::string shell_word(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
}

bool shell(const std::string& command) {
  return std::system(command.c_str()) == 0;
}

}  // namespace

std::string gnuplot_quoted(std::string_view text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "''" : std::string(1, c);
  return out + "'";
}

std::string gnuplot_pages(const std::string& name, std::size_t width, std::size_t height, int font_size,
                          const std::string& body) {
  const auto page = [&](const char* terminal, const char* ending) {
    return fmt::format(
        "set terminal {} size {},{} font 'DejaVu Sans,{}' background rgb 'white'\n"
        "set output {}\n"
        "set termoption noenhanced\n"
        "set border lc rgb '#505050'\n"
        "set tics textcolor rgb '#202020' nomirror out\n"
        "set grid lc rgb '#e4e4e4'\n"
        "set key top left outside horizontal\n"
        "{}unset output\nreset\n",
        terminal, width, height, font_size, gnuplot_quoted(name + ending), body);
  };
  return "set encoding utf8\n" + page("pngcairo", ".png") + page("svg", ".svg");
}

std::string run_gnuplot(const std::string& folder, const std::string& name) {
  const std::string stem = folder + "/" + name;
  if (!shell("command -v gnuplot > /dev/null 2>&1"))
    return fmt::format("no picture: gnuplot is not installed (apt-get install gnuplot-nox); it would be given {}.gp",
                       stem);
  if (!shell(fmt::format("cd {} && gnuplot {} > {} 2>&1", shell_word(folder), shell_word(name + ".gp"),
                         shell_word(name + ".log"))))
    return fmt::format("no picture: gnuplot failed, {}.log says why", stem);
  std::remove((stem + ".log").c_str());
  return fmt::format("{0}.png, {0}.svg", stem);
}

}  // namespace twoport::lab
