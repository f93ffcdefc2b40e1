/* cs.h: co-simulation: the FMUs integrate, the kernel steps them from one communication point to the next.
 *
 * The twin of workbench/session/cs.py. Several FMUs make each communication step in the order of the list, with
 * the inputs of its begin.
 */
#ifndef WORKBENCH_KERNEL_CS_H
#define WORKBENCH_KERNEL_CS_H

#include "record.h"
#include "system.h"

typedef struct {
    System *system;
    /* Where the session stands. */
    double time;     /* [s] */
    double previous; /* begin of the last communication step [s] */
    double fixed;    /* constant communication step [s]; NaN: none (yet) */
    double longest;  /* longest communication step [s] */
    int32_t variable_step;
    int32_t step_given; /* the user named the step */
    /* The run: its way to the next target in `count` equal steps, `made` of them made. */
    double until, start, target, count, made;
    const double *targets;
    size_t n_targets;
    Record *record;
} Cs;

bool cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record, bool fresh);
/* Go on after a pause. */
bool cs_go_on(Cs *cs);

#endif
