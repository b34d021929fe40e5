// playground_rows OUT SCENE [PATH=VALUE...]: runs a scene in the laboratory. Writes OUT.scene, its values for the playground's core, and
// OUT.rows, the samples that the core must give of a scripted run: all fields of a sample, not a number where the laboratory has none.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "common/base/built_for.h"
#include "common/page/channel.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "web/playground/packed_scene.h"

namespace twoport {
namespace {

template <int N>
std::vector<double> rows(const Scene& scene) {
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN(), kSampleHz = 500.0;
  const auto every = std::max<std::int64_t>(1, std::llround(scene.master_rate_hz / kSampleHz));
  std::vector<double> all;
  std::int64_t k = 0;
  lab::make_simulation<N>(scene)->run([&](const Row<N>& row) {
    if (++k % every != 0) return true;
    PageSample s;
    for_each_page_field(s, [&](const char*, std::size_t size, double* field) { std::fill_n(field, size, kNothing); });
    s.t_s = row.t_s;
    for (int i = 0; i < std::min(N, 3); ++i) {
      const auto at = static_cast<std::size_t>(i);
      s.felt_n[at] = -row.master_f[i];
      s.unlimited_n[at] = -row.master_f_wanted[i];
      if constexpr (N == 6) s.felt_n_m[at] = -row.master_f[3 + i];
    }
    s.hand_energy_j = row.observed_energy_j;
    s.deficit_j = row.undissipated_j;
    s.mode = static_cast<double>(row.mode);
    for_each_page_field(
        s, [&](const char*, std::size_t size, const double* field) { all.insert(all.end(), field, field + size); });
    return true;
  });
  return all;
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  using namespace twoport;
  const std::string out = argv[1];
  Scene scene = load_scene(argv[2], std::vector<std::string>(argv + 3, argv + argc));
  playground::Packer packer;
  packer(scene);
  std::ofstream{out + ".scene", std::ios::binary} << packer.bytes();
  const std::vector<double> all = for_dof(scene.dof, [&]<int N>() { return rows<N>(scene); });
  std::ofstream{out + ".rows", std::ios::binary}.write(reinterpret_cast<const char*>(all.data()),
                                                       static_cast<std::streamsize>(all.size() * sizeof(double)));
}
