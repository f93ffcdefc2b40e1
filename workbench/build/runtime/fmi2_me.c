/* fmi2_me.c: FMI 2.0.4 for Model Exchange. */
#include "fmi2_calls.h"

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_ENTER_EVENT_MODE);
    return instance == NULL ? fmi2Error : (fmi2Status)instance_enter_event(instance);
}

static void report_event(const CoreEventInfo *info, fmi2EventInfo *report)
{
    report->newDiscreteStatesNeeded = info->discrete_states_need_update ? fmi2True : fmi2False;
    report->terminateSimulation = info->terminate ? fmi2True : fmi2False;
    report->nominalsOfContinuousStatesChanged = info->nominals_changed ? fmi2True : fmi2False;
    report->valuesOfContinuousStatesChanged = info->continuous_states_changed ? fmi2True : fmi2False;
    report->nextEventTimeDefined = info->next_event_time_defined ? fmi2True : fmi2False;
    report->nextEventTime = info->next_event_time_defined ? info->next_event_time : 0.0;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    Instance *instance = fmi2_enter(c, CALL2_NEW_DISCRETE_STATES);
    if (instance == NULL || instance_missing(instance, fmi2eventInfo, "eventInfo")) {
        return fmi2Error;
    }
    CoreEventInfo info;
    Status status = instance_new_discrete_states(instance, &info);
    report_event(&info, fmi2eventInfo);
    return (fmi2Status)status;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_ENTER_CONTINUOUS);
    return instance == NULL ? fmi2Error : (fmi2Status)instance_leave_event(instance, STATE_CONTINUOUS);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    Instance *instance = fmi2_enter(c, CALL2_COMPLETED_STEP);
    (void)noSetFMUStatePriorToCurrentPoint; /* a saved state has the past of delays in it */
    if (instance == NULL || instance_missing(instance, enterEventMode, "enterEventMode")
        || instance_missing(instance, terminateSimulation, "terminateSimulation")) {
        return fmi2Error;
    }
    bool good = core_completed_step(instance->core);
    *enterEventMode = core_wants_event(instance->core) ? fmi2True : fmi2False;
    *terminateSimulation = fmi2False;
    return good ? fmi2OK : (fmi2Status)instance_fail(instance, "the step cannot be completed");
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    Instance *instance = fmi2_enter(c, CALL2_SET_TIME);
    return instance == NULL ? fmi2Error : (fmi2Status)access_set_time(instance, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    Instance *instance = fmi2_enter(c, CALL2_SET_STATES);
    return instance == NULL ? fmi2Error : (fmi2Status)access_set_states(instance, x, nx);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_DERIVATIVES);
    return instance == NULL ? fmi2Error : (fmi2Status)access_derivatives(instance, derivatives, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_INDICATORS);
    return instance == NULL ? fmi2Error : (fmi2Status)access_indicators(instance, eventIndicators, ni);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_STATES);
    return instance == NULL ? fmi2Error : (fmi2Status)access_states(instance, x, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_NOMINALS);
    return instance == NULL ? fmi2Error : (fmi2Status)access_nominals(instance, x_nominal, nx);
}
