/* me.h: model exchange: the kernel integrates from stop to stop. The twin of tests/oracle/me.py. */
#ifndef WORKBENCH_KERNEL_ME_H
#define WORKBENCH_KERNEL_ME_H

#include "../build/runtime/event_rules.h"
#include "record.h"
#include "slopes.h"
#include "solver.h"
#include "system.h"
#include "turned.h"

typedef struct {
    System *system;
    const char *solver_name;
    const GearLibrary *gear;
    const Sparsity *sparsity; /* NULL: gear's matrix is dense */
    double rtol;
    double *scale;      /* [nx] see Tolerance */
    const double *most; /* [nx] bound of the scale */
    /* Where the session stands. */
    double time, next_time; /* [s] */
    double cautious, span; /* how long the next step may be; the time scale [s] */
    Flights flights;
    int32_t resumed; /* the run goes on after a pause */
    int32_t steps; /* since the last recorded point or event */
    int32_t told; /* some FMU wants to be told of completed steps */
    int64_t events; /* so far */
    Slopes *slopes; /* to be evaluated along the run; NULL: none */
    /* Owned by the kernel. */
    Solver *solver;
    double *x; /* [nx] scratch */
    double *flight;           /* [nx] see Tolerance */
    double *lowest, *highest; /* [nx] of the states since the last event that counts */
    double until; /* [s] */
    const double *targets;
    size_t n_targets;
    Record *record;
    Problem problem;
    Turned turned;
} Me;

/* Make the solver. */
bool me_open(Me *me);
/* Begin anew at `time` with the states that the FMUs have. */
bool me_restart(Me *me);
bool me_run(Me *me, double until, const double *targets, size_t n_targets, Record *record, bool fresh);
/* Go on after a pause. */
bool me_go_on(Me *me);
void me_close(Me *me);

#endif
