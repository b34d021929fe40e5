// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("SURFACE_MODEL", SurfaceModelMaster, InternalModelSlave,
              .summary = "a local model of the surface and nothing else", .damps_link = true,
              .replaces_force_sensor = positions_replace_force_sensor)
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/internal_model/slave.h"
#include "common/method/transparency/surface_model/master.h"
#endif
