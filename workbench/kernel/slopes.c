#include "slopes.h"

#include <math.h>

/* Of the size of a state: far above the rounding of f, far below where its curvature counts. */
static const double NUDGE = 1e-6;

/* Derivatives and recorded values at states x. */
static Evaluation look(const Problem *problem, double t, const double *x, Record *record, System *system, double *dx,
                       double *y) {
    const Evaluation evaluation = problem->derivatives(problem->owner, t, x, dx);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    return access_read(&record->access, system->components, y, &system->failure) ? EVALUATED : FAILED;
}

static Evaluation slopes_at(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system) {
    const Problem *problem = &solver->problem;
    const size_t n = problem->n, q = record->n_values, k = slopes->passed;
    const double t = slopes->times[k];
    double *x = slopes->x + k * n, *dx = slopes->dx + k * n;
    double *moved = slopes->work, *there = moved + n, *y = there + n, *y_there = y + q;
    if (!solver->method->interpolate(solver, t, x)) {
        return RECOVERABLE;
    }
    Evaluation evaluation = look(problem, t, x, record, system, dx, y);
    for (size_t i = 0; i < n && evaluation == EVALUATED; i++) {
        copy_values(moved, x, n);
        /* To one side and the other in turn: what the curvature of f leaves cancels between neighbours. */
        double nudge = (k % 2 ? -NUDGE : NUDGE) * fmax(fabs(x[i]), scale[i]);
        moved[i] = x[i] + nudge;
        evaluation = look(problem, t, moved, record, system, there, y_there);
        if (evaluation == RECOVERABLE) { /* the edge of what the model can do: from the other side */
            nudge = -nudge;
            moved[i] = x[i] + nudge;
            evaluation = look(problem, t, moved, record, system, there, y_there);
        }
        const double step = moved[i] - x[i];
        for (size_t j = 0; j < n; j++) {
            slopes->a[(k * n + i) * n + j] = (there[j] - dx[j]) / step;
        }
        for (size_t j = 0; j < q; j++) {
            slopes->c[(k * n + i) * q + j] = (y_there[j] - y[j]) / step;
        }
    }
    return evaluation;
}

bool slopes_after_step(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system) {
    while (slopes->passed < slopes->n_times && slopes->times[slopes->passed] <= solver->t) {
        const Evaluation evaluation = slopes_at(slopes, solver, scale, record, system);
        if (evaluation == FAILED) {
            return false;
        }
        slopes->found += evaluation == EVALUATED;
        slopes->passed++;
        failure_clear(&system->failure);
    }
    return true;
}
