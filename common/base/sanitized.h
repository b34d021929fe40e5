#pragma once

// The sanitizers that a file is built with: GCC defines a macro for each, clang answers __has_feature.
#ifdef __has_feature
#define TWOPORT_HAS_FEATURE(feature) __has_feature(feature)
#else
#define TWOPORT_HAS_FEATURE(feature) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || TWOPORT_HAS_FEATURE(address_sanitizer)
#define TWOPORT_ADDRESS_SANITIZER
#endif
#if defined(__SANITIZE_THREAD__) || TWOPORT_HAS_FEATURE(thread_sanitizer)
#define TWOPORT_THREAD_SANITIZER
#endif

// All that a function calls becomes a part of it, but not under a sanitizer, where that takes minutes to compile.
#if defined(TWOPORT_ADDRESS_SANITIZER) || defined(TWOPORT_THREAD_SANITIZER)
#define TWOPORT_FLATTEN
#else
#define TWOPORT_FLATTEN [[gnu::flatten]]
#endif

namespace twoport {

#ifdef TWOPORT_ADDRESS_SANITIZER
inline constexpr bool kAddressSanitizer = true;
#else
inline constexpr bool kAddressSanitizer = false;
#endif
#ifdef TWOPORT_THREAD_SANITIZER
inline constexpr bool kThreadSanitizer = true;
#else
inline constexpr bool kThreadSanitizer = false;
#endif
inline constexpr bool kSanitized = kAddressSanitizer || kThreadSanitizer;

}  // namespace twoport
