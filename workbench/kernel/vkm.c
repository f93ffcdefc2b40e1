/* vkm.c: the variable-step method of Kutta and Merson, order 4 with an error estimate.
 *
 *     k1 = f(t, x)                        k2 = f(t + h/3, x + h/3 k1)
 *     k3 = f(t + h/3, x + h/6 (k1 + k2))  k4 = f(t + h/2, x + h/8 (k1 + 3 k3))
 *     k5 = f(t + h, x + h/2 (k1 - 3 k3 + 4 k4))
 *     x+ = x + h/6 (k1 + 4 k4 + k5),      error = h/30 (2 k1 - 9 k3 + 8 k4 - k5)
 *
 * States inside a step come from a shorter step with the same start, so they do not depend on where
 * points are asked for. Not for stiff models: the step is then limited by stability; use `gear`.
 * The step control is that of tests/oracle/merson.py, to the last digit.
 *
 * Source: R. H. Merson, An operational method for the study of integration processes, 1957;
 * E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.4.
 */
#include "locate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SAFETY 0.9
#define SHRINK 0.2
#define GROW 5.0
#define ERROR_POWER (-0.2)

enum { STAGES = 5, VECTORS = STAGES + 5 };

typedef struct {
    Solver base;
    Watch watch;
    double h;     /* [s] step to try next; 0: guess one */
    double end;   /* [s] end of the step that is tried */
    double *k[STAGES];
    double *x_old; /* [n] where the last step began */
    double *x_new; /* [n] where the step that is tried ends */
    double *stage; /* [n] where f or z is evaluated */
    double *next;  /* [n] k1 of the step to come */
    bool ready;    /* `next` holds it */
    double work[];
} Merson;

static Evaluation derivatives(Merson *m, double t, const double *x, double *dx)
{
    const Problem *problem = &m->base.problem;
    m->base.evaluations++;
    Evaluation evaluation = problem->derivatives(problem->owner, t, x, dx);
    for (size_t i = 0; evaluation == EVALUATED && i < problem->n; i++) {
        if (!isfinite(dx[i])) {
            evaluation = RECOVERABLE;
        }
    }
    return evaluation;
}

/* Stages 2 to 5 of a step h from where the last step began; the states at its end to x. */
static Evaluation merson(Merson *m, double h, double *x)
{
    const size_t n = m->base.problem.n;
    const double t = m->base.t_old;
    const double *x0 = m->x_old, *k1 = m->k[0];
    double *k2 = m->k[1], *k3 = m->k[2], *k4 = m->k[3], *k5 = m->k[4], *stage = m->stage;
    Evaluation evaluation;
    for (size_t i = 0; i < n; i++) {
        stage[i] = x0[i] + (h / 3.0) * k1[i];
    }
    if ((evaluation = derivatives(m, t + h / 3.0, stage, k2)) != EVALUATED) {
        return evaluation;
    }
    for (size_t i = 0; i < n; i++) {
        stage[i] = x0[i] + (h / 6.0) * (k1[i] + k2[i]);
    }
    if ((evaluation = derivatives(m, t + h / 3.0, stage, k3)) != EVALUATED) {
        return evaluation;
    }
    for (size_t i = 0; i < n; i++) {
        stage[i] = x0[i] + (h / 8.0) * (k1[i] + 3.0 * k3[i]);
    }
    if ((evaluation = derivatives(m, t + h / 2.0, stage, k4)) != EVALUATED) {
        return evaluation;
    }
    for (size_t i = 0; i < n; i++) {
        stage[i] = x0[i] + (h / 2.0) * (k1[i] - 3.0 * k3[i] + 4.0 * k4[i]);
    }
    if ((evaluation = derivatives(m, t + h, stage, k5)) != EVALUATED) {
        return evaluation;
    }
    for (size_t i = 0; i < n; i++) {
        x[i] = x0[i] + (h / 6.0) * (k1[i] + 4.0 * k4[i] + k5[i]);
    }
    return EVALUATED;
}

