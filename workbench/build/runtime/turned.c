/* turned.c: what an event should have kept from going on (see turned.h). */
#include "turned.h"

#include "event_rules.h"

#include <math.h>
#include <string.h>

typedef struct {
    double *bound, *way, *z; /* [n_z] */
    double *x, *dx;          /* [n] */
} Before;

size_t turned_doubles(void)
{
    return 3 * model_info.n_indicators + 2 * model_info.n_states;
}

static Before before_in(double *vectors)
{
    double *states = vectors + 3 * model_info.n_indicators;
    return (Before){vectors, vectors + model_info.n_indicators, vectors + 2 * model_info.n_indicators, states,
                    states + model_info.n_states};
}

static double ahead(const Solver *s, const double *dx, double span)
{
    double longest = AHEAD_MOST * span;
    for (size_t i = 0; i < s->n; i++) {
        double nominal = fabs(model_info.state_nominals[i]);
        double size = fabs(s->x[i]) + 0.01 * (nominal > 0.0 ? nominal : 1.0);
        longest = dx[i] != 0.0 ? fmin(longest, AHEAD * (size / fabs(dx[i]))) : longest;
    }
    return longest;
}

static void back(Solver *s)
{
    inputs_apply(s->inputs, s->core, s->t);
    core_set_time(s->core, s->t);
    core_set_states(s->core, s->x);
}

/* The indicators where the solver stands, and a little ahead along its derivatives; the core stays there. */
static bool look(Solver *s, double step, double *dx, double *z, double *later)
{
    bool good = solver_evaluate(s, s->t, s->x, dx) && core_get_indicators(s->core, z);
    for (size_t i = 0; i < s->n; i++) {
        s->probe[i] = s->x[i] + step * dx[i];
    }
    inputs_apply(s->inputs, s->core, s->t + step);
    core_set_time(s->core, s->t + step);
    core_set_states(s->core, s->probe);
    good = good && core_get_indicators(s->core, later);
    back(s);
    return good;
}

void turned_before(Turned *turned, double *vectors, Solver *s, bool located, double span)
{
    Before b = before_in(vectors);
    turned->known = 0.0;
    if (s->n_z == 0 || !(located || turned->watches != 0.0) || !solver_evaluate(s, s->t, s->x, b.dx)) {
        return;
    }
    turned->ahead = ahead(s, b.dx, span);
    memcpy(b.x, s->x, s->n * sizeof(double));
    if (look(s, turned->ahead, b.dx, b.z, b.way)) {
        turned->known = 1.0;
        for (size_t i = 0; i < s->n_z; i++) {
            bool came = (s->z_start[i] > 0.0) != (b.z[i] > 0.0);
            b.way[i] = came ? b.way[i] - b.z[i] : NAN; /* which no comparison is true of */
        }
    }
}

static bool same(const double *a, const double *b, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (a[i] != b[i]) {
            return false;
        }
    }
    return true;
}

static void watch(Turned *turned, const Before *b, Solver *s)
{
    for (size_t i = 0; i < s->n_z; i++) {
        double z = s->z_before[i];
        if (turned_back(b->z[i], b->way[i], z, s->z_after[i] - z)) {
            b->bound[i] = turned_bound(b->way[i], z);
            turned->since = s->t;
        }
    }
}

void turned_after(Turned *turned, double *vectors, Solver *s)
{
    Before b = before_in(vectors);
    if (turned->known == 0.0) {
        return;
    }
    bool looked = look(s, turned->ahead, s->dx, s->z_before, s->z_after);
    bool restarted = !same(b.x, s->x, s->n);
    bool moved = !looked || restarted || !same(b.dx, s->dx, s->n);
    turned->known = turned->watches = 0.0;
    for (size_t i = 0; i < s->n_z; i++) {
        if (moved || (s->z_before[i] > 0.0) != (b.bound[i] > 0.0)) {
            b.bound[i] = 0.0;
        }
    }
    if (looked && restarted) {
        watch(turned, &b, s);
    }
    for (size_t i = 0; i < s->n_z; i++) {
        turned->watches = b.bound[i] != 0.0 ? 1.0 : turned->watches;
    }
}

bool turned_went_through(const Turned *turned, const double *vectors, Solver *s)
{
    if (turned->watches == 0.0 || !core_get_indicators(s->core, s->z_scratch)) {
        return false;
    }
    for (size_t i = 0; i < s->n_z; i++) {
        if (turned_beyond(vectors[i], s->z_scratch[i])) {
            return true;
        }
    }
    return false;
}
