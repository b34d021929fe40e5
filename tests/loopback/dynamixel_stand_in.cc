#include <csignal>
#include <filesystem>
#include <iostream>
#include <span>
#include <string>

#include "common/scene/load.h"
#include "tests/support/dynamixel_servos.h"

// Stands in for an arm of Dynamixel servos: that of a scene, as leader in the operator's hand or as follower at the environment, until it is
// ended by a signal.
//
//   dynamixel_stand_in leader|follower SCENE SERVOS PORT    PORT: a link to the pseudo-terminal is made there
using namespace twoport;

namespace {

void stand(test::ServoLoad& load, int joints, const std::string& servos, const std::string& link) {
  test::DynamixelServos all{load_servos(servos, joints), load};
  std::filesystem::create_directories(std::filesystem::absolute(link).parent_path());
  std::filesystem::remove(link);
  std::filesystem::create_symlink(all.port(), link);
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  sigaddset(&ends, SIGINT);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);
  all.start();
  int signal = 0;
  sigwait(&ends, &signal);
  std::filesystem::remove(link);
}

}  // namespace

int main(int argc, char** argv) {
  const std::span words{argv, static_cast<std::size_t>(argc)};
  const std::string side = argc == 5 ? words[1] : "";
  if (side != "leader" && side != "follower") {
    std::cerr << "usage: dynamixel_stand_in leader|follower SCENE SERVOS PORT\n";
    return 2;
  }
  const Scene scene = load_scene(words[2], {}, SceneFor::live);
  if (side == "leader") {
    test::HeldArm arm{scene};
    stand(arm, scene.joints, words[3], words[4]);
  } else {
    test::TouchingArm arm{scene};
    stand(arm, scene.joints, words[3], words[4]);
  }
}
