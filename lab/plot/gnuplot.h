#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace twoport::lab {

// Blue-green and orange: they differ for most eyes, and in grey.
inline constexpr const char *kStableColour = "#2a788e", *kUnstableColour = "#f4a582";

/// In single quotes for gnuplot; the only escape there is a doubled quote.
std::string gnuplot_quoted(std::string_view text);

/// gnuplot's input for the same page twice, NAME.png and NAME.svg, in the style that all pictures share.
std::string gnuplot_pages(const std::string& name, std::size_t width, std::size_t height, int font_size,
                          const std::string& body);

/// Runs FOLDER/NAME.gp. Returns one sentence: what was drawn, or why nothing was.
std::string run_gnuplot(const std::string& folder, const std::string& name);

}  // namespace twoport::lab
