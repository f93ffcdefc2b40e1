/* intermediate.h: inputs for a co-simulation FMU of FMI 3.0 that asks for them between communication points.
 *
 * The FMU calls back inside `fmi3DoStep`, in the thread of the step, with the environment that it was instantiated with.
 */
#ifndef WORKBENCH_KERNEL_INTERMEDIATE_H
#define WORKBENCH_KERNEL_INTERMEDIATE_H

#include "parent.h"
#include "system.h"

typedef struct Intermediate {
    System *system;   /* that is being stepped; NULL: nobody answers */
    int32_t who;      /* number of the component in it */
    int32_t answers;  /* whether all its forced inputs may be set */
    int32_t answered; /* in this step */
} Intermediate;

/* The FMU's components can call back from now on; before the first step of a run. */
void intermediate_begin(System *system);
/* Before a step from `t` to `end`. */
void intermediate_step(System *system, double t, double end);
/* After it: what the FMUs that asked saw just before the end goes to `seen`. */
void intermediate_seen(System *system, double t, double end);

/* fmi3IntermediateUpdateCallback. */
KERNEL_EXPORT void kernel_intermediate_update(void *environment, double time, bool set_requested, bool get_allowed,
                                              bool finished, bool can_return, bool *return_requested,
                                              double *return_time);

#endif
