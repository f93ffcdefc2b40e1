/* fmi3_me.c: FMI 3.0.2 for Model Exchange. */
#include "fmi3_calls.h"

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_ENTER_CONTINUOUS);
    return self == NULL ? fmi3Error : (fmi3Status)instance_leave_event(self, STATE_CONTINUOUS);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    Instance *self = fmi3_enter(instance, CALL3_COMPLETED_STEP);
    (void)noSetFMUStatePriorToCurrentPoint; /* a saved state has the past of delays in it */
    if (self == NULL || instance_missing(self, enterEventMode, "enterEventMode")
        || instance_missing(self, terminateSimulation, "terminateSimulation")) {
        return fmi3Error;
    }
    *terminateSimulation = fmi3False;
    bool good = core_completed_step(self->core);
    *enterEventMode = core_wants_event(self->core);
    return good ? fmi3OK : (fmi3Status)instance_fail(self, "the step cannot be completed");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    Instance *self = fmi3_enter(instance, CALL3_SET_TIME);
    return self == NULL ? fmi3Error : (fmi3Status)access_set_time(self, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
    Instance *self = fmi3_enter(instance, CALL3_SET_STATES);
    return self == NULL ? fmi3Error : (fmi3Status)access_set_states(self, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_DERIVATIVES);
    return self == NULL ? fmi3Error : (fmi3Status)access_derivatives(self, derivatives, nContinuousStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_INDICATORS);
    return self == NULL ? fmi3Error : (fmi3Status)access_indicators(self, eventIndicators, nEventIndicators);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_STATES);
    return self == NULL ? fmi3Error : (fmi3Status)access_states(self, continuousStates, nContinuousStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_NOMINALS);
    return self == NULL ? fmi3Error : (fmi3Status)access_nominals(self, nominals, nContinuousStates);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    Instance *self = fmi3_enter(instance, CALL3_NUMBER_OF_INDICATORS);
    if (self == NULL || instance_missing(self, nEventIndicators, "nEventIndicators")) {
        return fmi3Error;
    }
    *nEventIndicators = model_info.n_indicators;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    Instance *self = fmi3_enter(instance, CALL3_NUMBER_OF_STATES);
    if (self == NULL || instance_missing(self, nContinuousStates, "nContinuousStates")) {
        return fmi3Error;
    }
    *nContinuousStates = model_info.n_states;
    return fmi3OK;
}
