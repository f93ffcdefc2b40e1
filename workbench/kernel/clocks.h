/* clocks.h: the clocks of one FMU of FMI 3.0: those that the importer lets tick, those whose ticks the FMU tells, and how
 * often each has ticked. The twin of workbench/fmi/ticking.py.
 */
#ifndef WORKBENCH_KERNEL_CLOCKS_H
#define WORKBENCH_KERNEL_CLOCKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "instants.h"

/* PERIODIC: known for good; APERIODIC: the FMU is asked for each next tick; TUNABLE: periodic, and asked. */
enum { PERIODIC, APERIODIC, TUNABLE };

typedef struct {
    double next;     /* time of the next tick [s]; infinite: not known, or none */
    Instants instants; /* of a periodic clock */
    double count;      /* of these, so far */
    uint32_t reference;
    int32_t kind;
    int32_t ticked; /* in this event, and the FMU has not been asked since */
    int32_t place;  /* in `counts` */
} Tick;

/* The caller owns the memory. What the FMU is told and asked has room for `n` and for `n_told` entries. */
typedef struct {
    Tick *ticks; /* [n] that the importer lets tick */
    size_t n;
    const uint32_t *told; /* [n_told] that the FMU lets tick */
    const int32_t *places; /* [n_told] in `counts` */
    size_t n_told;
    double *counts; /* ticks of each clock so far */
    uint32_t *references;
    bool *active;
    double *intervals;
    int32_t *qualifiers;
} Clocks;

/* The time of the next tick of any [s]; infinite where `clocks` is NULL. */
double clocks_next(const Clocks *clocks);
/* Note what ticks at `time`, rounding allowed for; the first so many of `references` and `active` are for the FMU. */
size_t clocks_due(Clocks *clocks, double time);
/* Count what the FMU says has ticked: `active`, of those `told`. */
void clocks_told(Clocks *clocks);
/* Note which clocks the FMU has to be asked about: the first so many of `references`. */
size_t clocks_asked(Clocks *clocks);
/* Take the answers, in `intervals` and `qualifiers`; false: one is no interval. */
bool clocks_answered(Clocks *clocks, double time);

#endif
