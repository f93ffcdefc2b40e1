/* fmi3_cs.c: FMI 3.0.2 for Co-Simulation.
 *
 * With eventModeUsed and earlyReturnAllowed doStep returns at the first event inside the step; else
 * events inside are handled there. An event at the end of the step is the environment's when
 * eventModeUsed (eventHandlingNeeded), else it belongs to the next step.
 */
#include "fmi3_calls.h"

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_ENTER_STEP_MODE);
    return self == NULL ? fmi3Error : (fmi3Status)instance_leave_event(self, STATE_STEP);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t nValues)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_OUTPUT_DERIVATIVES);
    if (self == NULL) {
        return fmi3Error;
    }
    if (nValueReferences != nValues) {
        return (fmi3Status)instance_fail(self, "%zu value references but %zu values", nValueReferences, nValues);
    }
    if (nValues > 0
        && (instance_missing(self, valueReferences, "valueReferences") || instance_missing(self, orders, "orders")
            || instance_missing(self, values, "values"))) {
        return fmi3Error;
    }
    Status status = access_settle(self);
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_output_derivative(self, valueReferences[i], orders[i], &values[i]);
    }
    return (fmi3Status)status;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    Instance *self = fmi3_enter(instance, CALL3_DO_STEP);
    (void)noSetFMUStatePriorToCurrentPoint; /* no buffer to flush */
    if (self == NULL || instance_missing(self, eventHandlingNeeded, "eventHandlingNeeded")
        || instance_missing(self, terminateSimulation, "terminateSimulation")
        || instance_missing(self, earlyReturn, "earlyReturn")
        || instance_missing(self, lastSuccessfulTime, "lastSuccessfulTime")) {
        return fmi3Error;
    }
    StepReport report;
    Status status = communicate(self, currentCommunicationPoint, communicationStepSize, &report);
    *eventHandlingNeeded = report.event_handling_needed;
    *terminateSimulation = report.terminate;
    *earlyReturn = report.early_return;
    *lastSuccessfulTime = self->record.last_successful_time;
    return (fmi3Status)status;
}
