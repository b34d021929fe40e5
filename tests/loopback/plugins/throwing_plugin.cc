// A library whose static object throws when it is loaded.

#include <stdexcept>

namespace {

const int never = [] {
  if (true) throw std::runtime_error{"no licence for this machine"};
  return 1;
}();

}  // namespace

extern "C" __attribute__((visibility("default"))) const void* twoport_device_plugin() {
  return never != 0 ? nullptr : &never;
}
