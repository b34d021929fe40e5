// A library without an entry point for devices; it has one for robots.

#include "common/hardware/plugin.h"

extern "C" __attribute__((visibility("default"))) const twoport::plugin::Entry<twoport::plugin::Robot>*
twoport_robot_plugin() {
  return nullptr;
}
