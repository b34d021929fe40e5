#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

#include "common/link/mailbox.h"
#include "common/platform/live.h"
#include "common/platform/log.h"
#include "common/platform/program.h"
#include "common/platform/realtime.h"
#include "common/platform/recorder.h"
#include "common/platform/session.h"
#include "common/runtime/cycle.h"
#include "common/scene/load.h"
#include "master/master_node.h"
#include "master/render_node.h"
#include "sim/sim_device.h"

namespace twoport {
namespace {

/// The handle's last positions by tick, to hold against what the slave says it was following.
template <int N>
class History {
 public:
  History(double rate_hz, double longest_s)
      : rate_hz_{rate_hz}, x_(std::bit_ceil(static_cast<std::size_t>(std::min(longest_s * rate_hz, 1e6)))) {}
  /// Ticks that were left out since the last have the position of this one.
  void keep(std::int64_t k, const Position<N>& x) noexcept {
    next_ = std::max(next_, k + 1 - static_cast<std::int64_t>(x_.size()));
    while (next_ <= k) x_[index(next_++)] = x;
  }
  [[nodiscard]] const Position<N>& at(std::int64_t ns) const noexcept {
    return x_[index(std::llround(static_cast<double>(ns) * rate_hz_ / kNanosecondsPerSecond))];
  }

