#include "component.h"

typedef int (*SetTime)(void *, double);
typedef int (*Vector)(void *, double *, size_t);
typedef int (*Enter)(void *);
typedef int (*SaveOrFree)(void *, void **);
typedef int (*Restore)(void *, void *);

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
    return component_checked(component, function, status, who, failure);
}

bool component_enter(const Component *component, FunctionIndex mode, int32_t who, Failure *failure) {
    if (!component->calls->modes) {
        return true;
    }
    const Function function = component->functions[mode];
    const int status = function ? ((Enter)function)(component->handle) : NOT_EXPORTED;
    return component_checked(component, mode, status, who, failure);
}