static Evaluation states_at(Merson *m, double t, double *x)
{
    if (t == m->end) {
        memmove(x, m->x_new, m->base.problem.n * sizeof *x);
        return EVALUATED;
    }
    return merson(m, t - m->base.t_old, x);
}

static Evaluation indicators_at(void *owner, double t, double *z)
{
    Merson *m = owner;
    const Problem *problem = &m->base.problem;
    const Evaluation evaluation = states_at(m, t, m->stage);
    return evaluation == EVALUATED ? problem->indicators(problem->owner, t, m->stage, z) : evaluation;
}

static Solver *create(const Problem *problem, const Tolerance *tolerance, const GearLibrary *library)
{
    (void)library;
    const size_t n = problem->n, doubles = VECTORS * n + watch_doubles(problem->nz);
    Merson *m = n > 0 ? calloc(1, sizeof *m + doubles * sizeof(double)) : NULL;
    if (m == NULL) {
        return NULL;
    }
    m->base.method = &solver_vkm;
    m->base.problem = *problem;
    m->base.tolerance = *tolerance;
    for (size_t i = 0; i < STAGES; i++) {
        m->k[i] = m->work + i * n;
    }
    m->base.x = m->work + 5 * n;
    m->x_old = m->work + 6 * n;
    m->x_new = m->work + 7 * n;
    m->stage = m->work + 8 * n;
    m->next = m->work + 9 * n;
    watch_bind(&m->watch, problem->nz, m->work + VECTORS * n, m, indicators_at);
    return &m->base;
}

static bool fail(Solver *solver, Evaluation evaluation, const char *words)
{
    solver->message[0] = '\0'; /* FAILED: the owner knows why */
    if (evaluation != FAILED) {
        snprintf(solver->message, SOLVER_MESSAGE, "vkm: %s", words);
    }
    return false;
}

static const char *const NOT_HERE = "the model cannot be evaluated where the step begins";

static bool restart(Solver *solver, double t, const double *x)
{
    Merson *m = (Merson *)solver;
    const size_t size = solver->problem.n * sizeof *x;
    solver->t = solver->t_old = m->end = t;
    m->h = 0.0;
    m->ready = false;
    memmove(solver->x, x, size);
    memcpy(m->x_old, solver->x, size);
    memcpy(m->x_new, solver->x, size);
    const Evaluation evaluation = watch_restart(&m->watch, t);
    return evaluation == EVALUATED || fail(solver, evaluation, NOT_HERE);
}

static double weight(const Solver *solver, size_t i, double x)
{
    return allowed_error(&solver->tolerance, solver->tolerance.rtol, i, x);
}

/* Guess a step from |x| and |f| (Hairer, Norsett, Wanner, II.4). */
static double first_step(const Merson *m, double stop)
{
    const Solver *solver = &m->base;
    const double span = stop - solver->t;
    double size = 0.0, slope = 0.0;
    for (size_t i = 0; i < solver->problem.n; i++) {
        const double w = weight(solver, i, solver->x[i]);
        size = fmax(size, fabs(solver->x[i]) / w);
        slope = fmax(slope, fabs(m->k[0][i]) / w);
    }
    if (slope == 0.0 || size < 1e-5 || !isfinite(slope)) {
        return 1e-3 * span;
    }
    const double least = 64.0 * (nextafter(fabs(solver->t), INFINITY) - fabs(solver->t)); /* time must pass */
    return fmax(fmin(0.01 * size / slope, 0.1 * span), least);
}

/* The largest error of the step just tried, relative to what is allowed. */
static double error_of(const Merson *m, double h)
{
    const Solver *solver = &m->base;
    double largest = 0.0;
    for (size_t i = 0; i < solver->problem.n; i++) {
        const double sum = 2.0 * m->k[0][i] - 9.0 * m->k[2][i] + 8.0 * m->k[3][i] - m->k[4][i];
        const double x = fmax(fabs(m->x_new[i]), fabs(solver->x[i]));
        const double ratio = fabs((h / 30.0) * sum) / weight(solver, i, x);
        largest = ratio > largest || isnan(ratio) ? ratio : largest;
        if (isnan(largest)) {
            break;
        }
    }
    return isfinite(largest) ? largest : 1e30;
}