 private:
  [[nodiscard]] std::size_t index(std::int64_t k) const noexcept { return static_cast<std::size_t>(k) % x_.size(); }
  double rate_hz_;
  std::vector<Position<N>> x_;
  std::int64_t next_ = 0;
};

template <int N>
int render(const Scene& scene, const LiveArguments& arguments, spdlog::logger& log) {
  const Seconds dt{1.0 / scene.master_rate_hz};
  sim::SimDevice<N> device{scene, dt};
  const sim::Environment<N> environment{scene};
  RenderNode<N> node{scene.control, environment};
  const Energy initial = scene.control.initial_energy + environment.potential(device.x());
  Recorder<N> recorder{{scene.master_rate_hz, scene.duration_s, device.path().end_s(), initial.si()},
                       trace_path(arguments),
                       scene.duration_s};
  const std::atomic<bool>& stop = stop_on_signals();
  PeriodicLoop loop{{.rate_hz = scene.master_rate_hz, .realtime = arguments.realtime, .spin = arguments.spin}};
  say_what_is_missing(log, loop);

  NoMail mail;
  StepClock clock;
  std::int64_t done = 0;
  loop.run(stop, [&](std::int64_t k, Duration now) {
    if (to_seconds(now).si() >= scene.duration_s || recorder.diverged()) return false;
    const std::int64_t passed = advance(device, done, k);
    const auto out =
        clock.time([&] { return run_cycle(node, device, mail, tick_after<MasterClock>(passed, now, dt)); });
    recorder.push({.t_s = to_seconds(now).si(),
                   .master_x = device.x(),
                   .master_v = device.v(),
                   .master_f = device.held(),
                   .master_f_wanted = out.wanted,
                   .env_f = -out.wanted,
                   .master_energy_j = device.port_energy().si(),
                   .observed_energy_j = (node.observed() - initial).si(),
                   .owed_j = out.owed.si(),
                   .dissipated_j = out.dissipated.si(),
                   .mode = Mode::coupled});
    return true;
  });
  device.release();

  Summary s = recorder.finish();
  say_what_was_lost(log, recorder.dropped(), 0);
  add_times(s, loop, clock, stop);
  return conclude(scene, arguments, "master", s, !stop, recorder);
}

template <int N>
int couple(const Scene& scene, const LiveArguments& arguments, spdlog::logger& log) {
  const Seconds dt{1.0 / scene.master_rate_hz};
  const Endpoint peer = parse_endpoint(arguments.address, "--peer");
  Mailbox<N, UdpTransport<N>> mail{{{.side = Side::master,
                                     .rate_hz = scene.master_rate_hz,
                                     .peer_rate_hz = scene.slave_rate_hz,
                                     .scene_digest = scene_digest(scene),
                                     .incoming = scene.to_master,
                                     .impairment_seed = scene.seed ^ kToMasterStream},
                                    UdpSocket{any_port_toward(peer)},
                                    peer}};
  sim::SimDevice<N> device{scene, dt};
  MasterNode<N> node{scene.control};
  const Scaling<N> scaling{scene.control};
  const Energy initial = scene.control.initial_energy + scaling.to_master(scene.control.initial_energy);
  Recorder<N> recorder{{scene.master_rate_hz, scene.duration_s, device.path().end_s(), initial.si()},
                       trace_path(arguments),
                       scene.duration_s};
  const std::atomic<bool>& stop = stop_on_signals();
  PeriodicLoop loop{{.rate_hz = scene.master_rate_hz, .realtime = arguments.realtime, .spin = arguments.spin}};
  say_what_is_missing(log, loop);
  log.info("waiting for a slave at {}", arguments.address);

  // A report may be as old as both ways are long, and as the slave is silent.
  History<N> history{scene.master_rate_hz, 4.0 + longest_delay_s(scene.to_slave) + longest_delay_s(scene.to_master)};
  Histogram round_trip;
  StepClock clock;
  double energy_heard = 0.0;
  std::int64_t started = -1, done = 0;
  loop.run(stop, [&](std::int64_t k, Duration now) {
    UdpTransport<N>& transport = mail.transport();
    if (!transport.refusal().empty()) return false;
    if (transport.paired_anew()) {
      mail.forget();
      node.rebase(Energy{energy_heard});
      if (started < 0) started = done = k;
    }
    // Virtual hands and handles wait with the program for its first slave.
    const double t_s = started < 0 ? 0.0 : static_cast<double>(k - started) / scene.master_rate_hz;
    if (t_s >= scene.duration_s || recorder.diverged()) return false;
    const std::int64_t passed = started < 0 ? 1 : advance(device, done, k);
    history.keep(k, device.x());

    const auto out =
        clock.time([&] { return run_cycle(node, device, mail, tick_after<MasterClock>(passed, now, dt)); });
    const Known<N>& slave = mail.known();
    energy_heard = slave.energy_in_j;
    if (slave.fresh && slave.round_trip() >= Duration{0}) round_trip.add(slave.round_trip());
    if (started < 0) return true;
    const bool comparable = slave.any && slave.newest.echo_ns >= 0 && out.mode == Mode::coupled;
    recorder.push({.t_s = t_s,
                   .master_x = device.x(),
                   .master_v = device.v(),
                   .master_f = device.held(),
                   .master_f_wanted = out.wanted,
                   .slave_x = slave.newest.x,
                   .slave_v = slave.newest.v,
                   .slave_f = slave.newest.f_coupling,
                   .env_f = -slave.newest.f_environment,
                   .position_error = comparable ? slave.newest.x - scaling.to_slave(history.at(slave.newest.echo_ns))
                                                : Displacement<N>{},
                   .master_energy_j = device.port_energy().si(),
                   .observed_energy_j = node.observed().si(),
                   .owed_j = out.owed.si(),
                   .dissipated_j = out.dissipated.si(),
                   .mode = out.mode});
    return true;
  });
  device.release();

  Summary s = recorder.finish();
  if (!mail.transport().refusal().empty()) {
    fmt::print(stderr, "twoport-master: {}\n", mail.transport().refusal());
    return 1;
  }
  say_what_was_lost(log, recorder.dropped(), mail.transport().counts().overflowed);
  add_times(s, loop, clock, stop);
  add_link(s, s.to_slave, s.to_master, mail, node.mode());
  s.rtt_ms = percentiles(round_trip, 1e6);
  return conclude(scene, arguments, "master", s, !stop, recorder);
}

template <int N>
int run(const Scene& scene, const LiveArguments& arguments) {
  spdlog::logger log = make_log("master");
  return scene.control.architecture == Architecture::render ? render<N>(scene, arguments, log)
                                                            : couple<N>(scene, arguments, log);
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  using namespace twoport;
  return live_program(argc, argv, "twoport-master", "hand and haptic device, live", "--peer", "127.0.0.1:45000",
                      [](const Scene& scene, const LiveArguments& arguments) {
                        return with_size(scene, [&]<int N>() { return run<N>(scene, arguments); });
                      });
}
