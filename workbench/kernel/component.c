#include "component.h"

#include <math.h>

typedef int (*SetTime)(void *, double);
typedef int (*Vector)(void *, double *, size_t);
typedef int (*Enter)(void *);
typedef int (*SaveOrFree)(void *, void **);
typedef int (*Restore)(void *, void *);
typedef int (*SetClock)(void *, const uint32_t *, size_t, const bool *);
typedef int (*GetClock)(void *, const uint32_t *, size_t, bool *);
typedef int (*GetInterval)(void *, const uint32_t *, size_t, double *, int32_t *);

static const char *const NAMES[N_FUNCTIONS] = {
    [SET_TIME] = "set_time",
    [SET_STATES] = "set_states",
    [GET_STATES] = "get_states",
    [GET_DERIVATIVES] = "get_derivatives",
    [GET_INDICATORS] = "get_indicators",
    [COMPLETED_STEP] = "completed_step",
    [ENTER_EVENT_MODE] = "enter_event_mode",
    [ENTER_CONTINUOUS_MODE] = "enter_continuous_mode",
    [ENTER_STEP_MODE] = "enter_step_mode",
    [UPDATE_DISCRETE_STATES] = "update_discrete_states",
    [DO_STEP] = "do_step",
    [SET_SLOPES] = "set_slopes",
    [GET_DIRECTIONAL] = "get_directional",
    [GET_FMU_STATE] = "get_fmu_state",
    [SET_FMU_STATE] = "set_fmu_state",
    [FREE_FMU_STATE] = "free_fmu_state",
    [SET_CLOCK] = "set_clock",
    [GET_INTERVAL] = "get_interval",
    [GET_CLOCK] = "get_clock",
};

const char *function_name(size_t index) {
    return index < N_FUNCTIONS ? NAMES[index] : NULL;
}

const ComponentCalls *component_calls(int32_t version) {
    static const ComponentCalls *const tables[] = {NULL, &calls_fmi1, &calls_fmi2, &calls_fmi3};
    return version >= 1 && version <= 3 ? tables[version] : NULL;
}

bool component_checked(const Component *component, FunctionIndex function, int status, int32_t who, Failure *failure) {
    if (status >= 0 && status <= FMI_WARNING) {
        return true;
    }
    if (failure->code == NO_FAILURE) {
        failure->status = status;
        failure->component = who;
        failure->function = (int32_t)function;
        failure->name = component->names[function];
    }
    /* Not by the status: an FMU may return any number. */
    return fail_at(failure, component->functions[function] ? FAILED_STATUS : FAILED_MISSING, component->time);
}

bool component_set_time(Component *component, double time, int32_t who, Failure *failure) {
    const Function function = component->functions[SET_TIME];
    component->time = time;
    const int status = function ? ((SetTime)function)(component->handle, time) : NOT_EXPORTED;
    return component_checked(component, SET_TIME, status, who, failure);
}

bool component_states(const Component *component, FunctionIndex function, double *values, size_t n, int32_t who,
                      Failure *failure) {
    if (n == 0) {
        return true;
    }
    const Function address = component->functions[function];
    const int status = address ? ((Vector)address)(component->handle, values, n) : NOT_EXPORTED;
    return component_checked(component, function, status, who, failure);
}

bool component_never_back(const Component *component) {
    return !component->saved || *component->saved == 0;
}

/* What is got is one more that may be gone back to; what is freed is one less. */
static void count(const Component *component, FunctionIndex function) {
    if (component->saved && function != SET_FMU_STATE) {
        *component->saved += function == GET_FMU_STATE ? 1 : -1;
    }
}

bool component_saved(const Component *component, FunctionIndex function, void **state, int32_t who, Failure *failure) {
    const Function address = component->functions[function];
    int status = NOT_EXPORTED;
    if (function == FREE_FMU_STATE && !*state) {
        return true;
    }
    if (address) {
        status = function == SET_FMU_STATE ? ((Restore)address)(component->handle, *state)
                                           : ((SaveOrFree)address)(component->handle, state);
    }
    if (!component_checked(component, function, status, who, failure)) {
        return false;
    }
    count(component, function);
    return true;
}

/* Let the clocks tick that are due. */
static bool tick(const Component *component, int32_t who, Failure *failure) {
    Clocks *clocks = component->clocks;
    const size_t n = clocks_due(clocks, component->time);
    const Function function = component->functions[SET_CLOCK];
    if (n == 0) {
        return true;
    }
    const int status =
        function ? ((SetClock)function)(component->handle, clocks->references, n, clocks->active) : NOT_EXPORTED;
    return component_checked(component, SET_CLOCK, status, who, failure);
}

/* Count the clocks that the FMU lets tick: evaluating the event ends their ticks. */
static bool listen(const Component *component, int32_t who, Failure *failure) {
    Clocks *clocks = component->clocks;
    const Function function = component->functions[GET_CLOCK];
    if (clocks->n_told == 0) {
        return true;
    }
    const int status = function ? ((GetClock)function)(component->handle, clocks->told, clocks->n_told, clocks->active)
                                : NOT_EXPORTED;
    if (!component_checked(component, GET_CLOCK, status, who, failure)) {
        return false;
    }
    clocks_told(clocks);
    return true;
}

/* Ask when the clocks tick next of which the FMU alone knows it. */
static bool ask(const Component *component, int32_t who, Failure *failure) {
    Clocks *clocks = component->clocks;
    const size_t n = clocks_asked(clocks);
    const Function function = component->functions[GET_INTERVAL];
    if (n == 0) {
        return true;
    }
    const int status = function ? ((GetInterval)function)(component->handle, clocks->references, n, clocks->intervals,
                                                          clocks->qualifiers)
                                : NOT_EXPORTED;
    if (!component_checked(component, GET_INTERVAL, status, who, failure)) {
        return false;
    }
    return clocks_answered(clocks, component->time) || fail_of(failure, FAILED_INTERVAL, component->time, who);
}

bool component_enter(const Component *component, FunctionIndex mode, int32_t who, Failure *failure) {
    if (!component->calls->modes) {
        return true;
    }
    const Function function = component->functions[mode];
    const int status = function ? ((Enter)function)(component->handle) : NOT_EXPORTED;
    return component_checked(component, mode, status, who, failure) &&
           (mode != ENTER_EVENT_MODE || !component->clocks || tick(component, who, failure));
}

bool component_update(Component *component, Answer *answer, int32_t who, Failure *failure) {
    if (component->clocks && !listen(component, who, failure)) {
        return false;
    }
    const int status = component->calls->update_discrete_states(component, answer);
    if (!component_checked(component, UPDATE_DISCRETE_STATES, status, who, failure) ||
        (component->clocks && !ask(component, who, failure))) {
        return false;
    }
    if (isnan(answer->time)) {
        return fail_of(failure, FAILED_EVENT_TIME, component->time, who);
    }
    answer->time = fmin(answer->time, clocks_next(component->clocks));
    return true;
}

bool component_settle(Component *component, int32_t who, Failure *failure) {
    for (int round = 0; round < MAX_EVENT_ITERATIONS; round++) {
        Answer answer = {0};
        if (!component_update(component, &answer, who, failure)) {
            return false;
        }
        if (answer.terminate) {
            return fail_of(failure, FAILED_ENDED, component->time, who);
        }
        if (!answer.again) {
            return component_enter(component, ENTER_STEP_MODE, who, failure);
        }
    }
    return fail_of(failure, FAILED_ITERATION, component->time, who);
}
