// A line of common/method/transparency/list.h.
#ifdef TWOPORT_LAYER
TWOPORT_LAYER("CONTACT_SPRING", ContactSpringMaster, InternalModelSlave,
              .summary = "the delayed force and a local spring in all axes, for tools with many contacts",
              .initial_energy_by_round_trip = true, .spring_in_all_axes_from = 1,
              .replaces_force_sensor = positions_replace_force_sensor,
              .figures = {{.name = "contact_spring_share", .least_dof = 6}})
#endif
#ifdef TWOPORT_LAYER_CLASSES
#include "common/method/transparency/contact_spring/master.h"
#include "common/method/transparency/internal_model/slave.h"
#endif
