/* forcing.h: the forced inputs: evaluate their signals, write them, remember what was written.
 *
 * The twin of workbench/session/forcing.py. The caller owns all memory a Forcing points to.
 */
#ifndef WORKBENCH_KERNEL_FORCING_H
#define WORKBENCH_KERNEL_FORCING_H

#include "access.h"
#include "signals.h"

typedef enum { CONTINUOUS_INPUTS = 1, DISCRETE_INPUTS = 2, ALL_INPUTS = 3 } Inputs;
enum { ANYONE = -1 };

typedef struct {
    const Signal *signals;   /* [n] */
    const double *bias;      /* [n] */
    const int32_t *types;    /* [n] ValueType */
    const int32_t *owners;   /* [n] component */
    const int32_t *discrete; /* [n] may change at events only */
    double *written;         /* [n] what the FMUs see now */
    double *wanted;          /* [n] scratch */
    double *seen;            /* [n] what they see just before the end of a step */
    double *slopes;          /* [n] scratch [1/s] */
    const int32_t *orders;   /* [n] ones */
    size_t n, n_discrete;
    Access fast, slow; /* columns are positions in the list above */
    double longest_step;
    /* What was computed last, to be used again; zeroed by the caller. */
    double break_from, break_at; /* [s] `break_at` is the next break of all times from `break_from` on before it */
    double wanted_at;            /* [s] time of `wanted` */
    int32_t has_break, has_wanted;
} Forcing;

/* One input at t, biased. */
double forcing_value(const Forcing *forcing, size_t i, double t);
double forcing_next_break(Forcing *forcing, double t);
/* All values at t, biased, as the FMUs would see them, to `wanted`. */
void forcing_evaluate(Forcing *forcing, double t);
/* Whether an input of these, of one component or of any, is not `wanted`; NaN differs from everything. */
bool forcing_differs(const Forcing *forcing, Inputs which, int32_t who);
/* Write the inputs that may change in continuous time. */
bool forcing_write_continuous(Forcing *forcing, Component *components, double t, Failure *failure);
/* Write `wanted`; allowed in event mode and between co-simulation steps. */
bool forcing_write_wanted(Forcing *forcing, Component *components, Failure *failure);
/* All values just before `end`, to `wanted`; discrete ones as they are. */
void forcing_look_ahead(Forcing *forcing, double t, double end);
/* Tell those FMUs that can take it how their inputs go on until `end`; fills `seen`. */
void forcing_give_slopes(Forcing *forcing, Component *components, double t, double end);

#endif
