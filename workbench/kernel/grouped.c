#include "grouped.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Of the size of a state: far above the rounding of f, far below where its curvature counts. */
static const double NUDGE = 1e-6;

/* All states moved, the values must move as the slopes say, to this part of what the states contribute. */
static const double AGREE = 1e-4;
static const double ROUNDING = 64.0 * DBL_EPSILON;

/* Of the golden section: the states move by amounts of no simple ratio, lest two errors cancel. */
static const double GOLDEN = 0.6180339887498949;

static double size_of(const Sloped *s, size_t i) { return fmax(fabs(s->x[i]), s->scale[i]); }

static const Groups NOTHING_SAID = {0};

/* Where the rows of a state begin and end; all of them where nothing is said. */
static size_t begin_of(const Groups *groups, size_t i) { return groups->first ? groups->first[i] : 0; }

static size_t end_of(const Groups *groups, size_t n_values, size_t i) {
    return groups->first ? groups->first[i + 1] : n_values;
}

static size_t row_at(const Groups *groups, size_t j) { return groups->first ? groups->rows[j] : j; }

static Evaluation move_by(const Sloped *s, const size_t *members, size_t n, double part) {
    memcpy(s->moved, s->x, s->n * sizeof(double));
    for (size_t j = 0; j < n; j++) {
        const size_t i = members[j];
        s->moved[i] += part * size_of(s, i);
        s->step[i] = s->moved[i] - s->x[i];
    }
    const Evaluation evaluation = s->evaluate(s->owner, s->moved, s->there);
    for (size_t row = 0; row < s->n_values; row++) {
        s->there[row] -= s->here[row];
    }
    return evaluation;
}

Evaluation grouped_move(const Sloped *s, const size_t *members, size_t n, double side) {
    const Evaluation evaluation = move_by(s, members, n, side * NUDGE);
    /* At the edge of what the model can do: from the other side. */
    return evaluation == RECOVERABLE ? move_by(s, members, n, -side * NUDGE) : evaluation;
}

static void keep(const Sloped *s, const Groups *groups, size_t i) {
    for (size_t j = begin_of(groups, i); j < end_of(groups, s->n_values, i); j++) {
        const size_t row = row_at(groups, j);
        *s->slope(s->owner, i, row) = s->there[row] / s->step[i];
    }
}

Evaluation grouped_fill(const Sloped *s, const Groups *groups, bool single, Move move, double side) {
    const size_t n_groups = single ? s->n : groups->n_groups;
    size_t begin = 0;
    for (size_t g = 0; g < n_groups; g++) {
        const size_t end = single ? g + 1 : groups->ends[g];
        const Evaluation evaluation = move(s, groups->members + begin, end - begin, side);
        if (evaluation != EVALUATED) {
            return evaluation;
        }
        for (size_t j = begin; j < end; j++) {
            keep(s, single ? &NOTHING_SAID : groups, groups->members[j]);
        }
        begin = end;
    }
    return EVALUATED;
}

Evaluation grouped_confirm(const Sloped *s, const Groups *groups, double turn) {
    double *said = s->sums, *size = said + s->n_values, *noise = size + s->n_values;
    for (size_t row = 0; row < s->n_values; row++) {
        said[row] = size[row] = 0.0;
        noise[row] = fabs(s->here[row]);
    }
    for (size_t i = 0; i < s->n; i++) {
        const double far = GOLDEN * (double)(i + 1) + GOLDEN * GOLDEN * turn;
        const double part = far - floor(far) - 0.5; /* between -0.5 and 0.5 */
        s->moved[i] = s->x[i] + NUDGE * (part + copysign(0.5, part)) * size_of(s, i);
        const double step = s->moved[i] - s->x[i];
        for (size_t j = begin_of(groups, i); j < end_of(groups, s->n_values, i); j++) {
            const size_t row = row_at(groups, j);
            const double slope = *s->slope(s->owner, i, row);
            said[row] += slope * step;
            size[row] += fabs(slope * step);
            noise[row] += fabs(slope * s->x[i]);
        }
    }
    const Evaluation evaluation = s->evaluate(s->owner, s->moved, s->there);
    if (evaluation != EVALUATED) {
        return evaluation;
    }
    for (size_t row = 0; row < s->n_values; row++) {
        const double error = fabs(s->there[row] - s->here[row] - said[row]);
        if (!(error <= AGREE * size[row] + ROUNDING * noise[row])) {
            return RECOVERABLE;
        }
    }
    return EVALUATED;
}
