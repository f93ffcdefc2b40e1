/* system.h: a list of components with connections; a single FMU is a list of one. One code path drives all.
 *
 * The caller owns all memory a System points to. Links are evaluated in the order given, which must be such that
 * every source is up to date when it is read; what depends on itself without delay is one link, a loop. The twin of
 * workbench/system/propagation.py; the caller's arrays are shared with it.
 */
#ifndef WORKBENCH_KERNEL_SYSTEM_H
#define WORKBENCH_KERNEL_SYSTEM_H

#include "access.h"
#include "forcing.h"

/* Connections that are evaluated together: outputs of components to inputs of others. */
typedef struct {
    Access source, destination; /* columns are numbers of connections */
    const size_t *members;      /* [n] numbers of the connections */
    size_t n;
    double *work;     /* scratch, see `loop_doubles`; NULL: no loop */
    double *jacobian; /* [n][n] of a loop's residual, by rows */
    int32_t *known;   /* whether that can be used */
    /* Of a loop whose sources and destinations are all scalar doubles; else NULL. Arrays [n]. */
    const int32_t *from, *to;            /* components of the sources and the destinations */
    const uint32_t *unknowns, *knowns;   /* value references of the sources and the destinations */
    uint32_t *asked;                     /* scratch */
    int32_t *exact; /* Exactness: whether the directional derivatives by a destination are to be believed */
} Link;

/* They are compared with differences once. */
typedef enum { NOT_EXACT, PERHAPS_EXACT, EXACT } Exactness;

/* destination = gain · source + offset, 0 before it closes. Arrays [n]. */
typedef struct {
    const double *gains, *offsets;
    const double *closes_at; /* [s] */
    const double *typical;   /* nominal values of the destinations */
    double *values;          /* what the destinations see */
    double *sizes;           /* largest magnitude each value of a loop has had */
    double *fresh;           /* scratch */
    double *seen;            /* by the destinations when their components evaluated the present event */
    const int32_t *to;       /* components of the destinations */
    int32_t *closed;
    size_t n;
} Wires;

typedef struct {
    Component *components;
    size_t n_components;
    Link *links; /* at events */
    size_t n_links;
    Link *moving; /* in continuous time: those whose values can change there */
    size_t n_moving;
    Wires wires;
    const size_t *order; /* [n_components] in which they handle an event; NULL: as they are numbered */
    size_t nx, nz;              /* sums over the components */
    Forcing *forcing;           /* in force */
    int64_t evaluations;        /* right-hand sides */
    int64_t steps;              /* accepted steps of solvers, communication steps */
    int64_t pause_at;           /* steps at which a run lets the caller look after signals */
    int64_t ordered;            /* evaluations that bore out the order of the links */
    double limit;               /* no signal is evaluated later than this [s] */
    Failure failure;
    Failure unsolved; /* of connections, that a shorter step may have avoided: the last one */
} System;

enum { STEPS_BETWEEN_PAUSES = 1000, ENOUGH_ORDERED = 64 };

/* Begin or go on with a run. */
void system_go_on(System *system);
/* Whether it is time for a pause; noted as PAUSED then. */
bool system_pauses(System *system, double time);

/* Copy what is connected; `events`: discrete inputs too. `changed` (may be NULL): whether a value did. */
bool system_propagate(System *system, bool events, bool *changed);
/* Read what is connected by `link`, as its destinations are to see it, to `values` [link->n]. */
bool link_read(System *system, Link *link, double *values);
/* Let the destinations of `link` see `values` [link->n]. */
bool link_write(System *system, Link *link, const double *values);

/* One round of an event iteration: what the components say, and whether a connected value changed. */
typedef struct {
    bool first; /* of its event */
    bool some;  /* at least one handles events */
    bool again, moved, states_changed;
    int32_t ended; /* who ends the run, or NOBODY */
} Round;

enum { NOBODY = -1 };

/* Every component evaluates the event at `time` [s] once, in the order of the data flow, with what those before it
 * show since they did; notes when each is due next. What ticks in a circle ticks anew from where it stood before if what
 * it saw then has changed since: all that coincides sees the same values. */
bool system_update(System *system, double time, Round *round);
/* The event is over: forget what stood before it. */
bool system_settled(System *system);
/* Gather when connections close. */
void system_gather_switches(const System *system, Gathered *next);
/* The next instant after `now` at which a component is due or a connection closes [s]. */
double system_next_event(const System *system, double now);

/* At events: close the connections that are due at `time` [s]. */
void system_switch(System *system, double time);

/* Model exchange: set time [s], states and the continuous inputs of that time. The order of the links is believed
 * after ENOUGH_ORDERED evaluations only: a description may keep silent about an input that an output depends on. */
bool system_put(System *system, double t, const double *x);
bool system_vectors(System *system, FunctionIndex function, double *values, bool indicators);

/* Enter a mode in every component that has modes. */
bool system_enter(System *system, FunctionIndex mode);

#endif
