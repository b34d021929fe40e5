#pragma once

#if __has_include(<mm_malloc.h>)  // of x86: declares posix_memalign in clang's way, which must come before ours
#include <mm_malloc.h>
#endif

#include <cerrno>
#include <cstddef>
#include <cstdlib>

#include "common/base/sanitized.h"

/// Counts what this thread allocates. Including this header interposes malloc and its family (and so operator new) in
/// the test program; under a sanitizer, which has its own, it listens to that one's hook instead.
///
///     NoAlloc guard;
///     step();
///     EXPECT_EQ(guard.seen(), 0);
class NoAlloc {
 public:
  NoAlloc() noexcept : before_{count()} {}
  [[nodiscard]] int seen() const noexcept { return count() - before_; }

  static int& count() noexcept {
    static thread_local int allocations = 0;
    return allocations;
  }

 private:
  int before_;
};

#if defined(TWOPORT_ADDRESS_SANITIZER) || defined(TWOPORT_THREAD_SANITIZER)

extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*)(const volatile void*, std::size_t),
                                                         void (*)(const volatile void*));
inline const int no_alloc_hook = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { ++NoAlloc::count(); }, [](const volatile void*) {});

#else

extern "C" {
void* __libc_malloc(std::size_t) noexcept;
void* __libc_calloc(std::size_t, std::size_t) noexcept;
void* __libc_realloc(void*, std::size_t) noexcept;
void* __libc_memalign(std::size_t, std::size_t) noexcept;

[[gnu::used]] inline void* malloc(std::size_t size) noexcept {
  ++NoAlloc::count();
  return __libc_malloc(size);
}
[[gnu::used]] inline void* calloc(std::size_t count, std::size_t size) noexcept {
  ++NoAlloc::count();
  return __libc_calloc(count, size);
}
[[gnu::used]] inline void* realloc(void* old, std::size_t size) noexcept {
  ++NoAlloc::count();
  return __libc_realloc(old, size);
}
[[gnu::used]] inline void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  ++NoAlloc::count();
  return __libc_memalign(alignment, size);
}
[[gnu::used]] inline int posix_memalign(void** out, std::size_t alignment, std::size_t size) noexcept {
  ++NoAlloc::count();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}
}

#endif
