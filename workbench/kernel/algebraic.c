/* algebraic.c: Newton's method with damping for algebraic loops, Levenberg and Marquardt's where its
 * matrix is singular; the twin of workbench/system/algebraic.py.
 *
 * Source: J. Dennis, R. Schnabel, Numerical Methods for Unconstrained Optimization and Nonlinear Equations, 1983,
 * 6.3 and 10.2.
 */
#include "algebraic.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Residual, of the largest magnitude that the value has had. Solutions go down to rounding where that is cheap: event
 * indicators inside a loop must have one sign at one point, from wherever the solution came. */
#define ROUNDING 1e-15
#define CONVERGED 1e-12 /* enough if the kept Jacobian makes it no smaller */
#define ACCEPTED 1e-9   /* enough if rounding lets it become no smaller */
#define PASSED_ON 2e-15 /* of a value: its rounding, and that of what is computed from it */
#define MAX_ITERATIONS 50
#define SHORTEST (1.0 / 1024.0)
#define SLOW 0.1 /* a Jacobian that reduces the residual by less than this is found anew */
#define PERTURBATION (1.0 / 67108864.0) /* 2^-26 */
#define TINY 1e-300
#define AGREED 1e-4 /* relative: derivatives that agree with differences */
#define NOISE 1e-6  /* of differences, of the scales of both values */

enum { VECTORS = 7 };

size_t loop_doubles(size_t n) {
    return VECTORS * n + n * n;
}

typedef struct {
    System *system;
    Link *link;
    size_t n;
    /* [n] each: present values and answers, those of a trial, the scale of residuals, direction, where it began. */
    double *v, *g, *new_v, *new_g, *scale, *step, *start;
    double *matrix; /* [n][n] */
    bool stands;    /* the components stand at v */
} Loop;

static Loop loop_of(System *system, Link *link) {
    const size_t n = link->n;
    double *w = link->work;
    return (Loop){system, link, n, w, w + n, w + 2 * n, w + 3 * n, w + 4 * n, w + 5 * n, w + 6 * n, w + 7 * n, true};
}

/* What the components answer to v. */
static bool respond(Loop *loop, const double *v, double *g) {
    return link_write(loop->system, loop->link, v) && link_read(loop->system, loop->link, g);
}

static double larger(double a, double b) {
    return isfinite(b) && b > a ? b : a;
}

static void rescale(Loop *loop, const double *v, const double *g, bool anew) {
    const double *sizes = loop->system->wires.sizes;
    for (size_t i = 0; i < loop->n; i++) {
        const double least = anew ? larger(TINY, sizes[loop->link->members[i]]) : loop->scale[i];
        loop->scale[i] = larger(larger(least, fabs(v[i])), fabs(g[i]));
    }
}

static double norm(const Loop *loop, const double *v, const double *g) {
    double size = 0.0;
    for (size_t i = 0; i < loop->n; i++) {
        const double part = (g[i] - v[i]) / loop->scale[i];
        if (!isfinite(part)) {
            return (double)INFINITY;
        }
        size += part * part;
    }
    return sqrt(size);
}

/* A column of the Jacobian by differences. */
static bool difference_column(Loop *loop, size_t j) {
    const size_t n = loop->n;
    const double typical = loop->system->wires.typical[loop->link->members[j]];
    memcpy(loop->new_v, loop->v, n * sizeof(double));
    loop->new_v[j] += PERTURBATION * (loop->scale[j] > TINY ? loop->scale[j] : typical);
    if (!respond(loop, loop->new_v, loop->new_g)) {
        return false;
    }
    const double distance = loop->new_v[j] - loop->v[j];
    for (size_t i = 0; i < n; i++) {
        loop->link->jacobian[i * n + j] = (loop->new_g[i] - loop->g[i]) / distance - (i == j ? 1.0 : 0.0);
    }
    return true;
}

/* The same by the directional derivatives of the component that the value goes to, to `matrix`. An FMU that gives
 * none is not asked again; only a fatal error ends the run. The components must stand at v. */
