#include "slopes.h"

#include <float.h>
#include <math.h>

/* Of the size of a state: far above the rounding of f, far below where its curvature counts. */
static const double NUDGE = 1e-6;

/* All states moved, f and y must move as the slopes say, to this part of what the states contribute. */
static const double AGREE = 1e-4;
static const double ROUNDING = 64.0 * DBL_EPSILON;

/* Of the golden section: the states move by amounts of no simple ratio, lest two errors cancel. */
static const double GOLDEN = 0.6180339887498949;

/* One of the times. */
typedef struct {
    Slopes *slopes;
    const Problem *problem;
    const double *scale;
    Record *record;
    System *system;
    double t;
    size_t n, q, k;
    const double *x;
    double *here, *there; /* [n + q] f and y at x, and elsewhere */
    double *moved, *step; /* [n] states elsewhere, and how far they are moved */
} Look;

static Look look_from(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system) {
    const size_t n = solver->problem.n, q = record->n_values, k = slopes->passed;
    double *w = slopes->work;
    return (Look){
        .slopes = slopes, .problem = &solver->problem, .scale = scale, .record = record, .system = system,
        .t = slopes->times[k], .n = n, .q = q, .k = k, .x = slopes->x + k * n,
        .moved = w, .step = w + n, .here = w + 2 * n, .there = w + 3 * n + q,
    };
}

/* Derivatives and recorded values at states x. */
static Evaluation evaluate(const Look *look, const double *x, double *values) {
    const Evaluation evaluation = look->problem->derivatives(look->problem->owner, look->t, x, values);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    Record *record = look->record;
    System *system = look->system;
    return access_read(&record->access, system->components, values + look->n, &system->failure) ? EVALUATED : FAILED;
}

/* ∂(f, y)/∂x_i at a row. */
static double *slope(const Look *look, size_t i, size_t row) {
    const size_t state = look->k * look->n + i;
    return row < look->n ? &look->slopes->a[state * look->n + row]
                         : &look->slopes->c[state * look->q + row - look->n];
}

/* Move some of the states by `part` of their size, and see what f and y do. */
static Evaluation move_by(const Look *look, const size_t *members, size_t n, double part) {
    copy_values(look->moved, look->x, look->n);
    for (size_t j = 0; j < n; j++) {
        const size_t i = members[j];
        look->moved[i] += part * fmax(fabs(look->x[i]), look->scale[i]);
        look->step[i] = look->moved[i] - look->x[i];
    }
    const Evaluation evaluation = evaluate(look, look->moved, look->there);
    for (size_t row = 0; row < look->n + look->q; row++) {
        look->there[row] -= look->here[row];
    }
    return evaluation;
}

static Evaluation move(const Look *look, const size_t *members, size_t n) {
    /* To one side and the other in turn: what the curvature of f leaves cancels between neighbours. */
    const double part = look->k % 2 ? -NUDGE : NUDGE;
    const Evaluation evaluation = move_by(look, members, n, part);
    /* At the edge of what the model can do: from the other side. */
    return evaluation == RECOVERABLE ? move_by(look, members, n, -part) : evaluation;
}

/* Ask the FMU, which stands at x, for the movement. RECOVERABLE: it does not say. */
static Evaluation ask(const Look *look, size_t begin, size_t end) {
    const Slopes *slopes = look->slopes;
    const Component *component = &look->system->components[0];
    for (size_t j = begin; j < end; j++) {
        look->step[slopes->members[j]] = 1.0;
        look->moved[j] = 1.0;
    }
    const int status = component->calls->directional
                           ? component->calls->directional(component, slopes->unknowns, look->n + look->q,
                                                           slopes->knowns + begin, look->moved + begin, end - begin,
                                                           look->there)
                           : NOT_EXPORTED;
    if (status == FMI_FATAL) {
        component_checked(component, GET_DIRECTIONAL, status, 0, &look->system->failure);
        return FAILED;
    }
    return status >= 0 && status <= FMI_WARNING ? EVALUATED : RECOVERABLE;
}

static void keep(const Look *look, size_t i, bool all) {
    const Slopes *slopes = look->slopes;
    const size_t *first = all ? NULL : slopes->first;
    const size_t begin = first ? first[i] : 0, end = first ? first[i + 1] : look->n + look->q;
    for (size_t j = begin; j < end; j++) {
        const size_t row = first ? slopes->rows[j] : j;
        *slope(look, i, row) = look->there[row] / look->step[i];
    }
}

static Evaluation fill(const Look *look, SlopesWay way) {
    const Slopes *slopes = look->slopes;
    const bool single = way == BY_STATES;
    const size_t n_groups = single ? look->n : slopes->n_groups;
    size_t begin = 0;
    for (size_t g = 0; g < n_groups; g++) {
        const size_t end = single ? g + 1 : slopes->ends[g];
        const Evaluation evaluation =
            way == BY_DIRECTIONAL ? ask(look, begin, end) : move(look, slopes->members + begin, end - begin);
        if (evaluation != EVALUATED) {
            return evaluation;
        }
        for (size_t j = begin; j < end; j++) {
            keep(look, slopes->members[j], single);
        }
        begin = end;
    }
    return EVALUATED;
}

/* Whether f and y move as the slopes say when all states do; EVALUATED: they do. */
static Evaluation confirm(const Look *look) {
    for (size_t i = 0; i < look->n; i++) {
        const double turn = GOLDEN * (double)(i + 1) + GOLDEN * GOLDEN * (double)look->k;
        const double part = turn - floor(turn) - 0.5; /* between -0.5 and 0.5 */
        const double size = fmax(fabs(look->x[i]), look->scale[i]);
        look->moved[i] = look->x[i] + NUDGE * (part + copysign(0.5, part)) * size;
        look->step[i] = look->moved[i] - look->x[i];
    }
    const Evaluation evaluation = evaluate(look, look->moved, look->there);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    for (size_t row = 0; row < look->n + look->q; row++) {
        double said = 0.0, size = 0.0, noise = fabs(look->here[row]);
        for (size_t i = 0; i < look->n; i++) {
            const double of_state = *slope(look, i, row);
            said += of_state * look->step[i];
            size += fabs(of_state * look->step[i]);
            noise += fabs(of_state * look->x[i]);
        }
        if (!(fabs(look->there[row] - look->here[row] - said) <= AGREE * size + ROUNDING * noise)) {
            return RECOVERABLE;
        }
    }
    return EVALUATED;
}

static Evaluation slopes_at(const Look *look) {
    Slopes *slopes = look->slopes;
    Evaluation evaluation = evaluate(look, look->x, look->here);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    copy_values(slopes->dx + look->k * look->n, look->here, look->n);
    for (int32_t way = slopes->way; way < BY_STATES; way++) {
        if (way == BY_GROUPS && slopes->n_groups == look->n) {
            continue; /* nothing is won */
        }
        evaluation = fill(look, (SlopesWay)way);
        if (evaluation == EVALUATED) {
            evaluation = confirm(look);
        }
        if (evaluation != RECOVERABLE) {
            return evaluation;
        }
        slopes->refuted[way]++;
    }
    return fill(look, BY_STATES);
}

bool slopes_after_step(Slopes *slopes, const Solver *solver, const double *scale, Record *record, System *system) {
    while (slopes->passed < slopes->n_times && slopes->times[slopes->passed] <= solver->t) {
        const Look look = look_from(slopes, solver, scale, record, system);
        const bool inside = solver->method->interpolate(solver, look.t, slopes->x + look.k * look.n);
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