/* One attempt from solver->t to m->end; *error > 1 where it must be shorter. */
static Evaluation try_step(Merson *m, double *error, bool *event)
{
    const double h = m->end - m->base.t;
    Evaluation evaluation = merson(m, h, m->x_new);
    *error = evaluation == EVALUATED ? error_of(m, h) : INFINITY;
    if (evaluation != EVALUATED || *error > 1.0) {
        return evaluation;
    }
    /* A step must not end where the next cannot begin. */
    evaluation = derivatives(m, m->end, m->x_new, m->next);
    double end = m->end;
    if (evaluation == EVALUATED) {
        evaluation = watch_step(&m->watch, m->base.t, &end, event);
    }
    if (evaluation == EVALUATED && end != m->end) {
        evaluation = merson(m, end - m->base.t, m->x_new);
        m->end = end;
    }
    m->ready = evaluation == EVALUATED && !*event;
    *error = evaluation == EVALUATED ? *error : INFINITY;
    return evaluation;
}

static bool too_small(double h, double t)
{
    const double size = fmax(fabs(t), 1e-300);
    return h == 0.0 || h < 16.0 * (nextafter(size, INFINITY) - size);
}

static bool accept(Merson *m)
{
    m->base.t = m->end;
    m->base.steps++;
    memcpy(m->base.x, m->x_new, m->base.problem.n * sizeof(double));
    return true;
}

static bool step(Solver *solver, double stop, double longest, bool *event)
{
    Merson *m = (Merson *)solver;
    const double t = solver->t;
    *event = false;
    solver->t_old = t;
    memcpy(m->x_old, solver->x, solver->problem.n * sizeof(double));
    Evaluation evaluation = EVALUATED;
    if (m->ready) {
        memcpy(m->k[0], m->next, solver->problem.n * sizeof(double));
    } else {
        evaluation = derivatives(m, t, solver->x, m->k[0]);
    }
    if (evaluation != EVALUATED) {
        return fail(solver, evaluation, NOT_HERE);
    }
    m->h = m->h == 0.0 ? first_step(m, stop) : m->h;
    for (;;) {
        const double wanted = fmin(m->h, longest);
        const double end = t + wanted * (1.0 + 1e-9) >= stop ? stop : t + wanted;
        const double h = end - t;
        double error = 0.0;
        m->end = end;
        evaluation = try_step(m, &error, event);
        if (evaluation == FAILED) {
            break;
        }
        const double factor = error == 0.0 ? GROW : fmin(GROW, SAFETY * pow(error, ERROR_POWER));
        if (error <= 1.0) {
            /* A step cut short by `stop` says nothing against the longer one. */
            m->h = end == stop ? fmax(m->h, h * factor) : h * factor;
            return accept(m);
        }
        solver->rejected++;
        m->h = h * fmax(SHRINK, factor);
        if (too_small(m->h, t)) {
            break;
        }
    }
    m->end = t;
    m->ready = false;
    memcpy(m->x_new, solver->x, solver->problem.n * sizeof(double));
    return fail(solver, evaluation,
                "the step became too small; the model is stiff or jumps without an event: use solver gear");
}

static bool interpolate(const Solver *solver, double t, double *x)
{
    /* Stages are scratch and evaluations are counted: the solver's answers stay as they are. */
    Merson *m = (Merson *)solver;
    const Evaluation evaluation = states_at(m, t, x);
    return evaluation == EVALUATED || fail(&m->base, evaluation, "a point inside the step cannot be evaluated");
}

static void destroy(Solver *solver) { free(solver); }

const SolverMethod solver_vkm = {"vkm", create, restart, step, interpolate, destroy};
