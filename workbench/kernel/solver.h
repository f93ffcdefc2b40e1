/* solver.h: what a solver of ordinary differential equations is to the kernel.
 *
 * Obligations of every solver (the same as of tests/oracle/solver.py, its readable twin):
 *   1. `restart` forgets the past; nothing computed later depends on what was before it.
 *   2. `step` makes one accepted step from (t, x), never beyond `stop` and never longer than `longest`;
 *      it ends early, just after it (within 1e-12 relative), where an event indicator changes between
 *      > 0 and <= 0, and then sets *event. A step that reaches `stop` ends with t exactly `stop`.
 *   3. `interpolate(t)` is valid for t_old <= t <= t of the last step.
 *   4. A recoverable failure of the problem, or a value that is not finite, shortens the step first.
 *   5. No memory is allocated after `create`, except by CVODE for itself.
 */
#ifndef WORKBENCH_KERNEL_SOLVER_H
#define WORKBENCH_KERNEL_SOLVER_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

typedef enum {
    EVALUATED = 0,
    RECOVERABLE = 1, /* the FMU discards this point, or a value is not finite: try a shorter step */
    FAILED = -1      /* for good; the owner knows why */
} Evaluation;

/* Which states are moved at once to find slopes, and which values each of them moves, as the file says. */
typedef struct {
    const size_t *members; /* [n] the states, group after group */
    const size_t *ends;    /* [n_groups] where each group ends in `members` */
    size_t n_groups;
    const size_t *first;   /* [n + 1] where the values that a state moves begin in `rows`; NULL: it may move all */
    const size_t *rows;
} Groups;

/* What is known of df/dx: with the states in another order it is a band. */
typedef struct {
    Groups groups;
    const size_t *place;  /* [n] of each state in the band */
    size_t below, above;  /* diagonals of the band beside its own */
} Sparsity;

/* dx/dt = f(t, x) with event indicators z(t, x); inputs are evaluated inside, at t. */
typedef struct {
    void *owner;
    size_t n, nz;
    Evaluation (*derivatives)(void *owner, double t, const double *x, double *dx);
    Evaluation (*indicators)(void *owner, double t, const double *x, double *z);
    const Sparsity *sparsity; /* NULL: nothing is known */
} Problem;

/* Error weights: |error_i| <= rtol·(|x_i| + scale_i). The kernel grows `scale` where the FMU declares no
 * nominal value, and restarts the solver then. Where `flight` is finite, it takes the place of |x_i| + scale_i: how
 * far a state moves between events that follow each other faster and faster, the bounces of a ball that comes to
 * rest, which would drown in the tolerance of the motion before. */
typedef struct {
    double rtol;
    const double *scale;  /* [n] */
    const double *flight; /* [n], INFINITY while events do not; NULL: always so */
} Tolerance;

/* Largest error of state i at x; `rtol` is relative to its size. Never below rounding. */
static inline double allowed_error(const Tolerance *tolerance, double rtol, size_t i, double x)
{
    const double size = fabs(x) + tolerance->scale[i];
    const double moved = tolerance->flight != NULL ? tolerance->flight[i] : (double)INFINITY;
    return moved < size ? fmax(rtol * moved, 1e-13 * size) : rtol * size;
}

enum { SOLVER_MESSAGE = 256 };

typedef struct Solver Solver;

struct Solver {
    const struct SolverMethod *method;
    Problem problem;
    Tolerance tolerance;
    double t;     /* present time [s] */
    double t_old; /* where the last step began [s] */
    double *x;    /* [n] present states */
    size_t evaluations, steps, rejected;
    char message[SOLVER_MESSAGE]; /* why the last call failed */
};

/* CVODE and what it needs, by address; all NULL where SUNDIALS is missing. The order is that of
 * GEAR_FUNCTIONS in workbench/kernel/gear.py. */
typedef struct {
    void *const *functions;
    size_t n_functions;
} GearLibrary;

typedef struct SolverMethod {
    const char *name;
    /* NULL when memory is short or the library is missing. */
    Solver *(*create)(const Problem *problem, const Tolerance *tolerance, const GearLibrary *library);
    bool (*restart)(Solver *solver, double t, const double *x);
    bool (*step)(Solver *solver, double stop, double longest, bool *event);
    bool (*interpolate)(const Solver *solver, double t, double *x);
    void (*destroy)(Solver *solver);
} SolverMethod;

extern const SolverMethod solver_vkm;  /* Kutta-Merson, variable step */
extern const SolverMethod solver_gear; /* CVODE, BDF */
extern const SolverMethod solver_none; /* no continuous states: time events and indicators of time only */

#endif
