/* clocks.h: the clocks of one FMU of FMI 3.0 that the importer lets tick; the twin of workbench/fmi/ticking.py. */
#ifndef WORKBENCH_KERNEL_CLOCKS_H
#define WORKBENCH_KERNEL_CLOCKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* PERIODIC: known for good; APERIODIC: the FMU is asked for each next tick; TUNABLE: periodic, and asked. */
enum { PERIODIC, APERIODIC, TUNABLE };

typedef struct {
    double next;     /* time of the next tick [s]; infinite: not known, or none */
    double first;    /* time from which periods are counted [s] */
    double interval; /* of a periodic clock [s] */
    double count;    /* ticks since `first` */
    uint32_t reference;
    int32_t kind;
    int32_t ticked; /* in this event, and the FMU has not been asked since */
} Tick;

/* `ticks` and room for what the FMU is told and asked, `n` entries each; the caller owns the memory. */
typedef struct {
    Tick *ticks;
    size_t n;
    uint32_t *references;
    bool *active;
    double *intervals;
    int32_t *qualifiers;
} Clocks;

/* The time of the next tick of any [s]; infinite where `clocks` is NULL. */
double clocks_next(const Clocks *clocks);
/* Note what ticks at `time`; the first so many of `references` and `active` are for the FMU. */
size_t clocks_due(Clocks *clocks, double time);
/* Note which clocks the FMU has to be asked about: the first so many of `references`. */
size_t clocks_asked(Clocks *clocks);
/* Take the answers, in `intervals` and `qualifiers`; false: one is no interval. */
bool clocks_answered(Clocks *clocks, double time);

#endif
