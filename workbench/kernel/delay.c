/* delay.c: d(t) = u(t - T), T constant or a second input: a history of u with the breaks that events make; behind it
 * a linear system x' = A x + B d, y = C x + D d, for a plain delay without states.
 *
 * p = longest T, shortest T, whether the past before the start is given, that past, A by rows, B, C, D. Between the samples of accepted
 * steps u is a polynomial of third order, which never reaches across an event. A solver's steps are no longer than
 * the shortest T, and so long that the polynomial is good for TOLERANCE. A jump comes out T later, at an event of its
 * own; mode[0]: time of the last jump that has come out.
 */
#include "block_kind.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { POINTS = 4, FIRST_CAPACITY = 64, FILTER = 4 };
enum { PLAIN, KINK, JUMP }; /* what begins with a sample */
static const double TOLERANCE = 1e-7; /* of the largest |u| */
static const double ERROR_PART = 0.0234375; /* of a cubic between its middle points, of that one step beyond them */
static const double FIRST_STEP = 5e-3, LEAST_STEP = 1e-3, TOGETHER = 1e-6; /* of the shortest T */
static const double SAME = 1e-9; /* of the largest |u|: a smaller jump is none */

typedef struct {
    double t, u;
    int begins;
} Sample;

typedef struct History {
    Sample *samples;
    size_t n, capacity;
    double largest; /* |u| so far */
} History;

void history_free(History *history) {
    if (history) {
        free(history->samples);
    }
    free(history);
}

static bool reserve(History *history, size_t n) {
    if (n <= history->capacity) {
        return true;
    }
    const size_t capacity = n > 2 * history->capacity ? n : 2 * history->capacity;
    Sample *samples = realloc(history->samples, capacity * sizeof *samples);
    if (!samples) {
        return false;
    }
    history->samples = samples;
    history->capacity = capacity;
    return true;
}

static History *history_new(void) {
    History *made = calloc(1, sizeof *made);
    if (made && !reserve(made, FIRST_CAPACITY)) {
        free(made);
        made = NULL;
    }
    return made;
}

bool history_copy(History **to, const History *from) {
    if (!from) {
        history_free(*to);
        *to = NULL;
        return true;
    }
    if (!*to) {
        *to = history_new();
    }
    if (!*to || !reserve(*to, from->n)) {
        return false;
    }
    (*to)->n = from->n;
    (*to)->largest = from->largest;
    memcpy((*to)->samples, from->samples, from->n * sizeof *from->samples);
    return true;
}

/* ---- reading ---- */

static double delay_of(const Element *e) {
    return e->nu > 1 ? fmin(fmax(e->memory[1], e->p[1]), e->p[0]) : e->p[0];
}

