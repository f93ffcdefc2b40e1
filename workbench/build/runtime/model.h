/* model.h: what the generated model.c provides to core.c, and the helpers its equations use. */
#ifndef WORKBENCH_MODEL_H
#define WORKBENCH_MODEL_H

#include <float.h>
#include <math.h>

#include "core.h"

/* The arrays that the equations read and write. */
typedef struct {
    double *v;             /* values by value reference; v[0] is time */
    double *pre;           /* values before this event iteration, by value reference */
    double *frozen;        /* relations (0 or 1), then integer quotients: fixed between events */
    double *condition;     /* when-conditions in this event iteration ... */
    double *condition_pre; /* ... and in the one before */
    double *tick;          /* 1 for a clock that ticks in this event iteration */
    struct Delay *delays;  /* [model_layout.n_delays] */
    bool fresh;            /* relations are evaluated, else they keep their values */
    bool initial;          /* the model is being initialised */
} Frame;

/* A clock ticks at phase + k·period; both are quotients of whole numbers [s]. */
typedef struct {
    long long period_numerator, period_denominator, phase_numerator, phase_denominator;
} ClockInfo;

typedef struct {
    size_t n_frozen, n_conditions, n_clocks, n_discrete, n_delays;
    const unsigned *discrete;   /* [n_discrete] value references of variables with a memory of events */
    const unsigned *indicators; /* [model_info.n_indicators] value references */
    const ClockInfo *clocks;    /* [n_clocks] */
} ModelLayout;

extern const ModelLayout model_layout;

enum { ACTION_NONE = 0, ACTION_REINIT = 1, ACTION_TERMINATE = 2, ACTION_ASSERT = 4 };

void model_start_values(double *v);          /* start values that are numbers */
void model_parameters(const Frame *f);       /* calculated parameters */
void model_start_expressions(const Frame *f); /* start values that depend on parameters */
void model_continuous(const Frame *f);       /* derivatives, algebraic variables, indicators */
/* The outputs alone, in continuous time; not to be called unless model_outputs_apart. */
extern const bool model_outputs_apart;
void model_outputs(const Frame *f);
void model_discrete(const Frame *f);         /* the same and all discrete equations: one event iteration */
/* reinit() into x (states in FMI's order, preset with their values); which actions fired. */
unsigned model_actions(const Frame *f, double *x, const char **message);
double model_next_deadline(const Frame *f);  /* HUGE_VAL when there is none */
void model_tangent(const Frame *f, double *d); /* d: seeds in, tangents of everything out */

/* Delay `number`, by delays.c: note its input and its time, return the value that comes out of it now. */
double delayed(const Frame *f, double input, double lag, double number);
double goes_through(const Frame *f, double number); /* 1 before the first step, when that is the input; else 0 */

/* Whether the time has come for an event that is due at `instant`, rounding allowed for. */
static inline bool reached(double time, double instant)
{
    return time >= instant - 8.0 * DBL_EPSILON * fmax(1.0, fabs(instant));
}

static inline double sign_of(double x)
{
    return (double)((x > 0.0) - (x < 0.0));
}

static inline double smaller(double a, double b)
{
    return a <= b ? a : b;
}

static inline double larger(double a, double b)
{
    return a >= b ? a : b;
}

/* Element number `index` (from 1) of a table; outside it, not a number. */
static inline double pick(double index, int n, const double *elements)
{
    return index >= 1.0 && index <= (double)n ? elements[(int)index - 1] : NAN;
}

static inline double dot(const double *a, int stride_a, const double *x, int stride_x, int n)
{
    double total = 0.0;
    for (int i = 0; i < n; i++) {
        total += a[i * stride_a] * x[i * stride_x];
    }
    return total;
}

#endif
