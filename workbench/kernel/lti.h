/* lti.h: components that are no FMUs: linear systems, continuous or sampled, gains, sums, and functions of the
 * caller's. They are called through FMI 2.0's signatures. The twin of workbench/system/blocks.py, on the same memory.
 */
#ifndef WORKBENCH_KERNEL_LTI_H
#define WORKBENCH_KERNEL_LTI_H

#include <stddef.h>
#include <stdint.h>

#include "instants.h"

/* dx/dt = A x + B u, or at ticks x = A x + B u; y = C x + D u. The caller owns what it points to. */
typedef struct {
    size_t nx, nu, ny;
    const double *a, *b, *c, *d; /* by rows */
    double *memory;              /* [nu + nx + ny] inputs, states, outputs; the index is the value reference */
    double *next;                /* [nx] scratch */
    int32_t (*function)(const double *u, double *y); /* in place of C and D; not NULL: returns an FMI status */
    Instants instants;           /* of its ticks; none: continuous */
    double time;                 /* present [s] */
    int64_t ticks;               /* done */
    int32_t ticking;             /* in event mode, and a tick is due; or initialised, where none need be */
} Lti;

/* FMI 2.0's fmi2EventInfo. */
typedef struct {
    int again, terminate, nominals_changed, states_changed, timed;
    double next_time;
} LtiEventInfo;


#endif