static bool exact_column(Loop *loop, size_t j) {
    Link *link = loop->link;
    const Wires *wires = &loop->system->wires;
    const size_t n = loop->n;
    const int32_t who = link->to[j];
    const Component *component = &loop->system->components[who];
    const double seed = 1.0;
    size_t asked = 0;
    for (size_t i = 0; i < n; i++) {
        loop->matrix[i * n + j] = i == j ? -1.0 : 0.0;
        if (link->from[i] == who) {
            link->asked[asked++] = link->unknowns[i];
        }
    }
    int status = NOT_EXPORTED;
    if (component->calls->directional) {
        status = component->calls->directional(component, link->asked, asked, &link->knowns[j], &seed, 1, loop->new_g);
    }
    if (status == FMI_FATAL) {
        return component_checked(component, GET_DIRECTIONAL, status, who, &loop->system->failure);
    }
    if (status < 0 || status > FMI_WARNING) {
        link->exact[j] = NOT_EXACT;
        return true;
    }
    asked = 0;
    for (size_t i = 0; i < n; i++) {
        if (link->from[i] == who) {
            const size_t wire = link->members[i];
            const double moved = wires->closed[wire] ? wires->gains[wire] * loop->new_g[asked] : 0.0;
            loop->matrix[i * n + j] += moved;
            link->exact[j] = isfinite(moved) ? link->exact[j] : NOT_EXACT;
            asked++;
        }
    }
    return true;
}

static bool agree(const Loop *loop, size_t j) {
    const size_t n = loop->n;
    for (size_t i = 0; i < n; i++) {
        const double exact = loop->matrix[i * n + j], measured = loop->link->jacobian[i * n + j];
        const double noise = NOISE * loop->scale[i] / loop->scale[j];
        if (!(fabs(exact - measured) <= AGREED * fmax(fabs(exact), fabs(measured)) + noise)) {
            return false;
        }
    }
    return true;
}

static bool find_exact_columns(Loop *loop) {
    for (size_t j = 0; j < loop->n && loop->link->exact; j++) {
        if (loop->link->exact[j] != NOT_EXACT && !exact_column(loop, j)) {
            return false;
        }
    }
    return true;
}

/* By directional derivatives where a comparison has shown that they are true, else by differences. */
static bool find_jacobian(Loop *loop) {
    const size_t n = loop->n;
    int32_t *exact = loop->link->exact;
    if ((exact && !loop->stands && !respond(loop, loop->v, loop->new_g)) || !find_exact_columns(loop)) {
        return false;
    }
    for (size_t j = 0; j < n; j++) {
        if (exact && exact[j] == EXACT) {
            for (size_t i = 0; i < n; i++) {
                loop->link->jacobian[i * n + j] = loop->matrix[i * n + j];
            }
            continue;
        }
        loop->stands = false;
        if (!difference_column(loop, j)) {
            return false;
        }
        if (exact && exact[j] == PERHAPS_EXACT) {
            exact[j] = agree(loop, j) ? EXACT : NOT_EXACT;
        }
    }
    *loop->link->known = 1;
    return true;
}

static void swap_rows(double *a, double *b, size_t n) {
    for (size_t i = 0; i < n; i++) {
        const double kept = a[i];
        a[i] = b[i];
        b[i] = kept;
    }
}

static size_t pivot_row(const double *a, size_t n, size_t k) {
    size_t best = k;
    for (size_t i = k + 1; i < n; i++) {
        best = fabs(a[i * n + k]) > fabs(a[best * n + k]) ? i : best;
    }
    return best;
}

/* Gaussian elimination of matrix · step = right, with the right side in `step`; false: singular. */
static bool eliminate(double *a, double *right, size_t n) {
    for (size_t k = 0; k < n; k++) {
        const size_t p = pivot_row(a, n, k);
        if (!(fabs(a[p * n + k]) > 0.0)) {
            return false;
        }
        if (p != k) {
            swap_rows(a + k * n, a + p * n, n);
            swap_rows(right + k, right + p, 1);
        }
        for (size_t i = k + 1; i < n; i++) {
            const double factor = a[i * n + k] / a[k * n + k];
            for (size_t j = k; j < n; j++) {
                a[i * n + j] -= factor * a[k * n + j];
            }
            right[i] -= factor * right[k];
        }
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t j = k + 1; j < n; j++) {
            right[k] -= a[k * n + j] * right[j];
        }
        right[k] /= a[k * n + k];
    }
    return true;
}

