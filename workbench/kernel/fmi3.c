/* fmi3.c: what FMI 3.0 does in its own way. Booleans are bool; getters and setters take a number of values. */
#include <math.h>

#include "component.h"

typedef int (*CompletedStep)(void *, bool, bool *, bool *);
typedef int (*UpdateDiscreteStates)(void *, bool *, bool *, bool *, bool *, bool *, double *);
typedef int (*DoStep)(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int (*Directional)(void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, size_t, double *,
                           size_t);

static int completed_step(const Component *component, Answer *answer) {
    const Function function = component->functions[COMPLETED_STEP];
    answer->event = answer->terminate = false;
    const bool never_back = component_never_back(component);
    return function ? ((CompletedStep)function)(component->handle, never_back, &answer->event, &answer->terminate)
                    : NOT_EXPORTED;
}

static int update_discrete_states(const Component *component, Answer *answer) {
    bool nominals_changed = false;
    bool timed = false;
    double next_time = (double)INFINITY;
    const Function function = component->functions[UPDATE_DISCRETE_STATES];
    *answer = (Answer){0};
    const int status =
        function ? ((UpdateDiscreteStates)function)(component->handle, &answer->again, &answer->terminate,
                                                    &nominals_changed, &answer->states_changed, &timed, &next_time)
                 : NOT_EXPORTED;
    answer->time = timed ? next_time : (double)INFINITY;
    return status;
}

static int do_step(const Component *component, double time, double step, Answer *answer) {
    bool early = false;
    double reached = time + step;
    const Function function = component->functions[DO_STEP];
    const bool never_back = component_never_back(component);
    *answer = (Answer){0};
    const int status = function ? ((DoStep)function)(component->handle, time + component->clock, step, never_back,
                                                     &answer->event, &answer->terminate, &early, &reached)
                                : NOT_EXPORTED;
    answer->time = early ? reached - component->clock : time + step;
    return status;
}

static int directional(const Component *component, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                       const double *seed, size_t n_knowns, double *sensitivity) {
    const Function function = component->functions[GET_DIRECTIONAL];
    return function ? ((Directional)function)(component->handle, unknowns, n_unknowns, knowns, n_knowns, seed,
                                              n_knowns, sensitivity, n_unknowns)
                    : NOT_EXPORTED;
}

const ComponentCalls calls_fmi3 = {
    .completed_step = completed_step,
    .update_discrete_states = update_discrete_states,
    .do_step = do_step,
    .directional = directional,
    .modes = true,
    .sized = true,
};
