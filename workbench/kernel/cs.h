/* cs.h: co-simulation: the FMUs integrate, the kernel steps them from one communication point to the next.
 *
 * The twin of tests/oracle/cs.py. How several FMUs make a communication step is the master's affair.
 */
#ifndef WORKBENCH_KERNEL_CS_H
#define WORKBENCH_KERNEL_CS_H

#include "record.h"
#include "system.h"

struct Master;

typedef struct {
    System *system;
    struct Master *master; /* NULL: each FMU goes its own way */
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

/* Make one step and record its two rows; at `until` the right limit is the next run's. */
bool cs_communicate(Cs *cs, double end, bool last);
bool cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record, bool fresh);
/* Go on after a pause. */
bool cs_go_on(Cs *cs);

#endif
