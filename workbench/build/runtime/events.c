/* events.c: the first change of an event indicator's domain inside a step.
 *
 * The domain of an indicator is z > 0 or z <= 0 (FMI 2.0.4, section 3.2.2). The step is looked at in
 * several points of its dense output, so that two changes inside one step are seen unless both lie
 * between neighbouring points; the first change is then bracketed by regula falsi (Illinois variant)
 * with every third point in the middle.
 */
#include "solver.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

#define POINTS 5            /* looked at in a step */
#define POINTS_STATELESS 20 /* there the step is as long as the communication step */
#define MOST_ITERATIONS 200

static bool evaluate(Solver *s, double theta, double *z)
{
    if (theta < 1.0) {
        s->method->interpolate(s, theta, s->probe);
    } else {
        memcpy(s->probe, s->x_new, s->n * sizeof(double));
    }
    double t = s->t + theta * s->h;
    inputs_apply(s->inputs, s->core, t);
    core_set_time(s->core, t);
    core_set_states(s->core, s->probe);
    return core_get_indicators(s->core, z);
}

bool events_remember(Solver *s)
{
    if (s->n_z == 0 || core_get_indicators(s->core, s->z_start)) {
        return true;
    }
    snprintf(s->problem, sizeof s->problem, "the event indicators cannot be evaluated");
    return false;
}

static bool same_side(double a, double b)
{
    return (a > 0.0) == (b > 0.0);
}

static bool any_changed(const Solver *s, const double *z)
{
    for (size_t i = 0; i < s->n_z; i++) {
        if (!same_side(s->z_start[i], z[i])) {
            return true;
        }
    }
    return false;
}

typedef struct {
    double before; /* nothing has changed here yet: z_before */
    double after;  /* something has: z_after */
    double weight_before;
    double weight_after;
} Bracket;

/* Where the straight line says the first of the changed indicators has its root. */
static double estimate(const Solver *s, const Bracket *b)
{
    double first = b->after;
    for (size_t i = 0; i < s->n_z; i++) {
        if (same_side(s->z_start[i], s->z_after[i])) {
            continue;
        }
        double from = b->weight_before * fabs(s->z_before[i]);
        double to = b->weight_after * fabs(s->z_after[i]);
        double part = from + to > 0.0 ? from / (from + to) : 0.5;
        first = fmin(first, b->before + part * (b->after - b->before));
    }
    return first;
}

static double next_point(const Solver *s, const Bracket *b, int iteration)
{
    double middle = 0.5 * (b->before + b->after);
    if (iteration % 3 == 2) {
        return middle;
    }
    double point = estimate(s, b);
    return point > b->before && point < b->after ? point : middle;
}

static void exchange(double **a, double **b)
{
    double *kept = *a;
    *a = *b;
    *b = kept;
}

/* The Illinois rule: an end that stays twice counts half, so that both ends close in. */
static void narrow(Solver *s, Bracket *b, double point, bool changed, double *z)
{
    double **replaced = changed ? &s->z_after : &s->z_before;
    memcpy(*replaced, z, s->n_z * sizeof(double));
    if (changed) {
        b->after = point;
        b->weight_after = 1.0;
        b->weight_before *= 0.5;
    } else {
        b->before = point;
        b->weight_before = 1.0;
        b->weight_after *= 0.5;
    }
}

static double resolution(const Solver *s)
{
    double in_time = 2.0 * DBL_EPSILON * fmax(fabs(s->t), fabs(s->t + s->h));
    return fmax(in_time / s->h, 2.0 * DBL_EPSILON);
}

static Crossing locate(Solver *s, Bracket *b, double *z, double *theta)
{
    double wide_enough = resolution(s);
    for (int i = 0; i < MOST_ITERATIONS && b->after - b->before > wide_enough; i++) {
        double point = next_point(s, b, i);
        if (point <= b->before || point >= b->after) {
            break; /* neighbouring numbers */
        }
        if (!evaluate(s, point, z)) {
            return CROSSING_FAILED;
        }
        narrow(s, b, point, any_changed(s, z), z);
    }
    *theta = b->after;
    return CROSSING_FOUND;
}

Crossing events_find(Solver *s, double *theta)
{
    int points = s->n > 0 ? POINTS : POINTS_STATELESS;
    Bracket bracket = {0.0, 0.0, 1.0, 1.0};
    memcpy(s->z_before, s->z_start, s->n_z * sizeof(double));
    for (int i = 1; i <= points; i++) {
        bracket.after = i == points ? 1.0 : (double)i / (double)points;
        if (!evaluate(s, bracket.after, s->z_after)) {
            return CROSSING_FAILED;
        }
        if (any_changed(s, s->z_after)) {
            return locate(s, &bracket, s->z_scratch, theta);
        }
        bracket.before = bracket.after;
        exchange(&s->z_before, &s->z_after);
    }
    return CROSSING_NONE;
}
