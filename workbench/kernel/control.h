/* control.h: the communication step of a master, controlled by step doubling: each step once, and again in two halves.
 *
 * Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.4. Not for
 * components whose state cannot be saved, nor where a constant step is needed. The twin of tests/oracle/master/control.py.
 */
#ifndef WORKBENCH_KERNEL_CONTROL_H
#define WORKBENCH_KERNEL_CONTROL_H

#include "master.h"

typedef struct Control {
    double tolerance; /* of one step, relative to the largest magnitude that each value has had */
    double step;      /* to be tried next [s] */
    double least;     /* shorter ones are taken as they are [s] */
    double longest;   /* of the steps that were kept, two of which were tried as one [s] */
    /* What is watched: left limits of connected values, then of outputs. Arrays [n_wires + n_outputs]. */
    const size_t *wires; /* [n_wires] numbers of connections */
    size_t n_wires;
    Access outputs; /* columns 0 … n_outputs-1 */
    size_t n_outputs;
    double *scale; /* those magnitudes, at first the least that count */
    double *coarse, *fine;
    /* Room for what a step has to go back to: see `control_doubles`. */
    double *saved;
    void **states; /* [n_components] */
    Record trial;  /* rows of the step that is being tried */
} Control;

/* How many doubles `saved` needs. */
size_t control_doubles(const Cs *cs);
/* Read what is watched, to `fine`. */
bool control_watch(Cs *cs);
/* Make one step towards the target, or find that it has to be shorter. */
bool control_step(Cs *cs);

#endif
