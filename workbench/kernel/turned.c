/* turned.c: see turned.h. */
#include "turned.h"

#include "../build/runtime/event_rules.h"

#include <math.h>
#include <string.h>

enum { OF_INDICATORS = 6, OF_STATES = 3 };

size_t turned_doubles(size_t n, size_t nz) {
    return OF_INDICATORS * nz + OF_STATES * n;
}

void turned_bind(Turned *turned, const Problem *problem, double *memory) {
    double **of_indicators[OF_INDICATORS] = {&turned->side, &turned->bound, &turned->way, &turned->old,
                                             &turned->z, &turned->new_way};
    double **of_states[OF_STATES] = {&turned->dx, &turned->old_dx, &turned->x};
    for (size_t i = 0; i < OF_INDICATORS; i++) {
        *of_indicators[i] = memory + i * problem->nz;
    }
    for (size_t i = 0; i < OF_STATES; i++) {
        *of_states[i] = memory + OF_INDICATORS * problem->nz + i * problem->n;
    }
    turned->problem = problem;
    turned_forget(turned);
}

void turned_forget(Turned *turned) {
    memset(turned->bound, 0, turned->problem->nz * sizeof *turned->bound);
    turned->watches = turned->known = false;
}

static Evaluation rates(const Turned *turned, double t, const double *x, double *dx) {
    const Problem *problem = turned->problem;
    return problem->n ? problem->derivatives(problem->owner, t, x, dx) : EVALUATED;
}

static Evaluation indicators(const Turned *turned, double t, const double *x, double *z) {
    return turned->problem->indicators(turned->problem->owner, t, x, z);
}

/* The indicators a little ahead along dx, less those at (t, x). */
static Evaluation look_ahead(Turned *turned, double t, const double *x, const double *dx, const double *z,
                             double *way) {
    for (size_t i = 0; i < turned->problem->n; i++) {
        turned->x[i] = x[i] + turned->ahead * dx[i];
    }
    const Evaluation evaluation = indicators(turned, t + turned->ahead, turned->x, way);
    for (size_t i = 0; evaluation == EVALUATED && i < turned->problem->nz; i++) {
        way[i] -= z[i];
    }
    return evaluation;
}

static double ahead(const double *dx, const double *x, const double *scale, size_t n, double longest) {
    for (size_t i = 0; i < n; i++) {
        if (dx[i] != 0.0) {
            longest = fmin(longest, AHEAD * ((fabs(x[i]) + scale[i]) / fabs(dx[i])));
        }
    }
    return longest;
}

bool turned_stand(Turned *turned, double t, const double *x) {
    const Evaluation evaluation = indicators(turned, t, x, turned->z);
    for (size_t i = 0; i < turned->problem->nz; i++) {
        turned->side[i] = evaluation != EVALUATED ? 0.0 : turned->z[i] > 0.0 ? 1.0 : -1.0;
    }
    return evaluation != FAILED;
}

bool turned_before(Turned *turned, double t, const double *x, const double *scale, double longest) {
    turned->known = false;
    Evaluation evaluation = rates(turned, t, x, turned->old_dx);
    if (evaluation == EVALUATED) {
        turned->ahead = ahead(turned->old_dx, x, scale, turned->problem->n, longest);
        evaluation = indicators(turned, t, x, turned->old);
    }
    if (evaluation == EVALUATED) {
        evaluation = look_ahead(turned, t, x, turned->old_dx, turned->old, turned->way);
        turned->known = evaluation == EVALUATED;
    }
    return evaluation != FAILED;
}

/* Watch what came through its zero, stands there still, and was turned or stopped. */
static void watch(Turned *turned, double t) {
    for (size_t i = 0; i < turned->problem->nz; i++) {
        const double way = turned->way[i], z = turned->z[i];
        const bool came = turned->side[i] == (z > 0.0 ? -1.0 : 1.0);
        if (came && turned_back(turned->old[i], way, z, turned->new_way[i])) {
            turned->since = t;
            turned->bound[i] = turned_bound(way, z);
        }
    }
}

/* No longer watch what the event left free, or what left its zero again. */
static void release(Turned *turned, bool moved) {
    for (size_t i = 0; i < turned->problem->nz; i++) {
        if (moved || (turned->z[i] > 0.0) != (turned->bound[i] > 0.0)) {
            turned->bound[i] = 0.0;
        }
    }
}

static bool differs(const double *a, const double *b, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (a[i] != b[i]) {
            return true;
        }
    }
    return false;
}

bool turned_after(Turned *turned, double t, const double *x, bool restarted) {
    const bool known = turned->known;
    turned->known = false;
    Evaluation evaluation = rates(turned, t, x, turned->dx);
    if (evaluation == EVALUATED) {
        evaluation = indicators(turned, t, x, turned->z);
    }
    if (evaluation == EVALUATED) {
        release(turned, !known || restarted || differs(turned->dx, turned->old_dx, turned->problem->n));
    }
    if (evaluation == EVALUATED && known && restarted) {
        evaluation = look_ahead(turned, t, x, turned->dx, turned->z, turned->new_way);
    }
    if (evaluation != EVALUATED) {
        turned_forget(turned);
    } else if (known && restarted) {
        watch(turned, t);
    }
    turned->watches = false;
    for (size_t i = 0; i < turned->problem->nz; i++) {
        turned->watches = turned->watches || turned->bound[i] != 0.0;
    }
    return evaluation != FAILED;
}

bool turned_check(Turned *turned, double t, const double *x, bool *through) {
    *through = false;
    if (!turned->watches) {
        return true;
    }
    const Evaluation evaluation = indicators(turned, t, x, turned->z);
    for (size_t i = 0; evaluation == EVALUATED && i < turned->problem->nz; i++) {
        *through = *through || turned_beyond(turned->bound[i], turned->z[i]);
    }
    return evaluation != FAILED;
}
