#pragma once

#include <string>

#include "common/base/check.h"
#include "common/base/vector.h"

/// X(N, ...) for each number of degrees of freedom N of this build. A build for one scene (CMake: -D TWOPORT_DOF=3) gives another list.
#ifndef TWOPORT_EACH_DOF
#define TWOPORT_EACH_DOF(X, ...) X(1, __VA_ARGS__) X(3, __VA_ARGS__) X(6, __VA_ARGS__) X(8, __VA_ARGS__)
#endif
/// Of a class template of N: that it is compiled elsewhere for each; and in that file.
#define TWOPORT_DECLARE(Class) TWOPORT_EACH_DOF(TWOPORT_DECLARE_FOR, Class) static_assert(true)
#define TWOPORT_DECLARE_FOR(N, Class) extern template class Class<N>;
#define TWOPORT_COMPILE(Class) TWOPORT_EACH_DOF(TWOPORT_COMPILE_FOR, Class) static_assert(true)
#define TWOPORT_COMPILE_FOR(N, Class) template class Class<N>;

namespace twoport {

[[nodiscard]] static constexpr bool built_for(int dof) {
#define TWOPORT_IS_DOF(N, ...) || dof == N
  return false TWOPORT_EACH_DOF(TWOPORT_IS_DOF);
#undef TWOPORT_IS_DOF
}

/// Throws ConfigError where this build has no code for `dof` degrees of freedom. `name`: of the number.
static inline void check_built_for(int dof, const std::string& name = "dof") {
  if (!built_for(dof))
    throw ConfigError{name + " is " + std::to_string(dof) +
                      ", which this program is not built for; scripts/build builds it for all"};
}

/// Calls `use.operator()<N>()` with N = dof. Throws as check_built_for.
template <class Use>
auto for_dof(int dof, Use use) {
  check_built_for(dof);
#define TWOPORT_CALL(N, ...) \
  if (dof == N) return use.template operator()<N>();
  TWOPORT_EACH_DOF(TWOPORT_CALL)
#undef TWOPORT_CALL
  throw ConfigError{"dof must be 1, 3, 6 or that of joints"};
}

/// The same for what knows ports of handle and tool only; `what`, the beginning of the refusal.
template <class Use>
auto for_cartesian_dof(int dof, const std::string& what, Use use) {
#define TWOPORT_CALL(N, ...)     \
  if constexpr (N != kJointPort) \
    if (dof == N) return use.template operator()<N>();
  TWOPORT_EACH_DOF(TWOPORT_CALL)
#undef TWOPORT_CALL
  check_built_for(dof);
  throw ConfigError{what + ": space is JOINTS; it must be CARTESIAN here"};
}

}  // namespace twoport