/* The Jacobian in values relative to their scale. */
static double relative(const Loop *loop, size_t i, size_t j) {
    return loop->link->jacobian[i * loop->n + j] * loop->scale[j] / loop->scale[i];
}

static void newton_equations(Loop *loop) {
    for (size_t i = 0; i < loop->n; i++) {
        loop->step[i] = (loop->v[i] - loop->g[i]) / loop->scale[i];
        for (size_t j = 0; j < loop->n; j++) {
            loop->matrix[i * loop->n + j] = relative(loop, i, j);
        }
    }
}

static void damped_equations(Loop *loop, double damping) {
    const size_t n = loop->n;
    double largest = 0.0;
    for (size_t i = 0; i < n; i++) {
        loop->step[i] = 0.0;
        for (size_t k = 0; k < n; k++) {
            loop->step[i] += relative(loop, k, i) * (loop->v[k] - loop->g[k]) / loop->scale[k];
        }
        for (size_t j = 0; j < n; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < n; k++) {
                sum += relative(loop, k, i) * relative(loop, k, j);
            }
            loop->matrix[i * n + j] = sum;
        }
        largest = fmax(largest, loop->matrix[i * n + i]);
    }
    for (size_t i = 0; i < n; i++) {
        loop->matrix[i * n + i] += damping * largest;
    }
}

/* So small that no elimination carries the rounding of others into a value that stays 0, which has no scale. */
static double scale_of_rest(const Loop *loop) {
    double least = (double)INFINITY;
    for (size_t i = 0; i < loop->n; i++) {
        least = loop->scale[i] > TINY && loop->scale[i] < least ? loop->scale[i] : least;
    }
    return ROUNDING * least;
}

/* Newton's direction; with damping that of Levenberg and Marquardt. */
static bool find_direction(Loop *loop, double damping) {
    rescale(loop, loop->v, loop->g, true);
    const double rest = scale_of_rest(loop);
    for (size_t i = 0; i < loop->n; i++) {
        if (!(loop->scale[i] > TINY)) {
            const double typical = loop->system->wires.typical[loop->link->members[i]];
            loop->scale[i] = damping > 0.0 || !isfinite(rest) ? typical : rest;
        }
    }
    if (damping > 0.0) {
        damped_equations(loop, damping);
    } else {
        newton_equations(loop);
    }
    if (!eliminate(loop->matrix, loop->step, loop->n)) {
        return false;
    }
    for (size_t i = 0; i < loop->n; i++) {
        loop->step[i] *= loop->scale[i];
        if (!isfinite(loop->step[i])) {
            return false;
        }
    }
    return true;
}

typedef enum { BETTER, NOT_BETTER, BROKEN } Outcome;

/* Go along the direction as far as the residual becomes smaller; *ratio: by how much it did. */
static Outcome go_along(Loop *loop, double shortest, double *ratio) {
    for (double part = 1.0; part >= shortest; part *= 0.5) {
        for (size_t i = 0; i < loop->n; i++) {
            loop->new_v[i] = loop->v[i] + part * loop->step[i];
        }
        loop->stands = false;
        if (!respond(loop, loop->new_v, loop->new_g)) {
            return BROKEN;
        }
        rescale(loop, loop->v, loop->g, true);
        rescale(loop, loop->new_v, loop->new_g, false);
        const double before = norm(loop, loop->v, loop->g);
        const double after = norm(loop, loop->new_v, loop->new_g);
        if (after < (1.0 - 1e-4 * part) * before) {
            memcpy(loop->v, loop->new_v, loop->n * sizeof(double));
            memcpy(loop->g, loop->new_g, loop->n * sizeof(double));
            rescale(loop, loop->v, loop->g, true);
            loop->stands = true;
            *ratio = norm(loop, loop->v, loop->g) / before;
            return BETTER;
        }
    }
    return NOT_BETTER;
}

