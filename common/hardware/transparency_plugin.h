#ifndef TWOPORT_TRANSPARENCY_PLUGIN_H
#define TWOPORT_TRANSPARENCY_PLUGIN_H

#include <stdint.h>

/* A transparency layer in a shared library: control { transparency { layer: PLUGIN plugin { file: "PATH.so" } } }. This file is C and
   needs no other.

   The layer computes the force that the hand should feel; a passivity layer limits it. SI units, the master's world and units. Arrays of
   six are translation first, then rotation; of fewer degrees of freedom the other numbers are 0. Attitudes are unit quaternions w x y z.
   Forces are those at the master port, power force·velocity into the network: the hand is pushed with -force.

   The library runs in a process of its own. Where it ends, hangs or returns a number that is not finite, the master releases the port
   for the rest of the run. In virtual time each answer is waited for; live it is that to the tick before. */

#ifdef __cplusplus
extern "C" {
#endif

#define TWOPORT_TRANSPARENCY_VERSION 1u

typedef struct {
  int32_t dof;           /* 1, 3 or 6 */
  double period_s;       /* of the loop */
  const char* arguments; /* control.transparency.plugin.arguments, or "" */
} twoport_transparency_session;

typedef struct {
  double dt_s;
  double position_m[3], attitude[4], velocity[6]; /* of the handle */
  double applied[6];                              /* force held in the last interval */
  int32_t coupled;                                /* 0: nothing is displayed in this tick */
  int32_t has_report;                             /* a report of the slave has arrived since the start */
  int32_t report_is_new;
  double slave_position_m[3], slave_attitude[4]; /* of the newest report, in the slave's world */
  double slave_velocity[6], slave_force[6];      /* of the newest report */
} twoport_transparency_reading;

typedef struct {
  double force[6];  /* wanted */
  double damper[6]; /* a force b·velocity besides */
  double stored_j;  /* energy of the model behind `force`; below 0: not stated */
} twoport_transparency_wish;

typedef struct {
  uint32_t version;                                   /* TWOPORT_TRANSPARENCY_VERSION */
  void* (*open)(const twoport_transparency_session*); /* NULL: it cannot */
  void (*step)(void*, const twoport_transparency_reading*, twoport_transparency_wish*);
} twoport_transparency_entry;

/* The library defines this function. */
const twoport_transparency_entry* twoport_transparency_plugin(void);

#ifdef __cplusplus
}
#endif
#endif
