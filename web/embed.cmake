# Writes OUT, a C++ file that holds the files of DIST; with ABSENT_FILE it holds none, and the sentence in that file.
set(symbols "")
set(table "")
set(text "")
if(ABSENT_FILE)
  file(READ ${ABSENT_FILE} text)
else()
  file(GLOB_RECURSE files RELATIVE ${DIST} ${DIST}/*)
  set(i 0)
  foreach(file IN LISTS files)
    set(type application/octet-stream)
    if(file MATCHES "\\.html$")
      set(type "text/html; charset=utf-8")
    elseif(file MATCHES "\\.js$")
      set(type "text/javascript; charset=utf-8")
    elseif(file MATCHES "\\.css$")
      set(type "text/css; charset=utf-8")
    elseif(file MATCHES "\\.svg$")
      set(type image/svg+xml)
    elseif(file MATCHES "\\.txt$")
      set(type "text/plain; charset=utf-8")
    endif()
    string(APPEND symbols "asm(\".pushsection .rodata\\n.global twoport_page_${i}\\n.global twoport_page_${i}_end\\n\"\n"
           "    \"twoport_page_${i}:\\n.incbin \\\"${DIST}/${file}\\\"\\ntwoport_page_${i}_end:\\n.byte 0\\n.popsection\\n\");\n"
           "extern \"C\" const char twoport_page_${i}[], twoport_page_${i}_end[];\n")
    string(APPEND table "      {\"/${file}\", \"${type}\",\n"
           "       {twoport_page_${i}, static_cast<std::size_t>(twoport_page_${i}_end - twoport_page_${i})}},\n")
    math(EXPR i "${i} + 1")
  endforeach()
endif()
set(content "#include <cstddef>\n#include <vector>\n\n#include \"common/page/assets.h\"\n\n${symbols}
namespace twoport {

std::span<const PageAsset> page_assets() {
  static const std::vector<PageAsset> all{
${table}  };
  return all;
}
std::string_view page_is_absent() {
  return \"${text}\";
}

}  // namespace twoport
")
file(WRITE ${OUT} "${content}")
