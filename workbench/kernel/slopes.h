/* slopes.h: the linearised model along a run: ∂f/∂x and ∂y/∂x where the solution passes given times.
 *
 * Relations stay as the run has them, so a slope is that of the branch at work. By forward differences, evaluated in
 * the accepted step that passes the time, at its interpolated states.
 */
#ifndef WORKBENCH_KERNEL_SLOPES_H
#define WORKBENCH_KERNEL_SLOPES_H

#include "record.h"
#include "solver.h"

typedef struct {
    const double *times; /* [n_times] rising [s] */
    size_t n_times;
    /* Arrays that the caller owns; n states, q recorded values. */
    double *x, *dx; /* [n_times][n] the solution, and f there */
    double *a;      /* [n_times][n][n]: ∂f_j/∂x_i at [i][j] */
    double *c;      /* [n_times][n][q]: ∂y_k/∂x_i at [i][k] */
    double *work;   /* [2n + 2q] scratch */
    size_t found;   /* how many of the times have their slopes */
    size_t passed;  /* how many of the times have been passed */
} Slopes;

/* Evaluate at the times within the last step of `solver`; those where the model cannot be evaluated are left out, and
 * found < passed then. `scale`: [n] size of each state. False: the FMU failed for good. */
bool slopes_after_step(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system);

#endif
