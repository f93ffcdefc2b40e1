/* slopes.h: the linearised model along a run: ∂f/∂x and ∂y/∂x where the solution passes given times.
 *
 * Relations stay as the run has them, so a slope is that of the branch at work. Evaluated in the accepted step that
 * passes the time, at its interpolated states: by the FMU's directional derivatives, or by forward differences. States
 * that move different parts of f and y, as far as the file says, move at once. Neither what the file says nor what the
 * FMU answers is believed: one more evaluation, all states moved, must agree; else the next way is taken at that time.
 */
#ifndef WORKBENCH_KERNEL_SLOPES_H
#define WORKBENCH_KERNEL_SLOPES_H

#include "record.h"
#include "solver.h"

/* The last one needs no belief. */
typedef enum { BY_DIRECTIONAL, BY_GROUPS, BY_STATES, N_WAYS } SlopesWay;

typedef struct {
    const double *times; /* [n_times] rising [s] */
    size_t n_times;
    /* Arrays that the caller owns; n states, q recorded values; rows are f, then y. */
    double *x, *dx; /* [n_times][n] the solution, and f there */
    double *a;      /* [n_times][n][n]: ∂f_j/∂x_i at [i][j]; zeros at first */
    double *c;      /* [n_times][n][q]: ∂y_k/∂x_i at [i][k]; zeros at first */
    double *work;   /* [7n + 5q] scratch */
    Groups groups;
    /* For directional derivatives, of one component. */
    const uint32_t *knowns;   /* [n] value references of the groups' members */
    const uint32_t *unknowns; /* [n + q] of the rows */
    int32_t way;              /* SlopesWay to begin with at each time */
    /* Results. */
    size_t found;           /* how many of the times have their slopes */
    size_t passed;          /* how many of the times have been passed */
    size_t refuted[N_WAYS]; /* at how many of the times each way was given up */
} Slopes;

/* Evaluate at the times within the last step of `solver`; those where the model cannot be evaluated are left out, and
 * found < passed then. `scale`: [n] size of each state. False: the FMU failed for good. */
bool slopes_after_step(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system);

#endif
