/* inputs.h: continuous inputs as polynomials of time over one communication step.
 *
 * u(t) = value + d1 (t - origin) + d2 (t - origin)^2 / 2 + d3 (t - origin)^3 / 6, where origin is the
 * communication point. Derivatives count for the next doStep only; after it the input keeps the value
 * it has reached.
 */
#ifndef WORKBENCH_INPUTS_H
#define WORKBENCH_INPUTS_H

#include "core.h"
#include "memory.h"

#define INPUT_MAX_ORDER 3

/* One input, all doubles: the block of all inputs is copied as it is into a saved FMU state. */
typedef struct {
    double origin;
    double value;
    double derivative[INPUT_MAX_ORDER];
    double fresh;  /* 1: set since the last doStep */
    double active; /* 1: a derivative differs from 0 in the step under way or just done */
} InputPolynomial;

typedef struct {
    size_t n;
    unsigned *references; /* [n] */
    InputPolynomial *polynomials; /* [n] */
    bool any_active;
} Inputs;

bool inputs_new(Inputs *inputs, const Memory *memory); /* false: no memory (nothing is kept) */
void inputs_free(Inputs *inputs, const Memory *memory);
void inputs_clear(Inputs *inputs);

/* NULL when the variable is no continuous Real input. */
InputPolynomial *inputs_find(Inputs *inputs, unsigned reference);
void inputs_set_derivative(InputPolynomial *polynomial, size_t order, double value);

/* At the start of a doStep: what was not set anew is dropped, the rest starts at `origin`. */
bool inputs_begin(Inputs *inputs, Core *core, double origin);
void inputs_end(Inputs *inputs);

void inputs_apply(const Inputs *inputs, Core *core, double time);
double inputs_slope(const InputPolynomial *polynomial, double time);

#endif
