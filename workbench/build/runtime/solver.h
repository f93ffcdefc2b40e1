/* solver.h: integrates the continuous states of one core for Co-Simulation.
 *
 * Variable steps with error control; the first change of an event indicator's domain (z > 0 or
 * z <= 0) inside a step is located on the method's dense output and the step ends there, just on the
 * new side. One method a file: explicit.c (Dormand-Prince) and implicit.c (Radau IIA).
 *
 * Between two doStep calls only the proposed step size is kept (it belongs to the FMU state);
 * everything else is computed again, so that a restored state continues bit for bit.
 */
#ifndef WORKBENCH_SOLVER_H
#define WORKBENCH_SOLVER_H

#include "core.h"
#include "inputs.h"
#include "memory.h"

typedef struct Solver Solver;

/* A method's obligations. `data` is what `create` returned. Vectors have solver->n elements. */
typedef struct {
    const char *name;
    double error_exponent; /* new step = step * error^-exponent */
    double memory_exponent; /* of the previous error (PI control), 0: none */
    double hold_below;     /* growth in [1, hold_below] is not worth a new decomposition */
    void *(*create)(const Memory *memory, size_t n);
    void (*destroy)(const Memory *memory, void *data);
    void (*begin)(Solver *solver); /* after a discontinuity: nothing of earlier steps may be used */
    /* Tries a step of size h from (t, x) with dx = f(t, x): fills x_new and `error` (vector). False:
     * the equations cannot be evaluated or solved with this h. */
    bool (*attempt)(Solver *solver, double h);
    bool (*accept)(Solver *solver); /* the step was taken: dx = f(t_new, x_new); false: no value */
    void (*interpolate)(const Solver *solver, double theta, double *x); /* 0 <= theta <= 1 */
} Method;

extern const Method method_explicit;
extern const Method method_implicit;

/* SOLVER_AGAIN is internal: the step has to be tried once more with another size. */
typedef enum { SOLVER_STEP, SOLVER_EVENT, SOLVER_FAILED, SOLVER_AGAIN } SolverResult;

struct Solver {
    Core *core;
    Inputs *inputs;
    const Memory *memory;
    const Method *method;
    void *data;
    size_t n;   /* states */
    size_t n_z; /* event indicators */
    double tolerance; /* relative; absolute = 0.01 * relative * nominal */
    double t;
    double h; /* size of the last step attempted */
    double longest_start; /* the longest step to begin with, where none is proposed */
    double previous_error;
    size_t worst; /* the state with the largest error */
    double *work;
    double *x, *x_new, *dx, *error, *scale, *probe;
    double *z_start, *z_before, *z_after, *z_scratch;
    char problem[256]; /* why SOLVER_FAILED */
};

Solver *solver_new(Core *core, Inputs *inputs, const Memory *memory); /* NULL: no memory */
void solver_free(Solver *solver);

/* (Re)start from the core's time and states. False: see `problem`. */
bool solver_begin(Solver *solver, double tolerance);

/* One accepted step, at most to t_stop, which is hit exactly. *step is the proposed step size,
 * 0 to have one chosen. SOLVER_EVENT: an indicator changed its domain; t may be < t_stop. */
SolverResult solver_step(Solver *solver, double t_stop, double *step);

/* For the methods. */
bool solver_evaluate(Solver *solver, double t, const double *x, double *dx);
double solver_norm(const Solver *solver, const double *vector); /* maximum, weighted by scale */

/* events.c: true when an indicator changed in the step just attempted; *theta: just after the first. */
typedef enum { CROSSING_NONE, CROSSING_FOUND, CROSSING_FAILED } Crossing;
Crossing events_find(Solver *solver, double *theta);
bool events_remember(Solver *solver); /* indicators at (t, x) are the ones to compare with */

#endif
