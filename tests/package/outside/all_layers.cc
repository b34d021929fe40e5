#include <twoport/master/master_node.h>
#include <twoport/platform/udp.h>
#include <twoport/record/summary.h>
#include <twoport/record/trace.h>
#include <twoport/scene/load.h>
#include <twoport/scene/scene.h>
#include <twoport/sim/sim_device.h>
#include <twoport/slave/slave_node.h>
#include <twoport/wire/link_transport.h>

#include <cstdio>

int main() {
  using namespace twoport;
  const Scene scene = parse_scene(
      "dof: 1 duration_s: 1 device { mass_kg: 1 } robot { mass_kg: 1 } control { architecture: POSITION_FORCE }",
      "text");
  sim::SimDevice<1> device{scene, Seconds{1.0 / scene.master_rate_hz}};
  MasterNode<1> master{scene.control};
  SlaveNode<1> slave{scene.control};
  const UdpSocket socket{parse_endpoint("127.0.0.1:0", "--listen")};
  std::printf("%s on port %s, master %s, slave %s, handle at %g m\n", to_string(scene.control.architecture).c_str(),
              socket.local().port > 0 ? "taken" : "none", to_string(master.mode()), to_string(slave.mode()),
              device.sense().x.translation()[0]);
}
