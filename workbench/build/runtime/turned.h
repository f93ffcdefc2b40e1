/* turned.h: the watch over indicators that an event turned back, or stopped (the rule: event_rules.h). */
#ifndef WORKBENCH_TURNED_H
#define WORKBENCH_TURNED_H

#include "solver.h"

/* Only doubles: it lies in a saved state, with its vectors behind it. */
typedef struct {
    double since;   /* the event that turned the indicators under watch [s] */
    double ahead;   /* how far ahead the rates before an event were looked at [s] */
    double known;   /* 1: these rates are known: an event is under way, or may come where a step ended */
    double watches; /* 1: some indicator is under watch */
} Turned;

/* Doubles of the vectors: a bound of each indicator (0: it may go anywhere), its way ahead before the event
 * (NaN: it did not come through its zero) and its value there; the states and derivatives there. */
size_t turned_doubles(void);

/* Just before an event where the solver stands; `located` at an indicator's zero, `span` the time scale. */
void turned_before(Turned *turned, double *vectors, Solver *solver, bool located, double span);

/* Just after it, where the solver begins anew: note which indicators it turned. */
void turned_after(Turned *turned, double *vectors, Solver *solver);

/* Whether an indicator under watch went on across, at the end of a step. */
bool turned_went_through(const Turned *turned, const double *vectors, Solver *solver);

#endif
