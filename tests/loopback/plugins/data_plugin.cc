// A library whose entry point is a number.

extern "C" __attribute__((visibility("default"))) int twoport_device_plugin;
int twoport_device_plugin = 7;
