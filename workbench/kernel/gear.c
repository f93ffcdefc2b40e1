/* gear.c: SUNDIALS CVODE, backward differentiation of variable step and order, for stiff models.
 *
 * Its Newton matrix is dense, by differences, or banded where the problem says that it is sparse (gear_banded.h), by
 * differences of several states at once; right-hand side and error weights are compiled callbacks. Events are located
 * on CVODE's own dense output by `Watch`, as in the other solvers, because the domains are > 0 and <= 0
 * and CVODE's own root functions treat 0 as a third one.
 *
 * Source: C. W. Gear, Numerical Initial Value Problems in Ordinary Differential Equations, 1971;
 * A. Hindmarsh et al., SUNDIALS, ACM TOMS 31 (2005); SUNDIALS 7 user guide for the signatures.
 */
#include "gear_banded.h"
#include "grouped.h"
#include "locate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Errors of BDF add up to some multiple of what one step is allowed; asking for less makes the result as
 * accurate as that of `vkm` at the same tolerance. */
#define STRICTER 0.3
#define TINY_GAP 1e-14 /* relative: no solver crosses less */
#define MOST_RETREATS 12
#define MOST_DOUBTS 2
#define MOST_FAILURES 30 /* of one step; CVODE's own 10 give up on a model that only wants a short step */

enum { BDF = 2, ONE_STEP = 2, NO_HNIL_WARNINGS = -1 };

/* CVODE's Newton matrix, and what solves with it. */
typedef struct {
    Pointer matrix, linear;
    BandedNewton *banded; /* what they are made of; NULL: they are dense */
} Newton;

typedef struct {
    Solver base;
    Sundials c;
    Pointer context, y, dense, memory;
    Newton newton;
    double *y_values, *dense_values; /* [n] of the vectors y, dense */
    double end;                      /* [s] end of CVODE's last step; y belongs to it */
    double longest;                  /* [s] what CVODE was told last; 0: no bound */
    bool cut;        /* the last step ended before CVODE's did: begin anew */
    bool planned;    /* CVODE has chosen its next step already */
    bool failed;     /* the model failed for good in a callback */
    bool refuted;    /* the model is not as sparse as the problem says */
    size_t doubts;   /* how many of the Jacobians so far an evaluation did not confirm */
    size_t rejected; /* before the last CVodeReInit */
    size_t looks;    /* Jacobians so far */
    Watch watch;
    double *step, *sums; /* [n], [3n] scratch for Jacobians */
    double work[];
} Gear;

static size_t vector_size(const Gear *g) { return g->base.problem.n * sizeof(double); }

/* ---- callbacks ---- */

