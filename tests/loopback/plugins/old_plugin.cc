// A plug-in for a version of the interface that there never was.

#include "common/hardware/plugin.h"

extern "C" __attribute__((visibility("default"))) const twoport::plugin::Entry<twoport::plugin::Device>*
twoport_device_plugin() {
  static const twoport::plugin::Entry<twoport::plugin::Device> entry{0, nullptr};
  return &entry;
}
