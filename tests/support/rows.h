#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/record/row.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"

namespace twoport::test {

template <int N>
using Rows = std::vector<Row<N>>;

/// All rows of a simulation.
template <int N>
Rows<N> rows(lab::Simulation<N>& simulation) {
  Rows<N> all;
  simulation.run([&](const Row<N>& row) {
    all.push_back(row);
    return true;
  });
  return all;
}
template <int N>
Rows<N> rows(const Scene& scene) {
  return rows<N>(*lab::make_simulation<N>(scene));
}

inline void append(std::vector<double>& out, double value) {
  out.push_back(value);
}
template <std::size_t Size>
void append(std::vector<double>& out, const std::array<double, Size>& values) {
  out.insert(out.end(), values.begin(), values.end());
}
template <class Vector>
requires requires(const Vector& v) {
  v.vec();
}
void append(std::vector<double>& out, const Vector& v) {
  out.insert(out.end(), v.vec().data(), v.vec().data() + v.vec().size());
}
template <int N>
void append(std::vector<double>& out, const Position<N>& x) {
  out.insert(out.end(), x.translation().data(), x.translation().data() + x.translation().size());
  if constexpr (N == 6) out.insert(out.end(), x.attitude().coeffs().data(), x.attitude().coeffs().data() + 4);
}

template <int N>
void append(std::vector<double>& out, [[maybe_unused]] const ObjectRow<N>& object) {
  if constexpr (N == kJointPort) out.insert(out.end(), object.x.data(), object.x.data() + object.x.size());
}

/// All numbers of a row.
template <int N>
std::vector<double> numbers(const Row<N>& row) {
  // By name: a new column does not compile until it is here.
  const auto& [t, master_x, master_v, master_f, wanted, slave_x, slave_v, slave_f, env_f, position_error, master_energy,
               slave_energy, observed, undissipated, dissipated, mode, object, figures, reference, coupling_energy,
               ahead, touching, coupled, following] = row;
  std::vector<double> out;
  const auto each = [&](const auto&... values) { (append(out, values), ...); };
  each(t, master_x, master_v, master_f, wanted, slave_x, slave_v, slave_f, env_f, position_error, master_energy,
       slave_energy, observed, undissipated, dissipated, static_cast<double>(mode), object, figures, reference,
       coupling_energy, ahead, touching ? 1.0 : 0.0, coupled ? 1.0 : 0.0, following ? 1.0 : 0.0);
  return out;
}
/// All numbers of all rows.
template <int N>
std::vector<double> numbers(const Rows<N>& all) {
  std::vector<double> out;
  for (const Row<N>& row : all) {
    const std::vector<double> of_row = numbers(row);
    out.insert(out.end(), of_row.begin(), of_row.end());
  }
  return out;
}

inline bool same_bits(const std::vector<double>& a, const std::vector<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
  });
}

}  // namespace twoport::test
