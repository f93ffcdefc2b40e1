/* instants.h: when something samples: instants are counted, never added up, and those that only rounding tells apart
 * are one. The twin of workbench/core/values/calendar.py.
 */
#ifndef WORKBENCH_KERNEL_INSTANTS_H
#define WORKBENCH_KERNEL_INSTANTS_H

#include <math.h>
#include <stdbool.h>

/* Instant k is (first + k · step) / denominator [s], all whole numbers: it is rounded once, and instants that coincide
 * are the same double. step 0: there are none. */
typedef struct {
    double first, step, denominator;
} Instants;

static inline double instant(const Instants *instants, double k) {
    return (instants->first + k * instants->step) / instants->denominator;
}

/* The first instant later than `clear` [s]. */
static inline double instant_after(const Instants *instants, double clear) {
    double k = fmax(0.0, floor((clear * instants->denominator - instants->first) / instants->step));
    while (instant(instants, k) <= clear) {
        k++;
    }
    return instant(instants, k);
}

/* Whoever adds up its period is off by half an ulp of the time with each tick at most: two million of them. */
static const double MOST_ROUNDED = 1048576.0; /* ulps */

/* How far apart two times of this size may lie and still be the same instant [s]. */
static inline double rounding(double time) {
    return MOST_ROUNDED * (nextafter(fabs(time), (double)INFINITY) - fabs(time));
}

/* The same for what is due `wait` after the stop before: of one period, two million that are added up from 0 on are off
 * by its 4096th part at most. At a late start a period is short beside that rounding, and few were added up: 8192 are
 * off by a 256th of it. */
static inline double rounding_of(double time, double wait) {
    return fmin(rounding(time), fmax(fabs(wait) / 4096.0, rounding(time) / 256.0));
}

/* Whether `due` is now or past, or only rounding puts it later. */
static inline bool is_due(double due, double now) {
    return due <= now || due - now <= rounding(now);
}

/* The next instants after `now`: the first, and the last of those that are one with it. Their event is at the last, so
 * that everything that is due finds its time reached. */
typedef struct {
    double now, first, last; /* [s] */
} Gathered;

static inline Gathered gathered_after(double now) {
    return (Gathered){now, (double)INFINITY, (double)INFINITY};
}

static inline void gather(Gathered *g, double due) {
    const double first = fmin(due, g->first), last = fmax(due, g->last);
    const double width = rounding_of(fmax(fabs(g->now), fabs(first)), first - g->now);
    const bool one = last <= first + width;
    g->last = one ? last : due < g->first ? due : g->last;
    g->first = first;
}

#endif
