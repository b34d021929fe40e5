#pragma once

#include <boost/preprocessor/repetition/enum_params.hpp>
#include <boost/preprocessor/repetition/repeat_from_to.hpp>
#include <cstddef>

namespace twoport::playground {

/// Stands for any value when the fields of a struct are counted.
struct AnyValue {
  template <class T>
  operator T() const noexcept;  // NOLINT(google-explicit-constructor)
};
template <class T, class... Values>
consteval std::size_t count_fields() {
  if constexpr (requires { T{Values{}..., AnyValue{}}; }) {
    return count_fields<T, Values..., AnyValue>();
  } else {
    return sizeof...(Values);
  }
}
/// Number of fields of a struct without a base class.
template <class T>
inline constexpr std::size_t kFields = count_fields<T>();

/// Calls see(field...) with all fields of a struct. C++20 has no bindings of any number, so there is a
/// branch for each.
template <class T, class See>
void with_fields(T& of, See see) {
  static_assert(kFields<T> >= 1 && kFields<T> <= 40);
#define TWOPORT_BRANCH(z, count, unused)         \
  if constexpr (kFields<T> == count) {           \
    auto& [BOOST_PP_ENUM_PARAMS(count, v)] = of; \
    return see(BOOST_PP_ENUM_PARAMS(count, v));  \
  }
  BOOST_PP_REPEAT_FROM_TO(1, 41, TWOPORT_BRANCH, )
#undef TWOPORT_BRANCH
}

}  // namespace twoport::playground
