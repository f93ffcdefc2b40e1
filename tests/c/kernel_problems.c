/* kernel_problems.c: small problems with known answers, and a door for ctypes to the kernel's solvers. */
#include "solver.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define PI 3.14159265358979323846

typedef Evaluation (*Function)(double t, const double *x, double *out);

/* ---- the problems ---- */

static Evaluation decay(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = -x[0];
    return EVALUATED;
}

/* Eigenvalues -1 and -1000; (cos t, sin t) solves it, so do multiples of e^-t (1, 1) and e^-1000t (1, -1) added. */
static Evaluation stiff(double t, const double *x, double *dx)
{
    const double u = x[0] - cos(t), v = x[1] - sin(t);
    dx[0] = -500.5 * u + 499.5 * v - sin(t);
    dx[1] = 499.5 * u - 500.5 * v + cos(t);
    return EVALUATED;
}

static Evaluation van_der_pol(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = x[1];
    dx[1] = 1000.0 * (1.0 - x[0] * x[0]) * x[1] - x[0];
    return EVALUATED;
}

static Evaluation oscillator(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = x[1];
    dx[1] = -x[0];
    return EVALUATED;
}

static Evaluation first_state(double t, const double *x, double *z)
{
    (void)t;
    z[0] = x[0];
    return EVALUATED;
}

static Evaluation time_only(double t, const double *x, double *z)
{
    (void)x;
    z[0] = sin(2.0 * PI * t);
    z[1] = 0.7 - t;
    return EVALUATED;
}

static Evaluation rise(double t, const double *x, double *dx)
{
    (void)t, (void)x;
    dx[0] = 1.0;
    return EVALUATED;
}

static Evaluation walled(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = 1.0;
    return x[0] > 1.0 ? RECOVERABLE : EVALUATED;
}

static Evaluation near_wall(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = 100.0 * (1.0 - x[0]);
    return x[0] > 1.001 ? RECOVERABLE : EVALUATED;
}

static Evaluation not_a_number(double t, const double *x, double *dx)
{
    (void)x;
    dx[0] = sqrt(1.0 - t);
    return EVALUATED;
}

static Evaluation broken(double t, const double *x, double *dx)
{
    (void)x;
    dx[0] = 1.0;
    return t > 0.5 ? FAILED : EVALUATED;
}

/* Thrown up at 1 m/s: the height is above 0.4999 from 1 - sqrt(0.0002) to 1 + sqrt(0.0002) only. */
static Evaluation thrown(double t, const double *x, double *dx)
{
    (void)t;
    dx[0] = x[1];
    dx[1] = -1.0;
    return EVALUATED;
}

static Evaluation near_top(double t, const double *x, double *z)
{
    (void)t;
    z[0] = x[0] - 0.4999;
    return EVALUATED;
}

static Evaluation three_levels(double t, const double *x, double *z)
{
    (void)t;
    z[0] = x[0] - 0.7;
    z[1] = 0.3 - x[0];
    z[2] = x[0] - 0.3001;
    return EVALUATED;
}

static Evaluation until_one(double t, const double *x, double *z)
{
    (void)x;
    z[0] = 1.0 - t;
    return EVALUATED;
}

static Evaluation wall_for_indicators(double t, const double *x, double *z)
{
    (void)t;
    z[0] = 0.999 - x[0];
    return x[0] > 1.0 ? RECOVERABLE : EVALUATED;
}

static Evaluation broken_indicator(double t, const double *x, double *z)
{
    (void)t;
    z[0] = 1.0;
    return x[0] > 0.5 ? FAILED : EVALUATED;
}

typedef struct {
    const char *name;
    size_t n, nz;
    Function derivatives, indicators;
} Named;

static const Named PROBLEMS[] = {
    {"decay", 1, 0, decay, NULL},
    {"stiff", 2, 0, stiff, NULL},
    {"van_der_pol", 2, 0, van_der_pol, NULL},
    {"oscillator", 2, 1, oscillator, first_state},
    {"smooth_oscillator", 2, 0, oscillator, NULL},
    {"time_only", 0, 2, NULL, time_only},
    {"nothing", 0, 0, NULL, NULL},
    {"rise", 1, 1, rise, first_state},
    {"walled", 1, 0, walled, NULL},
    {"near_wall", 1, 0, near_wall, NULL},
    {"not_a_number", 1, 0, not_a_number, NULL},
    {"broken", 1, 0, broken, NULL},
    {"thrown", 2, 1, thrown, near_top},
    {"three_levels", 1, 3, rise, three_levels},
    {"until_one", 1, 1, rise, until_one},
    {"wall_for_indicators", 1, 1, rise, wall_for_indicators},
    {"broken_indicator", 1, 1, rise, broken_indicator},
};

/* ---- the door ---- */

typedef struct {
    const Named *named;
    size_t evaluations, asked; /* of the derivatives, of the indicators */
    double furthest;           /* [s] latest time of an evaluation */
    double scale[2];
    Solver *solver;
} Bench;

static Evaluation bench_derivatives(void *owner, double t, const double *x, double *dx)
{
    Bench *bench = owner;
    bench->evaluations++;
    bench->furthest = fmax(bench->furthest, t);
    return bench->named->derivatives(t, x, dx);
}

static Evaluation bench_indicators(void *owner, double t, const double *x, double *z)
{
    Bench *bench = owner;
    bench->asked++;
    return bench->named->indicators(t, x, z);
}

