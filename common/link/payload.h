#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>

#include "common/base/vector.h"

namespace twoport {

/// Most numbers of a method in a packet of a port of size N.
template <int N>
inline constexpr std::size_t kMostWords = N == kJointPort ? 40 : 24;

/// The method's numbers in a packet, flat: `count` of them, the rest unset. Bit i of `totals` marks number i of the first 32 as a
/// running total. Copies transfer only the numbers in use.
struct Words {
  static constexpr std::size_t kMost = kMostWords<kJointPort>;

  std::uint32_t totals = 0;
  std::uint8_t count = 0;
  std::array<double, kMost> at;

  Words() noexcept {}  // `at` stays unset: filling it in every packet would cost more than the rest of a tick
  Words(const Words& o) noexcept { copy(o); }
  Words& operator=(const Words& o) noexcept {
    copy(o);
    return *this;
  }

  void clear() noexcept { totals = 0, count = 0; }

  [[nodiscard]] double sum() const noexcept {
    double s = 0.0;
    for (std::size_t i = 0; i < count; ++i) s += at[i];
    return s;
  }

  /// Merges received words: all numbers of a newer packet, only running totals of an older one; a total never falls. A newer packet
  /// without words leaves none: the other side's method has begun anew, and what it said before is of another coupling.
  void merge(const Words& arrived, bool newer) noexcept {
    if (arrived.count != 0) [[unlikely]]
      merge_numbers(arrived, newer);
    else if (newer)
      count = 0;
  }

 private:
  void merge_numbers(const Words& arrived, bool newer) noexcept {
    if (arrived.count != count) {
      if (newer) *this = arrived;
      return;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const bool total = i < 32 && (totals >> i & 1U) != 0;
      if (total) {
        at[i] = std::max(at[i], arrived.at[i]);
      } else if (newer) {
        at[i] = arrived.at[i];
      }
    }
  }
  void copy(const Words& o) noexcept {
    totals = o.totals, count = o.count;
    if (count != 0) [[unlikely]]
      std::copy_n(o.at.begin(), count, at.begin());
  }
};

/// A quantity of which the newest value counts: a position, a force.
template <class T>
struct Latest {
  T value{};
};
/// A monotonic quantity: an energy since the session began. A lost packet delays it, a late or repeated one cannot
/// lower it.
struct RunningTotal {
  double value = 0.0;
};

namespace payload {

inline double* put(double* to, double v) noexcept {
  *to = v;
  return to + 1;
}
template <class Kind, int N>
double* put(double* to, const Coords<Kind, N>& c) noexcept {
  return std::copy_n(c.vec().data(), N, to);
}
template <int N>
double* put(double* to, const Position<N>& x) noexcept {
  to = std::copy_n(x.translation().data(), x.translation().size(), to);
  if constexpr (N == 6)
    for (const double q : {x.attitude().w(), x.attitude().x(), x.attitude().y(), x.attitude().z()}) *to++ = q;
  return to;
}
template <class T>
void put(Words& w, const T& v) noexcept {
  w.count = static_cast<std::uint8_t>(put(w.at.data() + w.count, v) - w.at.data());
}
template <class T>
void put(Words& w, const Latest<T>& field) noexcept {
  put(w, field.value);
}
inline void put(Words& w, const RunningTotal& field) noexcept {
  w.totals |= 1U << w.count;
  put(w, field.value);
}

inline const double* take(const double* from, double& v) noexcept {
  v = *from;
  return from + 1;
}
template <class Kind, int N>
const double* take(const double* from, Coords<Kind, N>& c) noexcept {
  c = Coords<Kind, N>{Eigen::Map<const typename Coords<Kind, N>::Vector>{from}};
  return from + N;
}
template <int N>
const double* take(const double* from, Position<N>& x) noexcept {
  if constexpr (N == 6) {
    x = Position<6>{Eigen::Map<const Eigen::Vector3d>{from}, {from[3], from[4], from[5], from[6]}};
    return from + 7;
  } else {
    x = Position<N>{Eigen::Map<const typename Position<N>::Vector>{from}};
    return from + N;
  }
}
template <class T>
const double* take(const double* from, Latest<T>& field) noexcept {
  return take(from, field.value);
}
inline const double* take(const double* from, RunningTotal& field) noexcept {
  return take(from, field.value);
}

/// Words of a field, and whether it is of eight joints.
template <class T>
struct Size {
  static constexpr std::size_t words = 1;
  static constexpr bool of_joints = false;
};
template <class Kind, int N>
struct Size<Coords<Kind, N>> {
  static constexpr std::size_t words = N;
  static constexpr bool of_joints = N == kJointPort;
};
template <int N>
struct Size<Position<N>> {
  static constexpr std::size_t words = N == 6 ? 7 : N;
  static constexpr bool of_joints = N == kJointPort;
};
template <class T>
struct Size<Latest<T>> : Size<T> {};

template <class... Field>
constexpr bool fits(const std::tuple<Field&...>*) {
  return (Size<std::remove_const_t<Field>>::words + ... + 0) <=
         ((Size<std::remove_const_t<Field>>::of_joints || ...) ? kMostWords<kJointPort> : kMostWords<1>);
}

}  // namespace payload

/// Writes a method's payload to a packet: a struct of Latest and RunningTotal fields that lists them:
///
///     template <int N> struct MyToMaster {
///       Latest<Force<N>> f;
///       RunningTotal energy_in;
///       auto fields() { return std::tie(f, energy_in); }
///     };
template <class Payload>
void write(Payload p, Words& to) noexcept {
  static_assert(payload::fits(static_cast<decltype(p.fields())*>(nullptr)), "a payload has at most kMostWords words");
  to.count = 0, to.totals = 0;
  std::apply([&](const auto&... field) { (payload::put(to, field), ...); }, p.fields());
}
/// Reads a payload. False, with `p` unchanged, if the number of words differs: nothing has arrived yet, or the words
/// are of another method.
template <class Payload>
bool read(const Words& from, Payload& p) noexcept {
  Words shape;
  write(p, shape);
  if (shape.count != from.count || shape.totals != from.totals) return false;
  const double* at = from.at.data();
  std::apply([&](auto&... field) { ((at = payload::take(at, field)), ...); }, p.fields());
  return true;
}

}  // namespace twoport
