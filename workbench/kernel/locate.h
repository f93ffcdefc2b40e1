/* locate.h: finds the first change of an event indicator's domain inside a step.
 *
 * The domains are z > 0 and z <= 0 (FMI 2.0, section 3.1.1). A time that is returned lies on the far
 * side of the change. An indicator that leaves its domain and returns within one step shows no
 * difference at the step's ends: wherever an indicator is nearer to zero than it moves in a step, the
 * middle of the step and the vertex of the parabola through the three known values are looked at too.
 * An indicator that oscillates several times within one step can still slip through; `longest` is the
 * remedy.
 */
#ifndef WORKBENCH_KERNEL_LOCATE_H
#define WORKBENCH_KERNEL_LOCATE_H

#include "solver.h"

/* Event indicators along a step: z at time t, the states there by the solver's dense output. */
typedef Evaluation (*Indicators)(void *owner, double t, double *z);

typedef struct {
    size_t nz;
    void *owner;
    Indicators indicators;
    bool has_before;
    double t_before; /* [s] where the step before began */
    double *z;       /* [nz] at the present time */
    double *before;  /* [nz] at t_before */
    double *low, *high, *middle, *probe; /* [nz] work space */
} Watch;

/* How many doubles `watch_bind` needs. */
size_t watch_doubles(size_t nz);

/* Take `memory` (see watch_doubles) and the function to ask. */
void watch_bind(Watch *watch, size_t nz, double *memory, void *owner, Indicators indicators);

/* Begin anew at t. */
Evaluation watch_restart(Watch *watch, double t);

/* Check the step from t_old to *t. With a domain change in it, *t becomes a time just after the first
 * (within 1e-12 relative) and *event true. Unless EVALUATED is returned nothing has changed. */
Evaluation watch_step(Watch *watch, double t_old, double *t, bool *event);

#endif
