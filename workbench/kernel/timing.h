/* timing.h: how long steps of co-simulation take, as a master in C sees it. */
#ifndef WORKBENCH_KERNEL_TIMING_H
#define WORKBENCH_KERNEL_TIMING_H

#include "system.h"

/* Step the first component `n` times from `time` on, and put how long each doStep took into `seconds`; events between
 * steps are handled, and are not in them. Return how many were made: one that fails, ends early or asks to end is the
 * last, and no further one begins `patience` after the first. */
size_t time_steps(System *system, double time, double step, size_t n, double patience, double *seconds);

#endif
