/* none.c: for models without continuous states there is nothing to integrate, only events.
 *
 * Walks through time and locates where event indicators change their domain; what happens several times
 * within `longest` (or 1/50 of the way to `stop`) may not be seen.
 */
#include "locate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define PARTS 50.0

typedef struct {
    Solver base;
    Watch watch;
    double part; /* [s] longest step on the way to `stop` */
    double stop; /* [s] the stop that `part` belongs to */
    double work[];
} None;

static Evaluation indicators_at(void *owner, double t, double *z)
{
    const Problem *problem = &((None *)owner)->base.problem;
    return problem->indicators(problem->owner, t, NULL, z);
}

static Solver *create(const Problem *problem, const Tolerance *tolerance, const GearLibrary *library)
{
    (void)library;
    const size_t doubles = watch_doubles(problem->nz) + 1;
    None *none = problem->n == 0 ? calloc(1, sizeof *none + doubles * sizeof(double)) : NULL;
    if (none == NULL) {
        return NULL;
    }
    none->base.method = &solver_none;
    none->base.problem = *problem;
    none->base.tolerance = *tolerance;
    none->base.x = none->work; /* no states, but an address */
    none->stop = -INFINITY;
    watch_bind(&none->watch, problem->nz, none->work + 1, none, indicators_at);
    return &none->base;
}

static bool fail(Solver *solver, Evaluation evaluation)
{
    solver->message[0] = '\0';
    if (evaluation == RECOVERABLE) {
        snprintf(solver->message, SOLVER_MESSAGE, "none: the model gives no usable event indicators");
    }
    return false;
}

static bool restart(Solver *solver, double t, const double *x)
{
    (void)x;
    None *none = (None *)solver;
    solver->t = solver->t_old = t;
    none->stop = -INFINITY;
    const Evaluation evaluation = watch_restart(&none->watch, t);
    return evaluation == EVALUATED || fail(solver, evaluation);
}

static bool step(Solver *solver, double stop, double longest, bool *event)
{
    None *none = (None *)solver;
    if (stop != none->stop) {
        none->stop = stop;
        none->part = solver->problem.nz > 0 ? (stop - solver->t) / PARTS : INFINITY;
    }
    const double h = fmin(longest, none->part);
    double end = solver->t + h * (1.0 + 1e-9) >= stop ? stop : solver->t + h;
    const Evaluation evaluation = watch_step(&none->watch, solver->t, &end, event);
    if (evaluation != EVALUATED) {
        return fail(solver, evaluation);
    }
    solver->t_old = solver->t;
    solver->t = end;
    solver->steps++;
    return true;
}

static bool interpolate(const Solver *solver, double t, double *x)
{
    (void)solver;
    (void)t;
    (void)x;
    return true;
}

static void destroy(Solver *solver) { free(solver); }

const SolverMethod solver_none = {"none", create, restart, step, interpolate, destroy};
