#include "clocks.h"

#include <math.h>

enum { UNCHANGED = 1, CHANGED = 2 }; /* of fmi3IntervalQualifier */

double clocks_next(const Clocks *clocks) {
    double next = (double)INFINITY;
    for (size_t i = 0; clocks && i < clocks->n; i++) {
        next = fmin(next, clocks->ticks[i].next);
    }
    return next;
}

size_t clocks_due(Clocks *clocks, double time) {
    size_t n = 0;
    for (size_t i = 0; i < clocks->n; i++) {
        Tick *tick = &clocks->ticks[i];
        if (is_due(tick->next, time)) {
            clocks->references[n] = tick->reference;
            clocks->active[n++] = true;
            tick->ticked = 1;
            clocks->counts[tick->place]++;
            tick->count++;
            tick->next = tick->kind == APERIODIC ? (double)INFINITY : instant(&tick->instants, tick->count);
        }
    }
    return n;
}

void clocks_told(Clocks *clocks) {
    for (size_t i = 0; i < clocks->n_told; i++) {
        clocks->counts[clocks->places[i]] += clocks->active[i] ? 1.0 : 0.0;
    }
}

size_t clocks_asked(Clocks *clocks) {
    size_t n = 0;
    for (size_t i = 0; i < clocks->n; i++) {
        if (clocks->ticks[i].kind != PERIODIC) {
            clocks->references[n++] = clocks->ticks[i].reference;
        }
    }
    return n;
}

bool clocks_answered(Clocks *clocks, double time) {
    size_t n = 0;
    for (size_t i = 0; i < clocks->n; i++) {
        Tick *tick = &clocks->ticks[i];
        if (tick->kind == PERIODIC) {
            continue;
        }
        const double interval = clocks->intervals[n];
        const int32_t qualifier = clocks->qualifiers[n++];
        if (qualifier == CHANGED || (tick->ticked && tick->kind == APERIODIC && qualifier == UNCHANGED)) {
            if (!(interval >= 0.0) || isinf(interval)) {
                return false;
            }
            tick->next = time + interval;
            tick->instants = (Instants){tick->next, interval, 1.0};
            tick->count = 0.0;
        }
        tick->ticked = 0;
    }
    return true;
}