static bool all_finite(const double *values, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

static int on_rhs(double t, Pointer y, Pointer ydot, void *data)
{
    Gear *g = data;
    const Problem *problem = &g->base.problem;
    double *dx = g->c.N_VGetArrayPointer(ydot);
    g->base.evaluations++;
    const Evaluation evaluation = problem->derivatives(problem->owner, t, g->c.N_VGetArrayPointer(y), dx);
    if (evaluation == EVALUATED) {
        return all_finite(dx, problem->n) ? EVALUATED : RECOVERABLE;
    }
    g->failed = g->failed || evaluation == FAILED;
    return evaluation;
}

/* CVODE asks once a step, so a scale that grows needs no restart. */
static int on_weights(Pointer y, Pointer weights, void *data)
{
    const Gear *g = data;
    const double *x = g->c.N_VGetArrayPointer(y);
    const Tolerance *tolerance = &g->base.tolerance;
    double *w = g->c.N_VGetArrayPointer(weights);
    for (size_t i = 0; i < g->base.problem.n; i++) {
        w[i] = 1.0 / allowed_error(tolerance, STRICTER * tolerance->rtol, i, x[i]);
    }
    return 0;
}

/* ---- Jacobian ---- */

/* One Jacobian: the derivatives at t by the states. */
typedef struct {
    Gear *gear;
    double t;
    Banded *matrix;
} At;

static Evaluation derivatives_at(void *owner, const double *x, double *dx)
{
    const At *at = owner;
    const Problem *problem = &at->gear->base.problem;
    at->gear->base.evaluations++;
    const Evaluation evaluation = problem->derivatives(problem->owner, at->t, x, dx);
    return evaluation == EVALUATED && !all_finite(dx, problem->n) ? RECOVERABLE : evaluation;
}

static double *entry_at(void *owner, size_t state, size_t row)
{
    const At *at = owner;
    const size_t *place = at->gear->base.problem.sparsity->place;
    return banded_at(at->matrix, place[row], place[state]);
}

static int on_jacobian(double t, Pointer y, Pointer ydot, Pointer matrix, void *data, Pointer moved, Pointer there,
                       Pointer unused)
{
    Gear *g = data;
    (void)unused;
    At at = {g, t, banded_of(matrix)};
    const size_t n = g->base.problem.n;
    const Groups *groups = &g->base.problem.sparsity->groups;
    const Sloped sloped = {
        .n = n, .n_values = n, .x = g->c.N_VGetArrayPointer(y), .scale = g->base.tolerance.scale,
        .here = g->c.N_VGetArrayPointer(ydot), .moved = g->c.N_VGetArrayPointer(moved), .step = g->step,
        .there = g->c.N_VGetArrayPointer(there), .sums = g->sums,
        .owner = &at, .evaluate = derivatives_at, .slope = entry_at,
    };
    Evaluation evaluation = grouped_fill(&sloped, groups, false, grouped_move, g->looks % 2 ? -1.0 : 1.0);
    if (evaluation == EVALUATED) {
        evaluation = grouped_confirm(&sloped, groups, (double)g->looks++);
        g->doubts += evaluation == RECOVERABLE; /* at a kink of the model, or because of what the file says */
        g->refuted = g->doubts > MOST_DOUBTS && 2 * g->doubts > g->looks;
        evaluation = evaluation == FAILED ? FAILED : EVALUATED;
    }
    g->failed = g->failed || evaluation == FAILED;
    return g->refuted ? FAILED : (int)evaluation;
}

static void on_error(int line, const char *function, const char *file, const char *message, int code, void *data,
                     Pointer context)
{
    Gear *g = data;
    (void)line, (void)function, (void)file, (void)code, (void)context;
    snprintf(g->base.message, SOLVER_MESSAGE, "gear: CVODE cannot continue: %s", message != NULL ? message : "");
    for (char *c = g->base.message; *c != '\0'; c++) {
        *c = *c == '\n' || *c == '\r' ? ' ' : *c;
    }
}

/* ---- creation ---- */

static bool take_functions(Gear *g, const GearLibrary *library)
{
    if (library == NULL || library->functions == NULL || library->n_functions != FUNCTIONS) {
        return false;
    }
    for (size_t i = 0; i < FUNCTIONS; i++) {
        if (library->functions[i] == NULL) {
            return false;
        }
    }
    memcpy(&g->c, library->functions, sizeof g->c); /* C has no cast from data to function pointers */
    return true;
}

static bool make_objects(Gear *g)
{
    const int64_t n = (int64_t)g->base.problem.n;
    const Sundials *c = &g->c;
    if (c->SUNContext_Create(0, &g->context) != 0) {
        return false;
    }
    c->SUNContext_ClearErrHandlers(g->context); /* SUNDIALS prints errors by default */
    c->SUNContext_PushErrHandler(g->context, on_error, g);
    g->y = c->N_VNew_Serial(n, g->context);
    g->dense = c->N_VNew_Serial(n, g->context);
    if (g->y == NULL || g->dense == NULL) {
        return false;
    }
    /* Several vectors in one pass: CVODE's own vectors are made after these. */
    c->N_VEnableFusedOps_Serial(g->y, 1);
    c->N_VEnableFusedOps_Serial(g->dense, 1);
    g->y_values = c->N_VGetArrayPointer(g->y);
    g->dense_values = c->N_VGetArrayPointer(g->dense);
    memset(g->y_values, 0, vector_size(g));
    g->memory = c->CVodeCreate(BDF, g->context);
    return g->memory != NULL;
}

static void drop_newton(const Sundials *c, Newton *newton)
{
    if (newton->linear != NULL && newton->banded != NULL) {
        gear_banded_free_solver(newton->banded, newton->linear);
    } else if (newton->linear != NULL) {
        c->SUNLinSolFree(newton->linear);
    }
    if (newton->matrix != NULL) {
        c->SUNMatDestroy(newton->matrix);
    }
    gear_banded_free(newton->banded);
    *newton = (Newton){0};
}

static bool make_newton(const Gear *g, const Sparsity *sparsity, Newton *newton)
{
    const int64_t n = (int64_t)g->base.problem.n;
    const Sundials *c = &g->c;
    newton->banded = sparsity != NULL ? gear_banded_new(c, g->context, sparsity, (size_t)n) : NULL;
    if (newton->banded != NULL) {
        newton->matrix = gear_banded_matrix(newton->banded);
        newton->linear = gear_banded_solver(newton->banded);
    } else {
        newton->matrix = c->SUNDenseMatrix(n, n, g->context);
        newton->linear = newton->matrix != NULL ? c->SUNLinSol_Dense(g->y, newton->matrix, g->context) : NULL;
    }
    return newton->matrix != NULL && newton->linear != NULL;
}

/* Give CVODE its Newton matrix: banded where that is known, else dense. */
static bool take_newton(Gear *g, const Sparsity *sparsity)
{
    const Sundials *c = &g->c;
    Newton old = g->newton; /* CVODE has a copy of its matrix until it gets another one */
    g->newton = (Newton){0};
    const bool done = make_newton(g, sparsity, &g->newton)
        && c->CVodeSetLinearSolver(g->memory, g->newton.linear, g->newton.matrix) == 0
        && c->CVodeSetJacFn(g->memory, g->newton.banded != NULL ? on_jacobian : NULL) == 0;
    if (!done) {
        drop_newton(c, &g->newton);
        g->newton = old;
        return false;
    }
    drop_newton(c, &old);
    return true;
}

static bool set_up(Gear *g)
{
    const Sundials *c = &g->c;
    return c->CVodeInit(g->memory, on_rhs, 0.0, g->y) == 0 && c->CVodeSetUserData(g->memory, g) == 0
        && c->CVodeWFtolerances(g->memory, on_weights) == 0
        && take_newton(g, g->base.problem.sparsity)
        && c->CVodeSetMaxHnilWarns(g->memory, NO_HNIL_WARNINGS) == 0
        && c->CVodeSetMaxConvFails(g->memory, MOST_FAILURES) == 0
        && c->CVodeSetMaxErrTestFails(g->memory, MOST_FAILURES) == 0;
}

static void destroy(Solver *solver)
{
    Gear *g = (Gear *)solver;
    const Sundials *c = &g->c;
    if (g->memory != NULL) {
        c->CVodeFree(&g->memory);
    }
    drop_newton(c, &g->newton);
    if (g->dense != NULL) {
        c->N_VDestroy(g->dense);
    }
    if (g->y != NULL) {
        c->N_VDestroy(g->y);
    }
    if (g->context != NULL) {
        c->SUNContext_Free(&g->context);
    }
    free(g);
}

static Evaluation indicators_at(void *owner, double t, double *z);

static Solver *create(const Problem *problem, const Tolerance *tolerance, const GearLibrary *library)
{
    const size_t doubles = 5 * problem->n + watch_doubles(problem->nz);
    Gear *g = problem->n > 0 ? calloc(1, sizeof *g + doubles * sizeof(double)) : NULL;
    if (g == NULL) {
        return NULL;
    }
    g->base.method = &solver_gear;
    g->base.problem = *problem;
    g->base.tolerance = *tolerance;
    g->base.x = g->work;
    g->step = g->work + problem->n;
    g->sums = g->step + problem->n;
    watch_bind(&g->watch, problem->nz, g->sums + 3 * problem->n, g, indicators_at);
    if (!take_functions(g, library) || !make_objects(g) || !set_up(g)) {
        destroy(&g->base);
        return NULL;
    }
    return &g->base;
}

/* ---- stepping ---- */

static bool fail(Gear *g, const char *words)
{
    Solver *solver = &g->base;
    if (g->failed) {
        solver->message[0] = '\0'; /* the owner knows why */
    } else if (solver->message[0] == '\0') {
        snprintf(solver->message, SOLVER_MESSAGE, "gear: %s", words);
    }
    return false;
}

static bool fail_from(Gear *g, Evaluation evaluation, const char *words)
{
    g->failed = g->failed || evaluation == FAILED;
    return fail(g, words);
}

static void count_rejected(Gear *g)
{
    long failures = 0;
    g->c.CVodeGetNumErrTestFails(g->memory, &failures);
    g->base.rejected = g->rejected + (size_t)failures;
}

/* Begin at solver->t, ->x with a first step h; 0: CVODE chooses it. */
static bool begin(Gear *g, double h)
{
    const Solver *solver = &g->base;
    g->rejected = solver->rejected;
    g->cut = g->planned = false;
    g->end = solver->t;
    memcpy(g->y_values, solver->x, vector_size(g));
    return g->c.CVodeReInit(g->memory, solver->t, g->y) == 0 && g->c.CVodeSetInitStep(g->memory, h) == 0;
}

static Evaluation states_at(Gear *g, double t, double *x)
{
    const bool inside = t != g->end;
    if (inside && g->c.CVodeGetDky(g->memory, t, 0, g->dense) != 0) {
        return RECOVERABLE;
    }
    memmove(x, inside ? g->dense_values : g->y_values, vector_size(g));
    return EVALUATED;
}

static Evaluation indicators_at(void *owner, double t, double *z)
{
    Gear *g = owner;
    const Problem *problem = &g->base.problem;
    const double *x = g->y_values;
    if (t != g->end) {
        if (g->c.CVodeGetDky(g->memory, t, 0, g->dense) != 0) {
            return RECOVERABLE;
        }
        x = g->dense_values;
    }
    return problem->indicators(problem->owner, t, x, z);
}

static bool restart(Solver *solver, double t, const double *x)
{
    Gear *g = (Gear *)solver;
    g->failed = false;
    solver->message[0] = '\0';
    solver->t = solver->t_old = t;
    memmove(solver->x, x, vector_size(g));
    if (!begin(g, 0.0)) {
        return fail(g, "CVODE does not begin");
    }
    const Evaluation evaluation = watch_restart(&g->watch, t);
    return evaluation == EVALUATED || fail_from(g, evaluation, "the event indicators cannot be evaluated");
}

/* A bound that shrinks does not touch the step that CVODE has planned: a nearer stop does. */
static bool set_bounds(Gear *g, double stop, double longest)
{
    const double bound = isfinite(longest) ? longest : 0.0; /* 0: none */
    const bool shrinks = g->planned && bound > 0.0 && (g->longest == 0.0 || bound < g->longest);
    const double nearest = shrinks && g->base.t + bound < stop ? g->base.t + bound : stop;
    if (bound != g->longest && g->c.CVodeSetMaxStep(g->memory, bound) != 0) {
        return false;
    }
    g->longest = bound;
    return g->c.CVodeSetStopTime(g->memory, nearest) == 0;
}

/* A model that is not as sparse as it says is stepped with a dense matrix, from where it stands. */
static bool one_step(Gear *g, double stop)
{
    const int status = g->c.CVode(g->memory, stop, g->y, &g->end, ONE_STEP);
    if (status >= 0 || !g->refuted) {
        return status >= 0;
    }
    g->refuted = false;
    g->base.message[0] = '\0';
    return take_newton(g, NULL) && begin(g, 0.0) && g->c.CVodeSetStopTime(g->memory, stop) == 0
        && g->c.CVode(g->memory, stop, g->y, &g->end, ONE_STEP) >= 0;
}

/* One accepted step of CVODE: to g->end, g->y. */
static bool advance(Gear *g, double stop, double longest)
{
    const double t = g->base.t;
    if (stop - t <= TINY_GAP * fmax(fabs(t), fabs(stop))) {
        g->end = stop;
        g->cut = true;
        memcpy(g->y_values, g->base.x, vector_size(g));
        return true;
    }
    if (!set_bounds(g, stop, longest) || !one_step(g, stop)) {
        return fail(g, "CVODE cannot continue");
    }
    g->planned = true;
    count_rejected(g);
    if (!all_finite(g->y_values, g->base.problem.n)) {
        return fail(g, "a state is not a finite number");
    }
    return g->end > t
        || fail(g, "the step became too small; the model jumps without an event or is not defined further on");
}

/* Take the step over, up to the first event in it. */
static Evaluation take(Gear *g, bool *event)
{
    Solver *solver = &g->base;
    double end = g->end;
    Evaluation evaluation = watch_step(&g->watch, solver->t, &end, event);
    if (evaluation == EVALUATED) {
        evaluation = states_at(g, end, solver->x);
    }
    if (evaluation == EVALUATED) {
        g->cut = g->cut || end != g->end;
        solver->t_old = solver->t;
        solver->t = end;
        solver->steps++;
    }
    return evaluation;
}

static bool step(Solver *solver, double stop, double longest, bool *event)
{
    Gear *g = (Gear *)solver;
    *event = false;
    g->failed = false;
    solver->message[0] = '\0';
    if (g->cut && !begin(g, 0.0)) {
        return fail(g, "CVODE does not begin");
    }
    for (int retreats = 0; retreats < MOST_RETREATS; retreats++) {
        if (!advance(g, stop, longest)) {
            return false;
        }
        const double h = g->end - solver->t;
        const Evaluation evaluation = take(g, event);
        if (evaluation == EVALUATED) {
            return true;
        }
        if (evaluation == FAILED) {
            return fail_from(g, evaluation, "");
        }
        solver->rejected++; /* the indicators cannot be evaluated there: shorter, as for the right-hand side */
        if (!begin(g, 0.25 * h)) {
            break;
        }
    }
    return fail(g, "the event indicators cannot be evaluated");
}

static bool interpolate(const Solver *solver, double t, double *x)
{
    Gear *g = (Gear *)solver; /* the vector for dense output is scratch */
    if (t == solver->t) {
        memmove(x, solver->x, vector_size(g));
        return true;
    }
    return states_at(g, t, x) == EVALUATED || fail(g, "no interpolation there");
}

const SolverMethod solver_gear = {"gear", create, restart, step, interpolate, destroy};
