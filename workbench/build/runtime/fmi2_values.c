/* fmi2_values.c: FMI 2.0.4, values of variables and partial derivatives. */
#include "fmi2_calls.h"

#include <limits.h>

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    Instance *instance = fmi2_enter(c, CALL2_GET_REAL);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = access_settle(instance);
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_read(instance, vr[i], TYPE_REAL, &value[i]);
    }
    return (fmi2Status)status;
}

static Status read_integer(Instance *instance, fmi2ValueReference reference, fmi2Integer *value)
{
    double number = 0.0;
    Status status = access_read(instance, reference, TYPE_INTEGER, &number);
    if (status == STATUS_OK && !(number >= (double)INT_MIN && number <= (double)INT_MAX)) {
        return instance_fail(instance, "variable '%s': %.17g is no Integer", model_info.names[reference], number);
    }
    *value = status == STATUS_OK ? (fmi2Integer)number : 0;
    return status;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    Instance *instance = fmi2_enter(c, CALL2_GET_INTEGER);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = access_settle(instance);
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = read_integer(instance, vr[i], &value[i]);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    Instance *instance = fmi2_enter(c, CALL2_GET_BOOLEAN);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = access_settle(instance);
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        double number = 0.0;
        status = access_read(instance, vr[i], TYPE_BOOLEAN, &number);
        value[i] = number != 0.0 ? fmi2True : fmi2False;
    }
    return (fmi2Status)status;
}

static fmi2Status no_string(Instance *instance, size_t nvr)
{
    return nvr == 0 ? fmi2OK : (fmi2Status)instance_fail(instance, "the model has no String variables");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    Instance *instance = fmi2_enter(c, CALL2_GET_STRING);
    (void)vr;
    (void)value;
    return instance == NULL ? fmi2Error : no_string(instance, nvr);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_REAL);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_write(instance, vr[i], TYPE_REAL, value[i]);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_INTEGER);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_write(instance, vr[i], TYPE_INTEGER, (double)value[i]);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_BOOLEAN);
    if (instance == NULL || fmi2_missing(instance, nvr, vr, value)) {
        return fmi2Error;
    }
    Status status = STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nvr; i++) {
        status = access_write(instance, vr[i], TYPE_BOOLEAN, value[i] != fmi2False ? 1.0 : 0.0);
    }
    return (fmi2Status)status;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_STRING);
    (void)vr;
    (void)value;
    return instance == NULL ? fmi2Error : no_string(instance, nvr);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    Instance *instance = fmi2_enter(c, CALL2_DIRECTIONAL_DERIVATIVE);
    if (instance == NULL || fmi2_missing(instance, nUnknown, vUnknown_ref, dvUnknown)
        || fmi2_missing(instance, nKnown, vKnown_ref, dvKnown)) {
        return fmi2Error;
    }
    Status status = access_settle(instance);
    return (fmi2Status)(status != STATUS_OK ? status
                                            : access_directional(instance, vUnknown_ref, nUnknown, vKnown_ref, nKnown,
                                                                 dvKnown, dvUnknown));
}
