/* system.h: a list of components with connections; a single FMU is a list of one. One code path drives all.
 *
 * The caller owns all memory a System points to. Links are evaluated in the order given, which must be such
 * that every source is up to date when it is read: feed-through loops are not solved here.
 */
#ifndef WORKBENCH_KERNEL_SYSTEM_H
#define WORKBENCH_KERNEL_SYSTEM_H

#include "access.h"
#include "forcing.h"

/* destination[i] = gain[i] · source[i]: outputs of one component to inputs of another. */
typedef struct {
    Access source, destination; /* columns 0 … n-1 */
    const double *gains;        /* [n] */
    double *values;             /* [n] what the destination sees */
    double *fresh;              /* [n] scratch */
    size_t n;
    int32_t discrete; /* the destination may change at events only */
} Link;

typedef struct {
    Component *components;
    size_t n_components;
    Link *links;
    size_t n_links;
    size_t nx, nz;              /* sums over the components */
    Forcing *forcing;           /* in force */
    int64_t evaluations;        /* right-hand sides */
    int64_t steps;              /* accepted steps of solvers, communication steps */
    int64_t pause_at;           /* steps at which a run lets the caller look after signals */
    double limit;               /* no signal is evaluated later than this [s] */
    Failure failure;
} System;

enum { STEPS_BETWEEN_PAUSES = 1000 };

/* Begin or go on with a run. */
void system_go_on(System *system);
/* Whether it is time for a pause; noted as PAUSED then. */
bool system_pauses(System *system, double time);

/* Copy what is connected; `events`: discrete inputs too. `changed` (may be NULL): whether a value did. */
bool system_propagate(System *system, bool events, bool *changed);

/* Model exchange: set time [s], states and the continuous inputs of that time. */
bool system_put(System *system, double t, const double *x);
bool system_vectors(System *system, FunctionIndex function, double *values, bool indicators);

/* Enter a mode in every component that has modes. */
bool system_enter(System *system, FunctionIndex mode);

#endif
