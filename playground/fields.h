#pragma once

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
  if constexpr (kFields<T> == 1) {
    auto& [v1] = of;
    return see(v1);
  }
  if constexpr (kFields<T> == 2) {
    auto& [v1, v2] = of;
    return see(v1, v2);
  }
  if constexpr (kFields<T> == 3) {
    auto& [v1, v2, v3] = of;
    return see(v1, v2, v3);
  }
  if constexpr (kFields<T> == 4) {
    auto& [v1, v2, v3, v4] = of;
    return see(v1, v2, v3, v4);
  }
  if constexpr (kFields<T> == 5) {
    auto& [v1, v2, v3, v4, v5] = of;
    return see(v1, v2, v3, v4, v5);
  }
  if constexpr (kFields<T> == 6) {
    auto& [v1, v2, v3, v4, v5, v6] = of;
    return see(v1, v2, v3, v4, v5, v6);
  }
  if constexpr (kFields<T> == 7) {
    auto& [v1, v2, v3, v4, v5, v6, v7] = of;
    return see(v1, v2, v3, v4, v5, v6, v7);
  }
  if constexpr (kFields<T> == 8) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8);
  }
  if constexpr (kFields<T> == 9) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9);
  }
  if constexpr (kFields<T> == 10) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10);
  }
  if constexpr (kFields<T> == 11) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11);
  }
  if constexpr (kFields<T> == 12) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12);
  }
  if constexpr (kFields<T> == 13) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13);
  }
  if constexpr (kFields<T> == 14) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14);
  }
  if constexpr (kFields<T> == 15) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15);
  }
  if constexpr (kFields<T> == 16) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16);
  }
  if constexpr (kFields<T> == 17) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17);
  }
  if constexpr (kFields<T> == 18) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18);
  }
  if constexpr (kFields<T> == 19) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19);
  }
  if constexpr (kFields<T> == 20) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20);
  }
  if constexpr (kFields<T> == 21) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21);
  }
  if constexpr (kFields<T> == 22) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22);
  }
  if constexpr (kFields<T> == 23) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23] =
        of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22,
               v23);
  }
  if constexpr (kFields<T> == 24) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24);
  }
  if constexpr (kFields<T> == 25) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25);
  }
  if constexpr (kFields<T> == 26) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26);
  }
  if constexpr (kFields<T> == 27) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27);
  }
  if constexpr (kFields<T> == 28) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28);
  }
  if constexpr (kFields<T> == 29) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29);
  }
  if constexpr (kFields<T> == 30) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30);
  }
  if constexpr (kFields<T> == 31) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31);
  }
  if constexpr (kFields<T> == 32) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32);
  }
  if constexpr (kFields<T> == 33) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33);
  }
  if constexpr (kFields<T> == 34) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34);
  }
  if constexpr (kFields<T> == 35) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35);
  }
  if constexpr (kFields<T> == 36) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36);
  }
  if constexpr (kFields<T> == 37) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37);
  }
  if constexpr (kFields<T> == 38) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38);
  }
  if constexpr (kFields<T> == 39) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38, v39] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38, v39);
  }
  if constexpr (kFields<T> == 40) {
    auto& [v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
           v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38, v39, v40] = of;
    return see(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15, v16, v17, v18, v19, v20, v21, v22, v23,
               v24, v25, v26, v27, v28, v29, v30, v31, v32, v33, v34, v35, v36, v37, v38, v39, v40);
  }
}

}  // namespace twoport::playground
