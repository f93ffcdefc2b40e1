/* locate.c: see locate.h.
 *
 * Regula falsi with the Illinois modification on the indicators that change, guarded by bisection;
 * the bracket, not the residual, decides when to end.
 * Source: M. Dowell, P. Jarratt, A modified regula falsi method, BIT 11 (1971).
 */
#include "locate.h"

#include <math.h>
#include <string.h>

#define RELATIVE 1e-13
#define MOST_ROUNDS 200
#define NEARLY 0.5 /* a parabola that comes this near to zero, against its known values, is looked at */

enum { VECTORS = 6 };

typedef struct {
    double low, high;               /* [s] */
    double low_weight, high_weight; /* Illinois: of an end that stands still */
    int last;                       /* the end that moved last: -1 low, 1 high */
} Bracket;

size_t watch_doubles(size_t nz) { return VECTORS * nz; }

void watch_bind(Watch *watch, size_t nz, double *memory, void *owner, Indicators indicators)
{
    double **vectors[VECTORS] = {&watch->z,    &watch->before, &watch->low,
                                 &watch->high, &watch->middle, &watch->probe};
    for (size_t i = 0; i < VECTORS; i++) {
        *vectors[i] = memory + i * nz;
    }
    watch->nz = nz;
    watch->owner = owner;
    watch->indicators = indicators;
    watch->has_before = false;
}

static void copy(const Watch *watch, double *to, const double *from)
{
    memcpy(to, from, watch->nz * sizeof *to);
}

/* NaN belongs to no domain. */
static Evaluation ask(const Watch *watch, double t, double *z)
{
    Evaluation evaluation = watch->indicators(watch->owner, t, z);
    for (size_t i = 0; evaluation == EVALUATED && i < watch->nz; i++) {
        if (isnan(z[i])) {
            evaluation = RECOVERABLE;
        }
    }
    return evaluation;
}

static bool differs(double a, double b) { return (a > 0.0) != (b > 0.0); }

static bool changed(const Watch *watch, const double *z)
{
    for (size_t i = 0; i < watch->nz; i++) {
        if (differs(watch->z[i], z[i])) {
            return true;
        }
    }
    return false;
}

Evaluation watch_restart(Watch *watch, double t)
{
    watch->has_before = false;
    return watch->nz == 0 ? EVALUATED : ask(watch, t, watch->z);
}

static void take_low(Watch *watch, Bracket *b, double t, const double *z)
{
    copy(watch, watch->low, z);
    b->low = t;
    b->low_weight = 1.0;
    b->high_weight = b->last == -1 ? 0.5 * b->high_weight : 1.0;
    b->last = -1;
}

static void take_high(Watch *watch, Bracket *b, double t, const double *z)
{
    copy(watch, watch->high, z);
    b->high = t;
    b->high_weight = 1.0;
    b->low_weight = b->last == 1 ? 0.5 * b->low_weight : 1.0;
    b->last = 1;
}

/* Might an indicator have left its domain and returned? Only where it is nearer to zero than it moves. */
static bool suspicious(const Watch *watch, double t_old, double t)
{
    if (!watch->has_before) {
        return true;
    }
    const double ratio = (t - t_old) / (t_old - watch->t_before);
    for (size_t i = 0; i < watch->nz; i++) {
        const double z = watch->z[i], end = watch->high[i];
        const double moved = fmax(fabs(end - z), ratio * fabs(z - watch->before[i]));
        if (fmin(fabs(z), fabs(end)) < moved) {
            return true;
        }
    }
    return false;
}

/* Where in (0, 1) the parabola through z(0), z(1/2), z(1) crosses zero and returns, or nearly; else 0. */
static double dip(double start, double middle, double end)
{
    const double square = 2.0 * (start - 2.0 * middle + end);
    const double slope = 4.0 * middle - 3.0 * start - end;
    const double place = -0.5 * slope / square;
    if (differs(start, middle) || differs(start, end) || !(place > 0.01 && place < 0.99)) {
        return 0.0;
    }
    const double value = start + 0.5 * slope * place;
    const double nearest = fmin(fabs(start), fmin(fabs(middle), fabs(end)));
    return differs(start, value) || fabs(value) < NEARLY * nearest ? place : 0.0;
}

