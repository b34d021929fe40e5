#include <fmt/format.h>

#include "common/base/check.h"
#include "common/link/mailbox.h"
#include "common/platform/live.h"
#include "common/platform/log.h"
#include "common/platform/recorder.h"
#include "common/platform/session.h"
#include "common/runtime/cycle.h"
#include "common/scene/load.h"
#include "sim/sim_robot.h"
#include "slave/slave_node.h"

namespace twoport {
namespace {

template <int N>
int run(const Scene& scene, const LiveArguments& arguments) {
  spdlog::logger log = make_log("slave");
  const Seconds dt{1.0 / scene.slave_rate_hz};
  Mailbox<N, UdpTransport<N>> mail{{{.side = Side::slave,
                                     .rate_hz = scene.slave_rate_hz,
                                     .peer_rate_hz = scene.master_rate_hz,
                                     .scene_digest = scene_digest(scene),
                                     .incoming = scene.to_slave,
                                     .impairment_seed = scene.seed ^ kToSlaveStream},
                                    UdpSocket{parse_endpoint(arguments.address, "--listen")}}};
  sim::SimRobot<N> robot{scene, dt};
  SlaveNode<N> node{scene.control};
  Recorder<N> recorder{{scene.slave_rate_hz, scene.duration_s, 0.0, 0.0}, trace_path(arguments), scene.duration_s};
  const std::atomic<bool>& stop = stop_on_signals();
  PeriodicLoop loop{{.rate_hz = scene.slave_rate_hz, .realtime = arguments.realtime, .spin = arguments.spin}};
  say_what_is_missing(log, loop);
  log.info("listening on {}", to_string(mail.transport().local()));

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
    // It serves as long as a master is there, and ends when the scene is over and the link silent.
    const double t_s = started < 0 ? 0.0 : static_cast<double>(k - started) / scene.slave_rate_hz;
    if ((t_s >= scene.duration_s && node.mode() != Mode::coupled) || recorder.diverged()) return false;
    const std::int64_t passed = started < 0 ? 1 : advance(robot, done, k);

    const auto out = clock.time([&] { return run_cycle(node, robot, mail, tick_after<SlaveClock>(passed, now, dt)); });
    const Known<N>& master = mail.known();
    energy_heard = master.energy_in_j;
    if (started < 0 || t_s >= scene.duration_s) return true;
    recorder.push({.t_s = t_s,
                   .master_x = master.newest.x,
                   .master_v = master.newest.v,
                   .master_f = master.newest.f,
                   .master_f_wanted = master.newest.f,
                   .slave_x = robot.state().x,
                   .slave_v = robot.state().v,
                   .slave_f = out.command.f,
                   .env_f = robot.environment_force(),
                   .position_error = node.position_error(),
                   .slave_energy_j = node.delivered().si(),
                   .dissipated_j = out.dissipated.si(),
                   .mode = out.mode});
    return true;
  });
  robot.release();

  Summary s = recorder.finish();
  if (!mail.transport().refusal().empty()) {
    fmt::print(stderr, "twoport-slave: {}\n", mail.transport().refusal());
    return 1;
  }
  if (!recorder.diverged()) {
    s.stable = true;
    s.verdict = "bounded here; whether it is stable shows at the master's port";
  }
  say_what_was_lost(log, recorder.dropped(), mail.transport().counts().overflowed);
  add_times(s, loop, clock, stop);
  add_link(s, s.to_master, s.to_slave, mail, node.mode());
  return conclude(scene, arguments, "slave", s, false, recorder);
}

}  // namespace
}  // namespace twoport

int main(int argc, char** argv) {
  using namespace twoport;
  return live_program(argc, argv, "twoport-slave", "robot and force sensor, live", "--listen", "127.0.0.1:45000",
                      [](const Scene& scene, const LiveArguments& arguments) {
                        if (scene.control.architecture == Architecture::render)
                          throw ConfigError(arguments.scene +
                                            ": control.architecture is RENDER, which has no slave; run twoport-master "
                                            "alone");
                        return with_size(scene, [&]<int N>() { return run<N>(scene, arguments); });
                      });
}
