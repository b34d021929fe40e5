#pragma once

#include <span>
#include <string_view>

namespace twoport {

/// A file of the page, held in the program.
struct PageAsset {
  std::string_view path;  ///< "/index.html"
  std::string_view content_type, content;
};
/// All files of the page; empty where the program was built without it.
std::span<const PageAsset> page_assets();
/// Why it was built without the page, in one sentence; empty where it was not.
std::string_view page_is_absent();

}  // namespace twoport
