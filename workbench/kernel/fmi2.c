/* fmi2.c: what FMI 2.0 does in its own way. Booleans are int. */
#include <math.h>

#include "component.h"

typedef struct {
    int again, terminate, nominals_changed, states_changed, timed;
    double next_time;
} EventInfo;

typedef int (*CompletedStep)(void *, int, int *, int *);
typedef int (*NewDiscreteStates)(void *, EventInfo *);
typedef int (*DoStep)(void *, double, double, int);
typedef int (*SetSlopes)(void *, const uint32_t *, size_t, const int32_t *, const double *);
typedef int (*Directional)(void *, const uint32_t *, size_t, const uint32_t *, size_t, const double *, double *);

static int completed_step(const Component *component, Answer *answer) {
    int event = 0;
    int terminate = 0;
    const Function function = component->functions[COMPLETED_STEP];
    const int never_back = component_never_back(component);
    const int status = function ? ((CompletedStep)function)(component->handle, never_back, &event, &terminate)
                                : NOT_EXPORTED;
    answer->event = event != 0;
    answer->terminate = terminate != 0;
    return status;
}

static int update_discrete_states(const Component *component, Answer *answer) {
    EventInfo info = {0};
    const Function function = component->functions[UPDATE_DISCRETE_STATES];
    const int status = function ? ((NewDiscreteStates)function)(component->handle, &info) : NOT_EXPORTED;
    answer->again = info.again != 0;
    answer->terminate = info.terminate != 0;
    answer->states_changed = info.states_changed != 0;
    answer->time = info.timed ? info.next_time : (double)INFINITY;
    return status;
}

static int do_step(const Component *component, double time, double step, Answer *answer) {
    const Function function = component->functions[DO_STEP];
    *answer = (Answer){.time = time + step};
    const int never_back = component_never_back(component);
    return function ? ((DoStep)function)(component->handle, time + component->clock, step, never_back) : NOT_EXPORTED;
}

static int set_slopes(const Component *component, const uint32_t *references, size_t n, const int32_t *orders,
                      const double *slopes) {
    const Function function = component->functions[SET_SLOPES];
    return function ? ((SetSlopes)function)(component->handle, references, n, orders, slopes) : NOT_EXPORTED;
}

static int directional(const Component *component, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                       const double *seed, size_t n_knowns, double *sensitivity) {
    const Function function = component->functions[GET_DIRECTIONAL];
    return function ? ((Directional)function)(component->handle, unknowns, n_unknowns, knowns, n_knowns, seed,
                                              sensitivity)
                    : NOT_EXPORTED;
}

const ComponentCalls calls_fmi2 = {
    .completed_step = completed_step,
    .update_discrete_states = update_discrete_states,
    .do_step = do_step,
    .set_slopes = set_slopes,
    .directional = directional,
    .modes = true,
};
