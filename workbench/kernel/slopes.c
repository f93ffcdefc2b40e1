#include "slopes.h"

#include "grouped.h"

/* One of the times. */
typedef struct {
    Slopes *slopes;
    const Problem *problem;
    Record *record;
    System *system;
    double t;
    size_t k;
    Sloped sloped; /* f and y, by the states */
} Look;

/* Derivatives and recorded values at states x. */
static Evaluation evaluate(void *owner, const double *x, double *values) {
    const Look *look = owner;
    const Evaluation evaluation = look->problem->derivatives(look->problem->owner, look->t, x, values);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    Record *record = look->record;
    System *system = look->system;
    return access_read(&record->access, system->components, values + look->sloped.n, &system->failure) ? EVALUATED
                                                                                                       : FAILED;
}

/* ∂(f, y)/∂x_i at a row. */
static double *slope(void *owner, size_t i, size_t row) {
    const Look *look = owner;
    const size_t n = look->sloped.n, q = look->sloped.n_values - n, state = look->k * n + i;
    return row < n ? &look->slopes->a[state * n + row] : &look->slopes->c[state * q + row - n];
}

static void look_from(Look *look, Slopes *slopes, const Solver *solver, const double *scale, Record *record,
                      System *system) {
    const size_t n = solver->problem.n, q = record->n_values, k = slopes->passed;
    double *w = slopes->work;
    *look = (Look){
        .slopes = slopes, .problem = &solver->problem, .record = record, .system = system, .t = slopes->times[k],
        .k = k,
        .sloped = {
            .n = n, .n_values = n + q, .x = slopes->x + k * n, .scale = scale, .moved = w, .step = w + n,
            .here = w + 2 * n, .there = w + 3 * n + q, .sums = w + 4 * n + 2 * q,
            .owner = look, .evaluate = evaluate, .slope = slope,
        },
    };
}

/* Ask the FMU, which stands at x, for the movement. RECOVERABLE: it does not say. */
static Evaluation ask(const Sloped *sloped, const size_t *members, size_t n, double side) {
    const Look *look = sloped->owner;
    const Slopes *slopes = look->slopes;
    const Component *component = &look->system->components[0];
    const size_t begin = (size_t)(members - slopes->groups.members);
    (void)side;
    for (size_t j = 0; j < n; j++) {
        sloped->step[members[j]] = 1.0;
        sloped->moved[begin + j] = 1.0;
    }
    const int status = component->calls->directional
                           ? component->calls->directional(component, slopes->unknowns, sloped->n_values,
                                                           slopes->knowns + begin, sloped->moved + begin, n,
                                                           sloped->there)
                           : NOT_EXPORTED;
    if (status == FMI_FATAL) {
        component_checked(component, GET_DIRECTIONAL, status, 0, &look->system->failure);
        return FAILED;
    }
    return status >= 0 && status <= FMI_WARNING ? EVALUATED : RECOVERABLE;
}

static Evaluation slopes_at(const Look *look) {
    Slopes *slopes = look->slopes;
    const Sloped *sloped = &look->sloped;
    const size_t n = sloped->n;
    /* To one side and the other in turn: what the curvature of f leaves cancels between neighbours. */
    const double side = look->k % 2 ? -1.0 : 1.0;
    double *here = slopes->work + 2 * n;
    Evaluation evaluation = evaluate(sloped->owner, sloped->x, here);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    copy_values(slopes->dx + look->k * n, here, n);
    for (int32_t way = slopes->way; way < BY_STATES; way++) {
        if (way == BY_GROUPS && slopes->groups.n_groups == n) {
            continue; /* nothing is won */
        }
        evaluation = grouped_fill(sloped, &slopes->groups, false, way == BY_DIRECTIONAL ? ask : grouped_move, side);
        if (evaluation == EVALUATED) {
            evaluation = grouped_confirm(sloped, &slopes->groups, (double)look->k);
        }
        if (evaluation != RECOVERABLE) {
            return evaluation;
        }
        slopes->refuted[way]++;
    }
    return grouped_fill(sloped, &slopes->groups, true, grouped_move, side);
}

bool slopes_after_step(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system) {
    while (slopes->passed < slopes->n_times && slopes->times[slopes->passed] <= solver->t) {
        Look look;
        look_from(&look, slopes, solver, scale, record, system);
        const bool inside = solver->method->interpolate(solver, look.t, slopes->x + look.k * solver->problem.n);
        const Evaluation evaluation = inside ? slopes_at(&look) : RECOVERABLE;
        if (evaluation == FAILED) {
            return false;
        }
        slopes->found += evaluation == EVALUATED;
        slopes->passed++;
        failure_clear(&system->failure);
    }
    return true;
}
