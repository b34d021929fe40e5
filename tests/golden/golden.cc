// Digests of what every scene computes: rows and summary, bit for bit, for three seeds each, and of two sweeps.
//
//   golden SCENES            prints the digests, a line each
//
// A change that is meant to change no result leaves them as they are; scripts/golden compares them with those on record.

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"
#include "lab/study/parallel.h"
#include "lab/study/sweep.h"

namespace {

using namespace twoport;

/// FNV-1a, 64 bits.
class Digest {
 public:
  void add(std::string_view bytes) {
    for (const char c : bytes) hash_ = (hash_ ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  }
  void add(double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    for (int i = 0; i < 64; i += 8) hash_ = (hash_ ^ ((bits >> i) & 0xff)) * 0x100000001b3;
  }
  template <class Vector>
  void add_all(const Vector& v) {
    for (int i = 0; i < v.size(); ++i) add(v[i]);
  }
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325;
};

template <int N>
void add(Digest& d, const Position<N>& x) {
  d.add_all(x.translation());
  if constexpr (N == 6) d.add_all(x.attitude().coeffs());
}

template <int N>
void add(Digest& d, const Row<N>& row) {
  d.add(row.t_s);
  add(d, row.master_x);
  d.add_all(row.master_v.vec());
  d.add_all(row.master_f.vec());
  d.add_all(row.master_f_wanted.vec());
  add(d, row.slave_x);
  d.add_all(row.slave_v.vec());
  d.add_all(row.slave_f.vec());
  d.add_all(row.env_f.vec());
  d.add_all(row.position_error.vec());
  for (const double energy :
       {row.master_energy_j, row.slave_energy_j, row.observed_energy_j, row.undissipated_j, row.dissipated_j})
    d.add(energy);
  d.add(static_cast<double>(row.mode));
}

/// What differs between C libraries: then no digest of a run can be compared.
std::uint64_t of_the_c_library() {
  Digest d;
  for (int i = 1; i < 2000; ++i) {
    const double x = 0.00137 * i;
    for (const double y : {std::sin(x), std::cos(x), std::tan(0.5 * x), std::exp(x), std::log(x),
                           std::pow(x, -1.0 / 3.0), std::atan2(x, 1.0), std::expm1(-x), std::sqrt(x)})
      d.add(y);
  }
  return d.value();
}

/// The numbers that a summary has had since the digests were first made: a new one changes none of them.
constexpr std::string_view kNumbers[] = {"steps",
                                         "stable",
                                         "min_port_energy_j",
                                         "initial_energy_j",
                                         "min_observed_energy_j",
                                         "energy_owed_j",
                                         "dissipated_j",
                                         "position_error_rms_m",
                                         "drift_m",
                                         "force_error_rms_n",
                                         "force_direction_error_max_deg",
                                         "force_direction_error_rms_deg",
                                         "chatter_rms_n",
                                         "max_force_n",
                                         "contact_s",
                                         "correction_max_n",
                                         "corrected_ticks",
                                         "packets.to_slave.sent",
                                         "packets.to_slave.lost",
                                         "packets.to_slave.late",
                                         "packets.to_slave.duplicated",
                                         "packets.to_master.received"};

std::uint64_t of_summary(const Summary& s) {
  Digest d;
  const auto all = numbers(s);
  for (const std::string_view name : kNumbers) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& each) { return each.first == name; });
    if (found == all.end()) throw ConfigError{fmt::format("no number {} in a summary", name)};
    d.add(found->second);
  }
  d.add(s.verdict());
  return d.value();
}

std::uint64_t of_rows(const Scene& scene) {
  return for_dof(scene.dof, [&]<int N>() {
    Digest d;
    lab::make_simulation<N>(scene)->run([&](const Row<N>& row) {
      add(d, row);
      return true;
    });
    return d.value();
  });
}

std::uint64_t of_sweep(const std::string& scene, const std::vector<std::string>& axes) {
  lab::SweepOptions o;
  o.scene = scene;
  o.jobs = 1;
  o.set = {"duration_s=2"};
  for (const std::string& axis : axes) o.axes.push_back(lab::parse_axis(axis));
  const lab::Table table = lab::sweep(o);
  Digest d;
  for (const auto& row : table.rows)
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string_view column = table.columns[i];
      if (std::find(std::begin(kNumbers), std::end(kNumbers), column) != std::end(kNumbers)) d.add((row[i]).text());
    }
  return d.value();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "golden SCENES: a folder of scenes\n");
    return 2;
  }
  try {
    const std::filesystem::path folder{argv[1]};
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::recursive_directory_iterator{folder})
      if (entry.path().extension() == ".textproto")
        names.push_back(std::filesystem::relative(entry.path(), folder).replace_extension().string());
    std::sort(names.begin(), names.end());

    constexpr std::size_t kSeeds = 3;
    std::vector<std::string> lines(names.size() * kSeeds);
    lab::for_each_parallel(lines.size(), lab::all_cores(), [&](std::size_t i) {
      const std::string& name = names[i / kSeeds];
      Scene scene = load_scene((folder / (name + ".textproto")).string());
      scene.seed += i % kSeeds;
      lines[i] = fmt::format("{} {} {:016x} {:016x}\n", name, scene.seed, of_rows(scene), of_summary(lab::run(scene)));
    });
    fmt::print("libm {:016x}\n", of_the_c_library());
    for (const std::string& line : lines) fmt::print("{}", line);
    fmt::print("sweep-link {:016x}\n", of_sweep((folder / "demo.textproto").string(),
                                                {"to_slave.delay_ms=5:80:4", "to_master.loss=0,0.1", "seed=1,2,3"}));
    fmt::print("sweep-render {:016x}\n", of_sweep((folder / "render_wall_projected.textproto").string(),
                                                  {"control.passivity.method=NONE,CLASSIC,FORCE_PROJECTED",
                                                   "environment[0].wall.stiffness_n_per_m=1000:20000:4:log"}));
    return 0;
  } catch (const std::exception& e) {
    fmt::print(stderr, "golden: {}\n", e.what());
    return 1;
  }
}
