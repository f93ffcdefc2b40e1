/* fmi1.c: what FMI 1.0 does in its own way. It has no modes; Booleans are single bytes. */
#include <math.h>

#include "component.h"

typedef struct {
    char converged, references_changed, states_changed, terminate, timed;
    double next_time;
} EventInfo;

typedef int (*CompletedStep)(void *, char *);
typedef int (*EventUpdate)(void *, char, EventInfo *);
typedef int (*DoStep)(void *, double, double, char);

static int completed_step(const Component *component, Answer *answer) {
    char event = 0;
    const Function function = component->functions[COMPLETED_STEP];
    const int status = function ? ((CompletedStep)function)(component->handle, &event) : NOT_EXPORTED;
    answer->event = event != 0;
    answer->terminate = false;
    return status;
}

static int update_discrete_states(const Component *component, Answer *answer) {
    EventInfo info = {0};
    const Function function = component->functions[UPDATE_DISCRETE_STATES];
    const int status = function ? ((EventUpdate)function)(component->handle, 0, &info) : NOT_EXPORTED;
    answer->again = info.converged == 0;
    answer->terminate = info.terminate != 0;
    answer->states_changed = info.states_changed != 0;
    answer->time = info.timed ? info.next_time : (double)INFINITY;
    return status;
}

static int do_step(const Component *component, double time, double step, Answer *answer) {
    const Function function = component->functions[DO_STEP];
    *answer = (Answer){.time = time + step};
    return function ? ((DoStep)function)(component->handle, time + component->clock, step, 1) : NOT_EXPORTED;
}

const ComponentCalls calls_fmi1 = {
    .completed_step = completed_step,
    .update_discrete_states = update_discrete_states,
    .do_step = do_step,
};