/* `hard`: try all that may help; else one step of Newton's, to come nearer to rounding. */
static Outcome take_step(Loop *loop, bool hard, double *ratio) {
    static const double dampings[] = {0.0, 1e-6, 1e-3, 1.0}; /* the first is Newton's method itself */
    const size_t n = hard ? sizeof dampings / sizeof dampings[0] : 1;
    for (size_t i = 0; i < n; i++) {
        const double shortest = hard ? SHORTEST : 1.0;
        const Outcome outcome = find_direction(loop, dampings[i]) ? go_along(loop, shortest, ratio) : NOT_BETTER;
        if (outcome != NOT_BETTER) {
            return outcome;
        }
    }
    return NOT_BETTER;
}

static bool found(Loop *loop) {
    double *sizes = loop->system->wires.sizes;
    for (size_t i = 0; i < loop->n; i++) {
        double *size = &sizes[loop->link->members[i]];
        *size = fmax(*size, fabs(loop->v[i]));
    }
    return true;
}

/* Whether what is left is the rounding of the loop's values, passed on by the components: the scale of a value that
 * has been 0 until now knows nothing of it, as behind a dead band that is just left. */
static bool is_rounding(Loop *loop) {
    const size_t n = loop->n;
    rescale(loop, loop->v, loop->g, true);
    for (size_t i = 0; i < n; i++) {
        double noise = loop->scale[i];
        for (size_t j = 0; j < n; j++) {
            noise += fabs(loop->link->jacobian[i * n + j] + (i == j ? 1.0 : 0.0)) * loop->scale[j];
        }
        if (!(fabs(loop->g[i] - loop->v[i]) <= PASSED_ON * noise)) {
            return false;
        }
    }
    return true;
}

/* Note which value is worst; the caller's first guess is put back. */
static bool unsolved(Loop *loop, double time) {
    Failure *failure = &loop->system->failure;
    size_t worst = 0;
    rescale(loop, loop->v, loop->g, true);
    for (size_t i = 1; i < loop->n; i++) {
        const double here = fabs(loop->g[i] - loop->v[i]) / loop->scale[i];
        const double there = fabs(loop->g[worst] - loop->v[worst]) / loop->scale[worst];
        worst = here > there || !isfinite(here) ? i : worst;
    }
    if (failure->code == NO_FAILURE) {
        snprintf(failure->message, sizeof failure->message, "%.6g", loop->v[worst]);
    }
    return fail_value(failure, FAILED_LOOP, time, loop->link->members[worst], loop->g[worst] - loop->v[worst]);
}

static bool newton(Loop *loop, double time) {
    bool fresh = false;
    if (!respond(loop, loop->v, loop->g)) {
        return false;
    }
    for (int i = 0; i < MAX_ITERATIONS; i++) {
        rescale(loop, loop->v, loop->g, true);
        const double size = norm(loop, loop->v, loop->g);
        if (size <= ROUNDING) {
            return found(loop);
        }
        if (!*loop->link->known) {
            if (!find_jacobian(loop)) {
                return false;
            }
            fresh = true;
        }
        double ratio = 0.0;
        const Outcome outcome = take_step(loop, size > CONVERGED, &ratio);
        if (outcome == BROKEN) {
            return false;
        }
        if (outcome == BETTER) {
            if (ratio > SLOW && size > CONVERGED) {
                *loop->link->known = 0;
                fresh = false;
            }
        } else if (!fresh && size > CONVERGED) {
            *loop->link->known = 0;
        } else if (size <= ACCEPTED || is_rounding(loop)) {
            return respond(loop, loop->v, loop->g) && found(loop);
        } else {
            break;
        }
    }
    return unsolved(loop, time);
}

bool loop_solve(System *system, Link *link, double time) {
    Loop loop = loop_of(system, link);
    for (size_t i = 0; i < link->n; i++) {
        loop.v[i] = loop.start[i] = system->wires.values[link->members[i]];
    }
    if (newton(&loop, time)) {
        return true;
    }
    for (size_t i = 0; i < link->n; i++) {
        system->wires.values[link->members[i]] = loop.start[i];
    }
    return false;
}