static Evaluation look_at_dips(Watch *watch, Bracket *b)
{
    const double begin = b->low, width = b->high - b->low;
    for (size_t i = 0; i < watch->nz; i++) {
        const double place = dip(watch->z[i], watch->middle[i], watch->high[i]);
        const double t = begin + place * width;
        if (place == 0.0 || !(t < b->high)) {
            continue;
        }
        Evaluation evaluation = ask(watch, t, watch->probe);
        if (evaluation != EVALUATED) {
            return evaluation;
        }
        if (changed(watch, watch->probe)) {
            take_high(watch, b, t, watch->probe);
            return EVALUATED; /* the parabolas went through the former end */
        }
    }
    return EVALUATED;
}

static Evaluation look_inside(Watch *watch, Bracket *b)
{
    const double middle = b->low + 0.5 * (b->high - b->low);
    if (!(middle > b->low && middle < b->high)) {
        return EVALUATED;
    }
    Evaluation evaluation = ask(watch, middle, watch->middle);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    if (changed(watch, watch->middle)) {
        take_high(watch, b, middle, watch->middle);
        return EVALUATED;
    }
    evaluation = look_at_dips(watch, b);
    if (evaluation == EVALUATED && middle < b->high) {
        take_low(watch, b, middle, watch->middle);
    }
    return evaluation;
}

/* Where the first of the indicators that change seems to cross zero. */
static double guess(const Watch *watch, const Bracket *b)
{
    double first = INFINITY;
    for (size_t i = 0; i < watch->nz; i++) {
        const double low = b->low_weight * watch->low[i], high = b->high_weight * watch->high[i];
        if (differs(watch->low[i], watch->high[i])) {
            first = fmin(first, b->low + (b->high - b->low) * (low / (low - high)));
        }
    }
    return first > b->low && first < b->high ? first : b->low + 0.5 * (b->high - b->low);
}

static double narrow_enough(const Bracket *b)
{
    const double size = fmax(fmax(fabs(b->low), fabs(b->high)), b->high - b->low);
    const double digit = nextafter(fabs(b->high), INFINITY) - fabs(b->high);
    return fmax(RELATIVE * size, 4.0 * digit);
}

static Evaluation narrow(Watch *watch, Bracket *b)
{
    double three_ago = INFINITY;
    for (int round = 0; round < MOST_ROUNDS; round++) {
        const double width = b->high - b->low, enough = narrow_enough(b);
        if (width <= enough) {
            break;
        }
        double t = guess(watch, b);
        if (round % 3 == 2) { /* no slower than bisection, whatever the shape */
            t = width > 0.125 * three_ago ? b->low + 0.5 * width : t;
            three_ago = width;
        }
        t = fmin(fmax(t, b->low + 0.4 * enough), b->high - 0.4 * enough);
        Evaluation evaluation = ask(watch, t, watch->probe);
        if (evaluation != EVALUATED) {
            return evaluation;
        }
        if (changed(watch, watch->probe)) {
            take_high(watch, b, t, watch->probe);
        } else {
            take_low(watch, b, t, watch->probe);
        }
    }
    return EVALUATED;
}

static void go_on(Watch *watch, double t_old)
{
    copy(watch, watch->before, watch->z);
    copy(watch, watch->z, watch->high);
    watch->t_before = t_old;
    watch->has_before = true;
}

Evaluation watch_step(Watch *watch, double t_old, double *t, bool *event)
{
    *event = false;
    if (watch->nz == 0) {
        return EVALUATED;
    }
    Bracket b = {.low = t_old, .high = *t, .low_weight = 1.0, .high_weight = 1.0};
    copy(watch, watch->low, watch->z);
    Evaluation evaluation = ask(watch, *t, watch->high);
    if (evaluation == EVALUATED && suspicious(watch, t_old, *t)) {
        evaluation = look_inside(watch, &b);
    }
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    const bool found = changed(watch, watch->high);
    evaluation = found ? narrow(watch, &b) : EVALUATED;
    if (evaluation == EVALUATED) {
        *t = b.high;
        *event = found;
        go_on(watch, t_old);
    }
    return evaluation;
}
