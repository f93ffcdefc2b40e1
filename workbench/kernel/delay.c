/* delay.c: d(t) = u(t - T), T constant or a second input: a history of u with the breaks that events make; behind it
 * a linear system x' = A x + B d, y = C x + D d, for a plain delay without states.
 *
 * p = longest T, shortest T, whether the past before the start is given, that past, A by rows, B, C, D. Between the samples of accepted
 * steps u is a polynomial of third order, which never reaches across an event. A solver's steps are no longer than
 * the shortest T, and so long that the polynomial is good for TOLERANCE. A jump comes out T later, at an event of its
 * own; mode[0]: time of the last jump that has come out.
 */
#include "block_kind.h"

#include "../build/runtime/history.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_CAPACITY = 64, FILTER = 4 };
static const double TOLERANCE = 1e-7; /* of the largest |u| */

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
    return history_value(history->samples, history->n, s, mode[0], slope);
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
    return history_jump_after(history->samples, history->n, from);
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
    const size_t gone = history_old(history->samples, history->n, history->capacity, e->time - e->p[0]);
    if (gone > 0) {
        history->n -= gone;
        memmove(history->samples, history->samples + gone, history->n * sizeof *history->samples);
    }
}

/* How long the next step may be, from how far the last sample is off the polynomial through those before it. */
static void adapt(Element *e) {
    const History *history = e->history;
    const Sample *samples = history->samples;
    const size_t n = history->n;
    const double shortest = e->p[1], step = samples[n - 1].t - samples[n - 2].t;
    const double factor = history_factor(samples, n, TOLERANCE * history->largest);
    const double next = factor < 1.0 ? fmin(e->longest, factor * step) : fmax(e->longest, factor * step);
    e->longest = fmin(shortest, fmax(HISTORY_LEAST_STEP * shortest, next));
}

static bool push(Element *e, double begins) {
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
    e->longest = fmin(e->longest, HISTORY_FIRST_STEP * e->p[1]);
    if (last->t == e->time && last->begins >= HISTORY_JUMP) { /* a further round of the same event */
        last->u = u;
        return true;
    }
    const bool jumps = fabs(u - last->u) > HISTORY_SAME * fmax(history->largest, fabs(u));
    if (last->t == e->time && !jumps) {
        last->begins = HISTORY_KINK;
        return true;
    }
    return push(e, jumps && e->time - last->t <= HISTORY_TOGETHER * e->p[1] ? HISTORY_JUMP : HISTORY_KINK);
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
        e->longest = HISTORY_FIRST_STEP * e->p[1];
        return push(e, e->p[2] > 0.0 ? HISTORY_JUMP : HISTORY_KINK);
    }
    if (event) {
        return note_event(e);
    }
    const Sample *last = &history->samples[history->n - 1];
    if (e->time - last->t <= HISTORY_TOGETHER * e->p[1]) {
        return true;
    }
    if (!push(e, HISTORY_PLAIN)) {
        return false;
    }
    adapt(e);
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
