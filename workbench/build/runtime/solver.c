/* solver.c: step-size control around a method (see solver.h).
 *
 * Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section
 * II.4 (automatic step size control, starting step, PI control in volume II, IV.2).
 */
#include "solver.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

#define SAFETY 0.9
#define SMALLEST_FACTOR 0.2
#define LARGEST_FACTOR 5.0
#define AFTER_FAILURE 0.25
#define BEYOND_ROOT 1.005 /* a step is repeated so that the root lies just before its end */

static void bind_vectors(Solver *s)
{
    double *next = s->work;
    double **vectors[] = {&s->x, &s->x_new, &s->dx, &s->error, &s->scale, &s->probe};
    for (size_t i = 0; i < sizeof vectors / sizeof vectors[0]; i++) {
        *vectors[i] = next;
        next += s->n;
    }
    s->z_start = next;
    s->z_before = next + s->n_z;
    s->z_after = next + 2 * s->n_z;
    s->z_scratch = next + 3 * s->n_z;
}

Solver *solver_new(Core *core, Inputs *inputs, const Memory *memory)
{
    Solver *s = memory_new(memory, 1, sizeof *s);
    if (s == NULL) {
        return NULL;
    }
    s->core = core;
    s->inputs = inputs;
    s->memory = memory;
    s->n = model_info.n_states;
    s->n_z = model_info.n_indicators;
    s->method = model_info.stiff ? &method_implicit : &method_explicit;
    s->work = memory_new(memory, 6 * s->n + 4 * s->n_z, sizeof(double));
    s->data = s->method->create(memory, s->n);
    if (s->work == NULL || s->data == NULL) {
        solver_free(s);
        return NULL;
    }
    bind_vectors(s);
    return s;
}

void solver_free(Solver *s)
{
    if (s == NULL) {
        return;
    }
    s->method->destroy(s->memory, s->data);
    memory_delete(s->memory, s->work);
    memory_delete(s->memory, s);
}

