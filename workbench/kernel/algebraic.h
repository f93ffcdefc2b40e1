/* algebraic.h: values that depend on each other without delay. */
#ifndef WORKBENCH_KERNEL_ALGEBRAIC_H
#define WORKBENCH_KERNEL_ALGEBRAIC_H

#include "system.h"

/* Where in `Link.work` the values stand with which the last solution began, in vectors of n. */
enum { LOOP_START = 6 };

/* Doubles that `Link.work` needs for a loop of n. */
size_t loop_doubles(size_t n);

/* Find values at which every destination sees what its source answers, and leave the components there. `time` is
 * where the components stand [s]. */
bool loop_solve(System *system, Link *link, double time);

#endif
