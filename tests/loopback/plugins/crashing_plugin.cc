// A library that ends its program when it is loaded.

#include <csignal>

namespace {

const int never = std::raise(SIGSEGV);

}  // namespace

extern "C" __attribute__((visibility("default"))) const void* twoport_device_plugin() {
  return &never;
}