static bool all_finite(const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

bool solver_evaluate(Solver *s, double t, const double *x, double *dx)
{
    inputs_apply(s->inputs, s->core, t);
    core_set_time(s->core, t);
    core_set_states(s->core, x);
    return core_get_derivatives(s->core, dx) && all_finite(dx, s->n);
}

double solver_norm(const Solver *s, const double *vector)
{
    double largest = 0.0;
    for (size_t i = 0; i < s->n; i++) {
        double weighted = fabs(vector[i]) / s->scale[i];
        if (isnan(weighted)) {
            return HUGE_VAL;
        }
        largest = fmax(largest, weighted);
    }
    return largest;
}

static void set_scale(Solver *s, const double *a, const double *b)
{
    for (size_t i = 0; i < s->n; i++) {
        double magnitude = fmax(fabs(a[i]), fabs(b[i]));
        double nominal = fabs(model_info.state_nominals[i]);
        nominal = nominal > 0.0 ? nominal : 1.0;
        s->scale[i] = s->tolerance * (0.01 * nominal + magnitude);
    }
}

/* The core stands where the integration stands. */
static void place(Solver *s)
{
    inputs_apply(s->inputs, s->core, s->t);
    core_set_time(s->core, s->t);
    core_set_states(s->core, s->x);
}

static bool accepted(Solver *s)
{
    if (!core_accepted(s->core)) {
        snprintf(s->problem, sizeof s->problem, "out of memory");
        return false;
    }
    return true;
}

bool solver_begin(Solver *s, double tolerance)
{
    s->tolerance = tolerance;
    s->previous_error = 1e-4;
    s->t = core_time(s->core);
    core_get_states(s->core, s->x);
    s->method->begin(s);
    if (!solver_evaluate(s, s->t, s->x, s->dx)) {
        snprintf(s->problem, sizeof s->problem, "the derivatives cannot be evaluated");
        return false;
    }
    return events_remember(s);
}

static double first_guess(double size_x, double size_dx, double longest)
{
    double guess = size_x < 1e-5 || size_dx < 1e-5 ? 1e-6 : 0.01 * size_x / size_dx;
    return fmin(guess, longest);
}

/* Hairer's starting step: an explicit Euler step tells how fast the derivatives change. */
static double starting_step(Solver *s, double longest)
{
    set_scale(s, s->x, s->x);
    double size_dx = solver_norm(s, s->dx);
    double guess = first_guess(solver_norm(s, s->x), size_dx, longest);
    for (size_t i = 0; i < s->n; i++) {
        s->x_new[i] = s->x[i] + guess * s->dx[i];
    }
    if (!solver_evaluate(s, s->t + guess, s->x_new, s->probe)) {
        return guess * 1e-3;
    }
    for (size_t i = 0; i < s->n; i++) {
        s->probe[i] -= s->dx[i];
    }
    double fastest = fmax(size_dx, solver_norm(s, s->probe) / guess);
    double step = fastest <= 1e-15 ? fmax(1e-6, guess * 1e-3)
                                   : pow(0.01 / fastest, s->method->error_exponent);
    return fmin(fmin(100.0 * guess, step), longest);
}

static double shortest_step(const Solver *s)
{
    return 16.0 * DBL_EPSILON * fmax(fabs(s->t), DBL_MIN / DBL_EPSILON);
}

/* The last two steps before t_stop share what is left, so that none is tiny. */
static double fit_step(const Solver *s, double step, double t_stop)
{
    double left = t_stop - s->t;
    if (step >= left * (1.0 - 1e-9)) {
        return left;
    }
    return step > 0.5 * left ? 0.5 * left : step;
}

static size_t find_worst(const Solver *s)
{
    size_t worst = 0;
    for (size_t i = 1; i < s->n; i++) {
        if (fabs(s->error[i]) / s->scale[i] > fabs(s->error[worst]) / s->scale[worst]) {
            worst = i;
        }
    }
    return worst;
}

/* Weighted error of a step of size h: <= 1 is good enough, HUGE_VAL: it could not be made. */
static double try_step(Solver *s, double h)
{
    s->h = h;
    set_scale(s, s->x, s->x);
    if (!s->method->attempt(s, h) || !all_finite(s->x_new, s->n)) {
        return HUGE_VAL;
    }
    set_scale(s, s->x, s->x_new);
    double error = solver_norm(s, s->error);
    return isfinite(error) ? error : HUGE_VAL;
}

static double growth(const Solver *s, double error)
{
    const Method *m = s->method;
    double safe = fmax(error, 1e-10);
    double factor = SAFETY * pow(safe, -m->error_exponent) * pow(s->previous_error, m->memory_exponent);
    factor = fmin(LARGEST_FACTOR, fmax(SMALLEST_FACTOR, factor));
    return factor >= 1.0 && factor < m->hold_below ? 1.0 : factor;
}

static double reduction(const Solver *s, double error)
{
    if (error == HUGE_VAL) {
        return AFTER_FAILURE;
    }
    return fmax(SMALLEST_FACTOR, SAFETY * pow(error, -s->method->error_exponent));
}

static SolverResult underflow(Solver *s, double h, double error)
{
    if (error == HUGE_VAL || error <= 1.0) { /* no step, or one without event indicators */
        snprintf(s->problem, sizeof s->problem,
                 "the equations cannot be evaluated or solved even with a step of %.3g s", h);
    } else {
        const char *name = model_info.names[model_info.states[find_worst(s)]];
        snprintf(s->problem, sizeof s->problem,
                 "the step size fell to %.3g s because of state '%s'; it may be discontinuous or unbounded",
                 h, name);
    }
    return SOLVER_FAILED;
}

/* What to propose next time; a step cut short by t_stop or an event must not lower it for that. */
static double propose(const Solver *s, double wanted, double error)
{
    double factor = growth(s, error);
    double next = s->h * factor;
    return s->h < wanted && factor >= LARGEST_FACTOR ? fmax(wanted, next) : next;
}

static bool take_step(Solver *s, double t_new)
{
    s->t = t_new;
    memcpy(s->x, s->x_new, s->n * sizeof(double));
    if (!s->method->accept(s)) {
        snprintf(s->problem, sizeof s->problem, "the derivatives cannot be evaluated");
        return false;
    }
    place(s);
    return accepted(s) && events_remember(s);
}

static bool stop_at_event(Solver *s, double theta, double t_stop)
{
    s->method->interpolate(s, theta, s->probe);
    memcpy(s->x, s->probe, s->n * sizeof(double));
    s->t = fmin(s->t + theta * s->h, t_stop);
    place(s);
    return accepted(s);
}

/* The dense output is less accurate than the step: where a root lies well inside, the step is made
 * once more, to end just behind it. */
static bool worth_repeating(const Solver *s, double theta)
{
    return s->n > 0 && theta < 0.98 && theta * s->h > 1e3 * shortest_step(s);
}

typedef struct {
    double t_stop;
    double h;       /* to be tried next */
    double wanted;  /* what control alone would take */
    bool repeated;  /* shortened once already because of a root */
} Trial;

static SolverResult finish(Solver *s, Trial *trial, double *step, double error)
{
    double theta = 1.0;
    Crossing crossing = s->n_z > 0 ? events_find(s, &theta) : CROSSING_NONE;
    if (crossing == CROSSING_FOUND && !trial->repeated && worth_repeating(s, theta)) {
        trial->repeated = true;
        trial->h = BEYOND_ROOT * theta * s->h;
        return SOLVER_AGAIN;
    }
    if (crossing == CROSSING_FAILED) {
        trial->h = s->h * AFTER_FAILURE;
        trial->wanted = trial->h;
        return SOLVER_AGAIN;
    }
    *step = propose(s, trial->wanted, error);
    s->previous_error = fmax(error, 1e-4);
    if (crossing == CROSSING_FOUND) {
        return stop_at_event(s, theta, trial->t_stop) ? SOLVER_EVENT : SOLVER_FAILED;
    }
    bool whole = trial->h >= (trial->t_stop - s->t) * (1.0 - 1e-9);
    return take_step(s, whole ? trial->t_stop : s->t + s->h) ? SOLVER_STEP : SOLVER_FAILED;
}

static double first_step(Solver *s, double t_stop, double step)
{
    if (s->n == 0) {
        return t_stop - s->t;
    }
    return step > 0.0 ? step : starting_step(s, fmin(s->longest_start, t_stop - s->t));
}

SolverResult solver_step(Solver *s, double t_stop, double *step)
{
    double wanted = first_step(s, t_stop, *step);
    Trial trial = {t_stop, fit_step(s, wanted, t_stop), wanted, false};
    for (;;) {
        double error = try_step(s, trial.h);
        if (error <= 1.0) {
            SolverResult result = finish(s, &trial, step, error);
            if (result != SOLVER_AGAIN) {
                return result;
            }
        } else {
            trial.h *= reduction(s, error);
            trial.wanted = trial.h;
        }
        if (trial.h < shortest_step(s)) {
            return underflow(s, trial.h, error);
        }
    }
}
