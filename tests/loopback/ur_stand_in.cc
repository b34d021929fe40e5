#include <chrono>
#include <exception>
#include <iostream>
#include <string>
#include <thread>

#include "common/base/text.h"
#include "tests/support/ur_controller.h"

// Stands in for the controller of a UR5e: RTDE at PORT, programs at PORT - 2. A wall of 3 kN/m is 20 mm along x from the tool.
//
//   ur_stand_in PORT [MINOR]     with PolyScope 5.MINOR (22); from 23 on it has direct torque
int main(int argc, char** argv) try {
  const auto port = twoport::number_from<std::uint16_t>(argc > 1 ? argv[1] : "");
  const auto minor = twoport::number_from<std::uint32_t>(argc > 2 ? argv[2] : "22");
  if (!port || *port < 3 || !minor) {
    std::cerr << "usage: ur_stand_in PORT [MINOR]\n";
    return 2;
  }
  const twoport::test::UrController controller{TWOPORT_ARMS, {.version = {5, *minor, 0}, .port = *port}};
  for (;;) std::this_thread::sleep_for(std::chrono::hours{1});
} catch (const std::exception& e) {
  std::cerr << "ur_stand_in: " << e.what() << '\n';
  return 1;
}
