/* history.h: the past of a signal, to be read a delay later.
 *
 * Between the samples of accepted steps the signal is a polynomial of third order, which never reaches across an
 * event. One source for delay() in built FMUs and for the delay block of the kernel, which includes it from here.
 */
#ifndef WORKBENCH_HISTORY_H
#define WORKBENCH_HISTORY_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#define HISTORY_POINTS 4
#define HISTORY_TOGETHER 1e-6         /* of the shortest delay: samples nearer than this are one */
#define HISTORY_FIRST_STEP 5e-3       /* of the shortest delay: the longest step where nothing is known of the signal */
#define HISTORY_LEAST_STEP 1e-3       /* of the shortest delay */
#define HISTORY_SAME 1e-9             /* of the largest |u|: a smaller jump is none */

/* What begins with a sample. */
#define HISTORY_PLAIN 0.0
#define HISTORY_KINK 1.0
#define HISTORY_JUMP 2.0

/* Only doubles: it lies in saved states. */
typedef struct {
    double t, u, begins;
} Sample;

/* Number of samples up to time s, those at s included. */
static inline size_t history_up_to(const Sample *samples, size_t n, double s)
{
    size_t low = 0;
    size_t high = n;
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (samples[middle].t <= s) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

/* The polynomial through samples [first, last] at s, and its derivative. */
static inline double history_polynomial(const Sample *samples, size_t first, size_t last, double s, double *slope)
{
    const double base = samples[first].u; /* a constant comes out as it is */
    double value = base;
    *slope = 0.0;
    for (size_t i = first; i <= last; i++) {
        double weight = 1.0;
        double change = 0.0;
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

static inline bool history_begins(const Sample *sample, double what)
{
    return !(sample->begins < what) && !(sample->begins > what);
}

/* The samples of one smooth piece around [i, i + 1], HISTORY_POINTS at most. */
static inline void history_around(const Sample *samples, size_t n, size_t *first, size_t *last)
{
    bool moved = true;
    while (moved && *last - *first + 1 < HISTORY_POINTS) {
        moved = false;
        if (*first > 0 && history_begins(&samples[*first], HISTORY_PLAIN)) {
            (*first)--;
            moved = true;
        }
        if (*last - *first + 1 < HISTORY_POINTS && *last + 1 < n && history_begins(&samples[*last], HISTORY_PLAIN)
            && !history_begins(&samples[*last + 1], HISTORY_JUMP)) {
            (*last)++;
            moved = true;
        }
    }
}

/* The signal at time s and its slope, of n > 0 samples; jumps up to the time `passed` have come out, later ones not. */
static inline double history_value(const Sample *samples, size_t n, double s, double passed, double *slope)
{
    *slope = 0.0;
    size_t i = history_up_to(samples, n, s);
    if (i == 0) {
        return samples[0].u; /* the past */
    }
    i--;
    while (i > 0 && history_begins(&samples[i], HISTORY_JUMP) && samples[i].t > passed) {
        i--; /* it has not come out yet */
    }
    while (i + 1 < n && samples[i + 1].t <= passed) {
        i++; /* it has, a rounding error earlier */
    }
    if (i + 1 >= n || history_begins(&samples[i + 1], HISTORY_JUMP)) { /* at the end of a piece */
        if (samples[i].t >= s || !history_begins(&samples[i], HISTORY_PLAIN) || i == 0) {
            return samples[i].u;
        }
        i--;
    }
    size_t first = i;
    size_t last = i + 1;
    history_around(samples, n, &first, &last);
    return history_polynomial(samples, first, last, fmax(s, samples[i].t), slope);
}

/* The first jump after the time `from`; NULL: none is known. */
static inline const Sample *history_jump_after(const Sample *samples, size_t n, double from)
{
    for (size_t i = history_up_to(samples, n, from); i < n; i++) {
        if (history_begins(&samples[i], HISTORY_JUMP)) {
            return &samples[i];
        }
    }
    return NULL;
}

/* How many samples from the first on nobody will ask for again, who reads from the time `s` on; 0 where they are few. */
static inline size_t history_old(const Sample *samples, size_t n, size_t capacity, double s)
{
    const size_t old = history_up_to(samples, n, s);
    const bool many = old > HISTORY_POINTS + 1 && old - HISTORY_POINTS > capacity / 2;
    return many ? old - HISTORY_POINTS - 1 : 0;
}

/* By what factor the last step could be longer or shorter for an error of `allowed`, from how far its end is off the
 * polynomial through the samples before it; 1 where those are too few. n > 1. */
static inline double history_factor(const Sample *samples, size_t n, double allowed)
{
    size_t first = n - 1;
    while (first > 0 && n - first <= HISTORY_POINTS + 1 && history_begins(&samples[first], HISTORY_PLAIN)) {
        first--;
    }
    if (n - 1 - first < HISTORY_POINTS) {
        return 1.0;
    }
    double slope;
    const Sample *last = &samples[n - 1];
    const double guess = history_polynomial(samples, n - 1 - HISTORY_POINTS, n - 2, last->t, &slope);
    double reach = 1.0;
    for (size_t i = n - 1 - HISTORY_POINTS; i < n - 1; i++) {
        reach *= last->t - samples[i].t;
    }
    /* In the middle of the last step, between the sample before it and one that follows a step as long. */
    const double step = last->t - samples[n - 2].t;
    const double before = samples[n - 2].t - samples[n - 3].t;
    const double error = fabs((last->u - guess) / reach) * 0.25 * step * step * (0.5 * step + before) * 1.5 * step;
    return error > 0.0 ? fmin(2.0, fmax(0.2, 0.9 * sqrt(sqrt(allowed / error)))) : 2.0;
}

#endif