static const Named *find(const char *name)
{
    for (size_t i = 0; i < sizeof PROBLEMS / sizeof PROBLEMS[0]; i++) {
        if (strcmp(PROBLEMS[i].name, name) == 0) {
            return &PROBLEMS[i];
        }
    }
    return NULL;
}

EXPORT int bench_evaluate(const char *name, double t, const double *x, double *dx)
{
    return find(name)->derivatives(t, x, dx);
}

EXPORT int bench_indicate(const char *name, double t, const double *x, double *z)
{
    const Named *named = find(name);
    return named->nz > 0 ? named->indicators(t, x, z) : EVALUATED;
}

EXPORT void bench_close(Bench *bench)
{
    if (bench->solver != NULL) {
        bench->solver->method->destroy(bench->solver);
    }
    free(bench);
}

EXPORT Bench *bench_open(const char *solver, const char *name, double rtol, double scale, const GearLibrary *library)
{
    static const SolverMethod *const methods[] = {&solver_vkm, &solver_gear, &solver_none};
    Bench *bench = calloc(1, sizeof *bench);
    if (bench == NULL) {
        return NULL;
    }
    bench->named = find(name);
    bench->scale[0] = bench->scale[1] = scale;
    const Problem problem = {bench, bench->named->n, bench->named->nz, bench_derivatives, bench_indicators,
                             NULL};
    const Tolerance tolerance = {rtol, bench->scale, NULL};
    for (size_t i = 0; i < 3; i++) {
        if (strcmp(methods[i]->name, solver) == 0) {
            bench->solver = methods[i]->create(&problem, &tolerance, library);
        }
    }
    if (bench->solver == NULL) {
        bench_close(bench);
        return NULL;
    }
    return bench;
}

EXPORT bool bench_restart(Bench *bench, double t, const double *x)
{
    return bench->solver->method->restart(bench->solver, t, x);
}

EXPORT bool bench_step(Bench *bench, double stop, double longest, bool *event)
{
    return bench->solver->method->step(bench->solver, stop, longest, event);
}

EXPORT bool bench_interpolate(Bench *bench, double t, double *x)
{
    return bench->solver->method->interpolate(bench->solver, t, x);
}

EXPORT void bench_look(const Bench *bench, double *t, double *x)
{
    t[0] = bench->solver->t;
    t[1] = bench->solver->t_old;
    t[2] = bench->furthest;
    memcpy(x, bench->solver->x, bench->named->n * sizeof *x);
}

EXPORT void bench_count(const Bench *bench, size_t *counts)
{
    counts[0] = bench->solver->evaluations;
    counts[1] = bench->solver->steps;
    counts[2] = bench->solver->rejected;
    counts[3] = bench->evaluations;
    counts[4] = bench->asked;
}

EXPORT const char *bench_message(const Bench *bench) { return bench->solver->message; }

/* All steps to `stop`, restarting at events; how many events, or -1. */
EXPORT int bench_run(Bench *bench, double stop, double longest)
{
    int events = 0;
    Solver *solver = bench->solver;
    while (solver->t < stop) {
        bool event = false;
        if (!solver->method->step(solver, stop, longest, &event)) {
            return -1;
        }
        if (event && !solver->method->restart(solver, solver->t, solver->x)) {
            return -1;
        }
        events += event;
    }
    return events;
}

#ifdef BENCH_MAIN
#include <dlfcn.h>
#include <stdio.h>

enum { MOST_FUNCTIONS = 64 };

/* Arguments: pairs of a library and a function in it, in the order of the table. */
static GearLibrary load(int count, char **arguments)
{
    static void *functions[MOST_FUNCTIONS];
    size_t found = 0;
    for (int i = 1; i + 1 < count && found < MOST_FUNCTIONS; i += 2) {
        void *library = dlopen(arguments[i], RTLD_NOW | RTLD_GLOBAL);
        functions[found++] = library != NULL ? dlsym(library, arguments[i + 1]) : NULL;
    }
    return (GearLibrary){functions, found};
}

static bool visit(Bench *bench, const double *x)
{
    bool event = false, good = bench_restart(bench, 0.0, x);
    for (int n = 0; good && n < 2000 && bench->solver->t < 2.0; n++) {
        double middle[2] = {0.0, 0.0};
        good = bench_step(bench, 2.0, 0.3, &event)
            && bench_interpolate(bench, 0.5 * (bench->solver->t + bench->solver->t_old), middle)
            && (!event || bench_restart(bench, bench->solver->t, bench->solver->x));
    }
    return good;
}

/* For sanitizers: every problem with every solver, in steps, points and restarts. */
int main(int count, char **arguments)
{
    static const char *const solvers[] = {"vkm", "none", "gear"};
    const GearLibrary library = load(count, arguments);
    for (size_t i = 0; i < 3 * sizeof PROBLEMS / sizeof PROBLEMS[0]; i++) {
        const Named *named = &PROBLEMS[i / 3];
        const double x[2] = {named->derivatives == stiff ? 3.0 : 0.5, 1.0};
        Bench *bench = bench_open(solvers[i % 3], named->name, 1e-6, 1e-3, &library);
        for (int repeat = 0; bench != NULL && repeat < 2; repeat++) {
            const bool good = visit(bench, x);
            printf("%s %s %d %.17g %s\n", solvers[i % 3], named->name, good, bench->solver->t, bench_message(bench));
        }
        if (bench != NULL) {
            bench_close(bench);
        }
    }
    return 0;
}
#endif
