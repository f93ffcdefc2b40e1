/* event_rules.h: what the events of a run say about the model: chattering, Zeno behaviour, a contact that gives way.
 *
 * One source for the runtime of built FMUs (Co-Simulation) and for the kernel (Model Exchange), which
 * includes it from here; the readable driver in Python, with which tests compare the kernel, has the same numbers.
 */
#ifndef WORKBENCH_EVENT_RULES_H
#define WORKBENCH_EVENT_RULES_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* ---- events without progress of time: the model slides along a switching surface ---- */

#define MOST_CLOSE_EVENTS 1000 /* many switches of one kind may go at the same instant, a rounding error apart */
#define CLOSE_EVENTS 1e-10     /* of the time scale */

/* ---- infinitely many state events before a finite time (Zeno behaviour) ----
 *
 * The gaps between the bounces of a ball shrink as a geometric series, whose end is extrapolated. It is
 * told before the events drown in rounding, or in the width of the indicators' zeros: from then on the
 * next one is missed, and the ball falls through its floor.
 */

#define SAME_EVENT 1e-3     /* a gap of less than this part of the one before is none */
#define DWINDLED 1e-3       /* gaps that shrink are Zeno behaviour from this part of the longest two on ... */
#define DWINDLING_REST 1e-6 /* ... where their sum to the end is this part of the time scale ... */
#define DROWNING 0.1        /* ... or an indicator takes this part of the gap before to leave its zero ... */
#define DROWNING_REST 1e-3  /* ... and the sum is this part */

enum { FLIGHTS_GAPS = 7, FLIGHTS_RATIOS = FLIGHTS_GAPS - 3 };

/* Only doubles: it lies in a saved state. */
typedef struct {
    double last;               /* state event that is not an indicator leaving its zero again [s] */
    double gaps[FLIGHTS_GAPS]; /* between such events, the latest first; HUGE_VAL: none [s] */
    double longest_pair;       /* two successive gaps, before they began to shrink [s] */
    double gathering;          /* where the events gather as of the last one, HUGE_VAL: nowhere [s] */
    double event;              /* the last event of any kind [s] */
    double close;              /* events in a row without progress of time */
} Flights;

static inline void flights_forget(Flights *f)
{
    f->last = f->event = -HUGE_VAL;
    f->longest_pair = f->gathering = HUGE_VAL;
    f->close = 0.0;
    for (int i = 0; i < FLIGHTS_GAPS; i++) {
        f->gaps[i] = HUGE_VAL;
    }
}

/* An event of any kind at `now`; `span` is the time scale. True: too many of them without progress. */
static inline bool flights_chatter(Flights *f, double now, double span)
{
    double progress = now - f->event;
    f->close = progress >= 0.0 && progress <= CLOSE_EVENTS * span ? f->close + 1.0 : 0.0;
    f->event = now;
    return f->close > MOST_CLOSE_EVENTS;
}

/* Count a state event at `now`. False: it is an indicator that leaves its zero again. */
static inline bool flights_count(Flights *f, double now)
{
    double *g = f->gaps;
    double gap = now - f->last;
    if (gap < SAME_EVENT * g[0] && isfinite(g[0])) {
        return false;
    }
    f->last = now;
    memmove(g + 1, g, (FLIGHTS_GAPS - 1) * sizeof *g);
    g[0] = gap;
    return true;
}

/* The largest ratio of two gaps to the two before, of the last few; 1 or more: they do not shrink. Two,
 * because a ball may also have an event at the top of its flight. */
static inline double flights_shrinkage(const Flights *f)
{
    const double *g = f->gaps;
    double worst = 0.0;
    for (int i = 0; i < FLIGHTS_RATIOS; i++) {
        double before = g[i + 2] + g[i + 3];
        worst = fmax(worst, isfinite(before) && before > 0.0 ? (g[i] + g[i + 1]) / before : HUGE_VAL);
    }
    return worst;
}

static inline double flights_longest_pair(const Flights *f)
{
    double longest = 0.0;
    for (int i = 1; i < FLIGHTS_GAPS && isfinite(f->gaps[i]); i++) {
        longest = fmax(longest, f->gaps[i - 1] + f->gaps[i]);
    }
    return longest;
}

/* After a state event at `now` that counts; `span` is the time scale. True: infinitely many of them end here, at
 * *end, which is that of the event before: no width of a zero touches it. */
static inline bool flights_dwindle(Flights *f, double now, double span, double *end)
{
    const double *g = f->gaps;
    double ratio = flights_shrinkage(f);
    if (ratio >= 1.0) {
        f->longest_pair = flights_longest_pair(f);
        f->gathering = HUGE_VAL;
        return false;
    }
    double pair = g[0] + g[1];
    double rest = pair * ratio / (1.0 - ratio);
    bool known = isfinite(f->gathering);
    bool drowning = known && g[0] < DROWNING * g[1] && rest <= DROWNING_REST * span;
    *end = known ? f->gathering : now + rest;
    f->gathering = now + rest;
    return pair <= DWINDLED * f->longest_pair && (drowning || rest <= DWINDLING_REST * span);
}

/* ---- an indicator that an event turned back, or stopped, at its zero: it must not go on across ----
 *
 * The bounce of a ball turns the rate of the very indicator that caused it. Where the rebound is shorter
 * than an event can be located to, the ball never leaves its floor again: no event follows, and it falls
 * through. The way of an indicator is its change along the states' derivatives, a little ahead.
 */

#define AHEAD 1e-4      /* of the time in which a state moves as far as it is large: how far ahead rates are looked at */
#define AHEAD_MOST 1e-3 /* of the time scale */
#define STOPPED 1e-3    /* an event stops an indicator whose way ahead it makes shorter than this part */

/* Whether an indicator that came through zero (`old` and `way` just before the event, `z` and `new_way` just after
 * it) stands there still, nearer than its way ahead, and was turned or stopped. An event may shift a zero by its
 * hysteresis, which is much longer than the last rebounds are high. */
static inline bool turned_back(double old, double way, double z, double new_way)
{
    double side = z > 0.0 ? 1.0 : -1.0;
    bool there = (old > 0.0) == (z > 0.0) && fabs(old) <= fabs(way) && fabs(z) <= fabs(way);
    /* The speed of a rebound that drowns in the error of integration may have the wrong sign. */
    return there && (side * new_way <= STOPPED * fabs(way) || side * way <= 0.0);
}

/* Where such an indicator must not go: a little beyond `z`, at which it stands. */
static inline double turned_bound(double way, double z)
{
    double room = fmax(fabs(z), STOPPED * fabs(way));
    return z > 0.0 ? z + room : z - room;
}

/* Whether an indicator went beyond its bound; 0: it has none. */
static inline bool turned_beyond(double bound, double z)
{
    return (bound > 0.0 && z > bound) || (bound < 0.0 && z < bound);
}

#endif
