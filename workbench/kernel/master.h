/* master.h: systems with co-simulation components: one communication step of all, event iterations between steps.
 *
 * The twin of tests/oracle/master. The caller owns all memory a Master points to; what outlives a run, `slopes` and
 * what stands on the connections, it saves and restores.
 */
#ifndef WORKBENCH_KERNEL_MASTER_H
#define WORKBENCH_KERNEL_MASTER_H

#include "cs.h"
#include "me.h"

/* What is stepped as one: a co-simulation component, or model exchange components that are one equation. Its inputs
 * that are connected or forced are linear over a step. */
typedef struct {
    int32_t component; /* of co-simulation, else -1 */
    int32_t held;      /* sampled: its outputs stand still over a step */
    int32_t as_start;  /* its inputs count at the start of a step */
    int32_t stale;     /* a group whose solver has to begin anew */
    /* Inputs, arrays [n]. */
    const size_t *sources; /* number of a connection, or that of all connections + place of a forced input */
    const int32_t *types;  /* ValueType */
    const int32_t *moving; /* may change between events */
    double *starts, *ends; /* right limit at the start of the step, left limit at its end (NaN before the first) */
    double *bows;          /* mean over the step less that of the straight line; order 2 only */
    double *values, *rates; /* scratch */
    const int32_t *orders; /* ones */
    size_t n;
    Access inlet; /* columns 0 … n-1 */
    Access fast;  /* those that are moving */
    /* Outputs that other units see. */
    const size_t *outgoing; /* [n_outgoing] numbers of connections */
    double *raw;            /* [n_outgoing] scratch */
    size_t n_outgoing;
    Access outlet; /* columns 0 … n_outgoing-1 */
    const Instants *instants; /* [n_instants] that are known beforehand */
    size_t n_instants;
    /* A group; components [n_members] of the master's system. The signals are those of its forcing. */
    const size_t *members;
    size_t n_members;
    Me *me;
    Signal *signals; /* [n] */
    double *times;   /* [2] of the tables, begin and end of the step [s] */
    double *tables;  /* [n][2] */
} Unit;

struct Control;

typedef struct Master {
    Unit *units;
    size_t n_units;
    const size_t *order;  /* [n_units] stage after stage; the units of a stage do not see what the others reach */
    const size_t *stages; /* [n_stages] where each ends in `order` */
    size_t n_stages;
    /* Connections, arrays [system->wires.n]. */
    const int32_t *from_held; /* their source is of a held unit */
    int32_t *late;            /* a new value was shown after the step only, when the destination had ticked already */
    const int32_t *moves;     /* their source may change between events */
    int32_t *known;           /* what they reach at the end of the step is known: `reached` */
    double *start, *reached;
    double *slopes; /* [2][n] how they changed in the last step, and in that before [1/s] */
    double *spans;  /* [2] the lengths of these steps, 0: there was none [s] */
    /* Forced inputs, arrays [forcing->n]: linear from `since` on [s]. */
    double *ramps; /* [1/s] */
    double *bows;  /* see Unit */
    double *ramped; /* scratch */
    double since;
    Record *nobody; /* keeps nothing */
    struct Control *control; /* of the step; NULL: it is what the caller says */
    int32_t hold_inputs;
    int32_t extrapolation; /* order of the polynomial by which what is not known yet goes on: 0, 1, 2 */
    int32_t event_due; /* the last step waits for its event iteration */
} Master;

/* Set the right limits and let all components iterate, if that is due. */
bool master_set_inputs(Cs *cs, bool jump);
/* See `cs_announce`; the outputs that connections need were read, too. Forced inputs go on for `ramped` [s] as before. */
bool master_announce(Cs *cs, double ramped);
/* Look where forced inputs go until `end`; fills `seen` of the forcing. */
void master_look_ahead(Cs *cs, double end);
/* Step all units to `end`; a unit that stops at an event of its own is followed by an event iteration of all. */
bool master_step_to(Cs *cs, double end);
/* Gather what is known to happen after now. */
void master_gather(const Cs *cs, Gathered *next);

#endif
