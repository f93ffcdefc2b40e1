/* flights.c: infinitely many state events before a finite time (see flights.h).
 *
 * The gaps between the bounces of a ball shrink as a geometric series, whose end is extrapolated. It is
 * told before the events drown in rounding: from then on the next one is missed, and the ball falls
 * through its floor. Model Exchange has the same rule in workbench/session/me.py.
 */
#include "flights.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define RATIOS 4
#define SAME_EVENT 1e-3     /* a gap of less than this part of the one before is none */
#define DWINDLED 1e-3       /* gaps that shrink are Zeno behaviour from this part of the longest two on ... */
#define DWINDLING_REST 1e-6 /* ... where their sum to the end is this part of the time scale ... */
#define DROWNING 0.1        /* ... or an indicator takes this part of the gap before to leave its zero ... */
#define DROWNING_REST 1e-3  /* ... and the sum is this part */
#define CAUTION 0.02        /* of the last gap: a longer first step could jump over the next event */

void flights_forget(Flights *f)
{
    f->last = -HUGE_VAL;
    f->longest_pair = f->gathering = HUGE_VAL;
    for (int i = 0; i < FLIGHTS_GAPS; i++) {
        f->gaps[i] = HUGE_VAL;
    }
}

/* The largest ratio of two gaps to the two before, of the last few; 1 or more: they do not shrink. Two,
 * because a ball may also have an event at the top of its flight. */
static double shrinkage(const double *g)
{
    double worst = 0.0;
    for (int i = 0; i < RATIOS; i++) {
        double before = g[i + 2] + g[i + 3];
        worst = fmax(worst, isfinite(before) && before > 0.0 ? (g[i] + g[i + 1]) / before : HUGE_VAL);
    }
    return worst;
}

static double longest_pair(const double *g)
{
    double longest = 0.0;
    for (int i = 1; i < FLIGHTS_GAPS && isfinite(g[i]); i++) {
        longest = fmax(longest, g[i - 1] + g[i]);
    }
    return longest;
}

bool flights_dwindle(Flights *f, double now, double span, double *end)
{
    double *g = f->gaps;
    double gap = now - f->last;
    if (gap < SAME_EVENT * g[0] && isfinite(g[0])) {
        return false; /* the indicator leaves its zero again */
    }
    f->last = now;
    memmove(g + 1, g, (FLIGHTS_GAPS - 1) * sizeof *g);
    g[0] = gap;
    double ratio = shrinkage(g);
    if (ratio >= 1.0) {
        f->longest_pair = longest_pair(g);
        f->gathering = HUGE_VAL;
        return false;
    }
    double pair = g[0] + g[1];
    double rest = pair * ratio / (1.0 - ratio);
    bool known = isfinite(f->gathering);
    bool drowning = known && g[0] < DROWNING * g[1] && rest <= DROWNING_REST * span;
    *end = known ? f->gathering : now + rest; /* that of the event before, which no width of a zero touches */
    f->gathering = now + rest;
    return pair <= DWINDLED * f->longest_pair && (drowning || rest <= DWINDLING_REST * span);
}

double flights_longest_step(const Flights *f, double now)
{
    double rounding = 64.0 * DBL_EPSILON * fabs(now);
    return fmax(fmax(CAUTION * f->gaps[0], now - f->last), rounding);
}