/* Number of samples up to time s, those at s included. */
static size_t up_to(const History *history, double s) {
    size_t low = 0, high = history->n;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (history->samples[middle].t <= s) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

/* The polynomial through samples [first, last] at s, and its derivative. */
static double polynomial(const Sample *samples, size_t first, size_t last, double s, double *slope) {
    const double base = samples[first].u; /* a constant comes out as it is */
    double value = base;
    *slope = 0.0;
    for (size_t i = first; i <= last; i++) {
        double weight = 1.0, change = 0.0;
        for (size_t j = first; j <= last; j++) {
            if (j != i) {
                const double width = samples[i].t - samples[j].t;
                change = change * (s - samples[j].t) / width + weight / width;
                weight *= (s - samples[j].t) / width;
            }
        }
        value += weight * (samples[i].u - base);
        *slope += change * (samples[i].u - base);
    }
    return value;
}

/* The samples of one smooth piece around [i, i + 1], POINTS at most. */
static void around(const History *history, size_t *first, size_t *last) {
    const Sample *samples = history->samples;
    bool moved = true;
    while (moved && *last - *first + 1 < POINTS) {
        moved = false;
        if (*first > 0 && samples[*first].begins == PLAIN) {
            (*first)--;
            moved = true;
        }
        if (*last - *first + 1 < POINTS && *last + 1 < history->n && samples[*last].begins == PLAIN &&
            samples[*last + 1].begins != JUMP) {
            (*last)++;
            moved = true;
        }
    }
}

static bool has_begun(const Element *e) {
    const History *history = e->history;
    return history && history->n && (history->n > 1 || e->time > history->samples[0].t);
}

static double past(const Element *e) {
    return e->p[2] > 0.0 ? e->p[3] : has_begun(e) ? e->history->samples[0].u : e->memory[0];
}

/* u at the present time less the delay, on that side of jumps that the mode says. */
static double delayed(const Element *e, const double *mode, double *slope) {
    const History *history = e->history;
    const double s = e->time - delay_of(e);
    *slope = 0.0;
    if (!has_begun(e) || (e->p[2] > 0.0 && !isfinite(mode[0]))) {
        return past(e);
    }
    const Sample *samples = history->samples;
    size_t i = up_to(history, s);
    if (i == 0) {
        return samples[0].u; /* the past */
    }
    i--;
    while (samples[i].begins == JUMP && samples[i].t > mode[0]) {
        i--; /* it has not come out yet */
    }
    while (i + 1 < history->n && samples[i + 1].t <= mode[0]) {
        i++; /* it has, a rounding error earlier */
    }
    if (i + 1 >= history->n || samples[i + 1].begins == JUMP) { /* at the end of a piece */
        if (samples[i].t >= s || samples[i].begins != PLAIN || i == 0) {
            return samples[i].u;
        }
        i--;
    }
    size_t first = i, last = i + 1;
    around(history, &first, &last);
    return polynomial(samples, first, last, fmax(s, samples[i].t), slope);
}

/* Row of the linear system, ∂(dx, y) / ∂(x, d): entry `column`, that of d is nx. */
static double behind(const Element *e, size_t row, size_t column) {
    const size_t n = e->nx;
    const double *a = e->p + FILTER, *b = a + n * n, *c = b + n, *d = c + n;
    return row < n ? (column < n ? a[row * n + column] : b[row]) : column < n ? c[column] : *d;
}

static double driven(const Element *e, size_t row, double d) {
    double value = behind(e, row, e->nx) * d;
    for (size_t k = 0; k < e->nx; k++) {
        value += behind(e, row, k) * element_states(e)[k];
    }
    return value;
}

static double delay_output(const Element *e, const double *mode) {
    double slope;
    return driven(e, e->nx, delayed(e, mode, &slope));
}

static void delay_rates(const Element *e, const double *mode, double *dx) {
    double slope;
    const double d = delayed(e, mode, &slope);
    for (size_t row = 0; row < e->nx; row++) {
        dx[row] = driven(e, row, d);
    }
}

static double delay_slope(const Element *e, const double *mode, size_t row, size_t column) {
    double slope;
    if (column >= e->nu) {
        return behind(e, row, column - e->nu);
    }
    delayed(e, mode, &slope);
    const bool moves = e->memory[1] > e->p[1] && e->memory[1] < e->p[0];
    return behind(e, row, e->nx) * (column == 1 ? (moves ? -slope : 0.0) : e->p[2] == 0.0 && !has_begun(e));
}

/* ---- jumps ---- */

/* The first jump after the time `from`; NULL: none is known. The first sample counts: the given past ends there. */
static const Sample *jump_after(const History *history, double from) {
    for (size_t i = up_to(history, from); i < history->n; i++) {
        if (history->samples[i].begins == JUMP) {
            return &history->samples[i];
        }
    }
    return NULL;
}

static void delay_choose(const Element *e, double *mode) {
    const double delay = delay_of(e);
    const Sample *jump = e->history ? jump_after(e->history, mode[0]) : NULL;
    while (jump && (jump->t + delay <= e->time || e->time - delay > jump->t)) {
        mode[0] = jump->t;
        jump = jump_after(e->history, mode[0]);
    }
}

static double delay_next(const Element *e) {
    const Sample *jump = e->history ? jump_after(e->history, e->mode[0]) : NULL;
    return jump && e->nu == 1 ? jump->t + e->p[0] : (double)INFINITY;
}

static void delay_indicators(const Element *e, double *z) {
    const Sample *jump = e->history ? jump_after(e->history, e->mode[0]) : NULL;
    z[0] = jump ? e->time - delay_of(e) - jump->t : -1.0;
}

/* ---- writing ---- */

/* Forget what nobody will ask for again. */
static void prune(Element *e) {
    History *history = e->history;
    const size_t old = up_to(history, e->time - e->p[0]);
    if (old > POINTS + 1 && old - POINTS > history->capacity / 2) {
        const size_t gone = old - POINTS - 1;
        history->n -= gone;
        memmove(history->samples, history->samples + gone, history->n * sizeof *history->samples);
    }
}

/* How long the next step may be, from how far the last sample is off the polynomial through those before it. */
static void adapt(Element *e, size_t first) {
    const History *history = e->history;
    const Sample *samples = history->samples;
    const size_t n = history->n;
    const double shortest = e->p[1], step = samples[n - 1].t - samples[n - 2].t;
    double slope, factor = 1.0; /* until there are points to judge by */
    if (n - 1 - first >= POINTS) {
        const double guess = polynomial(samples, n - 1 - POINTS, n - 2, samples[n - 1].t, &slope);
        const double error = ERROR_PART * fabs(samples[n - 1].u - guess);
        factor = error > 0.0 ? fmin(2.0, fmax(0.2, 0.9 * sqrt(sqrt(TOLERANCE * history->largest / error)))) : 2.0;
    }
    const double next = factor < 1.0 ? fmin(e->longest, factor * step) : fmax(e->longest, factor * step);
    e->longest = fmin(shortest, fmax(LEAST_STEP * shortest, next));
}

static bool push(Element *e, int begins) {
    History *history = e->history;
    const double u = e->memory[0];
    if (!reserve(history, history->n + 1)) {
        return false;
    }
    history->samples[history->n++] = (Sample){e->time, u, begins};
    history->largest = fmax(history->largest, fabs(u));
    return true;
}

/* At an event: u may jump, and has a kink at best. */
static bool note_event(Element *e) {
    History *history = e->history;
    Sample *last = &history->samples[history->n - 1];
    const double u = e->memory[0];
    e->longest = fmin(e->longest, FIRST_STEP * e->p[1]);
    if (last->t == e->time && last->begins == JUMP) { /* a further round of the same event */
        last->u = u;
        return true;
    }
    const bool jumps = fabs(u - last->u) > SAME * fmax(history->largest, fabs(u));
    if (last->t == e->time && !jumps) {
        last->begins = KINK;
        return true;
    }
    return push(e, jumps && e->time - last->t <= TOGETHER * e->p[1] ? JUMP : KINK);
}

static bool delay_note(Element *e, bool event) {
    if (!e->history) {
        e->history = history_new();
        if (!e->history) {
            return false;
        }
    }
    History *history = e->history;
    if (!has_begun(e)) { /* the past is what stands at the start; one that is given ends with a jump */
        history->n = 0;
        history->largest = 0.0;
        e->longest = FIRST_STEP * e->p[1];
        return push(e, e->p[2] > 0.0 ? JUMP : KINK);
    }
    if (event) {
        return note_event(e);
    }
    const Sample *last = &history->samples[history->n - 1];
    if (e->time - last->t <= TOGETHER * e->p[1]) {
        return true;
    }
    if (!push(e, PLAIN)) {
        return false;
    }
    size_t first = history->n - 1;
    while (first > 0 && history->n - first <= POINTS + 1 && history->samples[first].begins == PLAIN) {
        first--;
    }
    adapt(e, first);
    prune(e);
    return true;
}

const BlockKind block_delay = {
    .choose = delay_choose,
    .output = delay_output,
    .rates = delay_rates,
    .indicators = delay_indicators,
    .slope = delay_slope,
    .note = delay_note,
    .next = delay_next,
};
