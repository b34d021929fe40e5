// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("INTERNAL_MODEL", InternalModel, InternalModelSlave,
              .summary = "a local model of the surface, corrected by the delayed force", .damps_link = true,
              .initial_energy_by_round_trip = true, .spring_in_all_axes_from = 6,
              .replaces_force_sensor = positions_replace_force_sensor,
              .figures = {{.name = "contact_spring_share", .least_dof = 6}})
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/internal_model/contact_model.h"
#include "common/method/transparency/internal_model/slave.h"
#endif
