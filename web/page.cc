#include "common/page/describe.h"

// TWOPORT_PAGE_FILE: dist/index.html.
asm(".pushsection .rodata\n"
    ".global twoport_page_begin, twoport_page_end\n"
    "twoport_page_begin:\n"
    ".incbin \"" TWOPORT_PAGE_FILE
    "\"\n"
    "twoport_page_end:\n"
    ".byte 0\n"
    ".popsection\n");
extern "C" const char twoport_page_begin[], twoport_page_end[];

namespace twoport {

std::string_view page_html() {
  return {twoport_page_begin, static_cast<std::size_t>(twoport_page_end - twoport_page_begin)};
}

}  // namespace twoport
