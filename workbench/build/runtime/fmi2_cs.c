/* fmi2_cs.c: FMI 2.0.4 for Co-Simulation.
 *
 * doStep is synchronous. fmi2Discard means that the model asked for the end inside the step
 * (fmi2Terminated, fmi2LastSuccessfulTime tell so); a failed integration is fmi2Error.
 */
#include "fmi2_calls.h"

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_INPUT_DERIVATIVES);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)
        || (nvr > 0 && instance_missing(instance, order, "order"))) {
        return fmi2Error;
    }
    Status status = STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_input_derivative(instance, vr[i], order[i], value[i]);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[])
{
    Instance *instance = fmi2_enter(c, CALL2_GET_OUTPUT_DERIVATIVES);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)
        || (nvr > 0 && instance_missing(instance, order, "order"))) {
        return fmi2Error;
    }
    Status status = access_settle(instance);
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_output_derivative(instance, vr[i], order[i], &value[i]);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    Instance *instance = fmi2_enter(c, CALL2_DO_STEP);
    (void)noSetFMUStatePriorToCurrentPoint; /* no buffer to flush */
    if (instance == NULL) {
        return fmi2Error;
    }
    StepReport report;
    Status status = communicate(instance, currentCommunicationPoint, communicationStepSize, &report);
    if (status == STATUS_OK && report.terminate) {
        instance_log(instance, CATEGORY_DISCARD, "the model ends the simulation at t = %.17g",
                     instance->record.last_successful_time);
        instance_set_state(instance, STATE_STEP_FAILED);
        return fmi2Discard;
    }
    return (fmi2Status)status;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    fmi2_enter(c, CALL2_CANCEL_STEP);
    return fmi2Error;
}

/* There is no status to report for this kind. */
static fmi2Status unknown_status(Instance *instance)
{
    instance_log(instance, CATEGORY_DISCARD, "this status is not provided, doStep is synchronous");
    return fmi2Discard;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_STATUS);
    if (instance == NULL || instance_missing(instance, value, "value")) {
        return fmi2Error;
    }
    if (s != fmi2DoStepStatus) {
        return unknown_status(instance);
    }
    *value = instance_state(instance) == STATE_STEP_FAILED ? fmi2Discard : fmi2OK;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_REAL_STATUS);
    if (instance == NULL || instance_missing(instance, value, "value")) {
        return fmi2Error;
    }
    if (s != fmi2LastSuccessfulTime) {
        return unknown_status(instance);
    }
    *value = instance->record.last_successful_time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_INTEGER_STATUS);
    (void)s;
    (void)value;
    return instance == NULL ? fmi2Error : unknown_status(instance);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_BOOLEAN_STATUS);
    if (instance == NULL || instance_missing(instance, value, "value")) {
        return fmi2Error;
    }
    if (s != fmi2Terminated) {
        return unknown_status(instance);
    }
    *value = instance->record.terminate != 0.0 ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_STRING_STATUS);
    (void)s;
    (void)value;
    return instance == NULL ? fmi2Error : unknown_status(instance);
}
