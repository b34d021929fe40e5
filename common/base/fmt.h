#pragma once

#include <fmt/format.h>

// What formats a message is compiled in the library: without this every file that formats into a buffer, or logs, compiles it again,
// for some 6 s. Later versions of the library declare it themselves. Clang spells the name of this function otherwise than g++, which
// compiled the library, so with clang each file keeps its own.
#if FMT_VERSION >= 90000 && FMT_VERSION < 100000 && !defined(FMT_HEADER_ONLY) && !defined(__clang__)
FMT_BEGIN_NAMESPACE
namespace detail {
extern template void vformat_to<char>(buffer<char>&, basic_string_view<char>,
                                      basic_format_args<FMT_BUFFER_CONTEXT(char)>, locale_ref);
}
FMT_END_NAMESPACE
#endif
