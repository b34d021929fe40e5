// A transparency layer for the tests: "spring K", and, with 100 N/m for S seconds, "crash S", "nan S", "hang S"; "no" does not open.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "common/hardware/transparency_plugin.h"

namespace {

struct Layer {
  char kind[16]{};
  double number = 0.0, time_s = 0.0;
};

void* open_layer(const twoport_transparency_session* session) {
  auto* self = new Layer;
  const int read = std::sscanf(session->arguments, "%15s %lf", self->kind, &self->number);
  return read < 1 || std::strcmp(self->kind, "no") == 0 ? nullptr : self;
}

void step(void* of, const twoport_transparency_reading* in, twoport_transparency_wish* out) {
  auto* self = static_cast<Layer*>(of);
  self->time_s += in->dt_s;
  for (int i = 0; i < 3; ++i)
    out->force[i] = (std::strcmp(self->kind, "spring") == 0 ? self->number : 100.0) * in->position_m[i];
  if (self->time_s < self->number || std::strcmp(self->kind, "spring") == 0) return;
  if (std::strcmp(self->kind, "crash") == 0) std::abort();
  if (std::strcmp(self->kind, "nan") == 0) out->force[0] = NAN;
  for (volatile int i = 0; std::strcmp(self->kind, "hang") == 0;) i = i + 1;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const twoport_transparency_entry* twoport_transparency_plugin(void) {
  static const twoport_transparency_entry entry = {TWOPORT_TRANSPARENCY_VERSION, open_layer, step};
  return &entry;
}
