#pragma once

// Included by a lane unit inside its namespace, with TWOPORT_LANES defined.

typedef double V __attribute__((vector_size(8 * TWOPORT_LANES)));
typedef std::uint64_t U __attribute__((vector_size(8 * TWOPORT_LANES)));
using M = decltype(V{} < V{});  // all bits of a lane set, or none
static constexpr int kLanes = TWOPORT_LANES;

static inline V all(double a) {
  return a - V{};
}
static inline V select(M m, V a, V b) {
  return m ? a : b;
}
/// std::min and std::max, which of the two they return included.
static inline V least(V a, V b) {
  return b < a ? b : a;
}
static inline V most(V a, V b) {
  return a < b ? b : a;
}
static inline V clamp(V x, V low, V high) {
  return x < low ? low : high < x ? high : x;
}
static inline V absolute(V a) {
  return (V)((U)a & 0x7fffffffffffffff);
}
static inline V one_if(M m) {
  return (V)((U)m & (U)all(1.0));
}
#if TWOPORT_LANES == 8
static inline V root(V a) {
  return (V)_mm512_sqrt_pd((__m512d)a);
}
static inline unsigned bits(M m) {
  return (unsigned)_mm512_movepi64_mask((__m512i)m);
}
#elif TWOPORT_LANES == 4
static inline V root(V a) {
  return (V)_mm256_sqrt_pd((__m256d)a);
}
static inline unsigned bits(M m) {
  return (unsigned)_mm256_movemask_pd((__m256d)m);
}
#elif defined(__SSE2__)
static inline V root(V a) {
  return (V)_mm_sqrt_pd((__m128d)a);
}
static inline unsigned bits(M m) {
  return (unsigned)_mm_movemask_pd((__m128d)m);
}
#else
static inline V root(V a) {
  return V{__builtin_sqrt(a[0]), __builtin_sqrt(a[1])};
}
static inline unsigned bits(M m) {
  return (m[0] != 0 ? 1U : 0U) | (m[1] != 0 ? 2U : 0U);
}
#endif
static inline bool any(M m) {
  return bits(m) != 0;
}

/// common/base/random.h: uniform in (0, 1).
static inline V uniform(V random, unsigned purpose) {
  constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15;
  U z = (U)random + kGamma * purpose;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  z = z ^ (z >> 31);
  // 52 bits as the fraction of 2^52, exactly.
  const V number = (V)((z >> 12) | 0x4330000000000000) - 0x1.0p52;
  return (number + 0.5) * 0x1.0p-52;
}
static inline V next_packet(V random) {
  return (V)((U)random + 0x9e3779b97f4a7c15 * 16);
}

/// Where m: `to` = a.
static inline void set(M m, V& to, V a) {
  to = select(m, a, to);
}
static inline V positive(V a) {
  return select(a > 0.0, a, V{});
}

/// A vector in each lane, with the operators of the laboratory's.
template <int N>
using Vec = Array<V, N>;
#define TWOPORT_EACH(expression)                   \
  Vec<N> out;                                      \
  for (int i = 0; i < N; ++i) out[i] = expression; \
  return out
template <int N>
static inline Vec<N> operator+(Vec<N> a, Vec<N> b) {
  TWOPORT_EACH(a[i] + b[i]);
}
template <int N>
static inline Vec<N> operator+(Vec<N> a, double b) {
  TWOPORT_EACH(a[i] + b);
}
template <int N>
static inline Vec<N> operator-(Vec<N> a, Vec<N> b) {
  TWOPORT_EACH(a[i] - b[i]);
}
template <int N>
static inline Vec<N> operator-(Vec<N> a) {
  TWOPORT_EACH(-a[i]);
}
template <int N>
static inline Vec<N> operator*(V a, Vec<N> b) {
  TWOPORT_EACH(a * b[i]);
}
template <int N>
static inline Vec<N> operator/(Vec<N> a, V b) {
  TWOPORT_EACH(a[i] / b);
}
template <int N>
static inline Vec<N> select(M m, Vec<N> a, Vec<N> b) {
  TWOPORT_EACH(select(m, a[i], b[i]));
}
template <int N>
static inline Vec<N> vector_at(const V* from) {
  TWOPORT_EACH(from[i]);
}
#undef TWOPORT_EACH
template <int N>
static inline void operator+=(Vec<N>& a, Vec<N> b) {
  a = a + b;
}
template <int N>
static inline void set(M m, Vec<N>& to, Vec<N> a) {
  to = select(m, a, to);
}
/// The order of a sum over axes is that of the laboratory's vectors.
template <int N>
static inline V dot(Vec<N> a, Vec<N> b) {
  if constexpr (N == 1) {
    return a[0] * b[0];
  } else {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  }
}
template <int N>
static inline V norm2(Vec<N> a) {
  return dot(a, a);
}
template <int N>
static inline V norm(Vec<N> a) {
  return root(norm2(a));
}
/// Eigen's normalize().
template <int N>
static inline Vec<N> normalized(Vec<N> a) {
  const V z = norm2(a);
  return select(z > 0.0, a / root(z), a);
}
/// largest_feasible_scale: q, b, a.
static inline V feasible_scale(V q, V b, V a) {
  const V inner = b * b + 4.0 * q * a, square = root(select(inner > 0.0, inner, V{}));
  const V scale = select(b <= 0.0, (square - b) / (2.0 * q), 2.0 * a / (square + b));
  return select(q + b <= a, all(1.0), clamp(scale, V{}, all(1.0)));
}
