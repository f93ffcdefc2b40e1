/* fmi3_values.c: FMI 3.0.2, values of variables and partial derivatives.
 *
 * All variables are scalars, so that there is one value for each value reference. Reals are Float64,
 * Integers Int32, enumerations Int64.
 */
#include "fmi3_calls.h"

static bool arrays_good(Instance *self, size_t n, size_t n_values, const void *references, const void *values)
{
    if (n != n_values) {
        instance_fail(self, "%zu value references but %zu values; all variables are scalars", n, n_values);
        return false;
    }
    return n == 0
        || !(instance_missing(self, references, "valueReferences") || instance_missing(self, values, "values"));
}

/* Enters the call and checks the arrays; NULL after logging what is wrong. */
static Instance *enter_values(fmi3Instance instance, Fmi3Call call, size_t n, size_t n_values, const void *references,
                              const void *values)
{
    Instance *self = fmi3_enter(instance, call);
    return self != NULL && arrays_good(self, n, n_values, references, values) ? self : NULL;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_GET_FLOAT64, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : access_settle(self);
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_read(self, valueReferences[i], TYPE_REAL, &values[i]);
    }
    return (fmi3Status)status;
}

/* Whole numbers are exact in a double up to 2^53. */
static Status read_whole(Instance *self, fmi3ValueReference reference, VariableType type, double limit, int64_t *value)
{
    double number = 0.0;
    Status status = access_read(self, reference, type, &number);
    if (status == STATUS_OK && !(number >= -limit - 1.0 && number <= limit)) {
        return instance_fail(self, "variable '%s': %.17g does not fit its type", model_info.names[reference], number);
    }
    *value = status == STATUS_OK ? (int64_t)number : 0;
    return status;
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Int32 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_GET_INT32, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : access_settle(self);
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        int64_t value = 0;
        status = read_whole(self, valueReferences[i], TYPE_INTEGER, (double)INT32_MAX, &value);
        values[i] = (fmi3Int32)value;
    }
    return (fmi3Status)status;
}

fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Int64 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_GET_INT64, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : access_settle(self);
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        int64_t value = 0;
        status = read_whole(self, valueReferences[i], TYPE_ENUMERATION, 9007199254740992.0, &value);
        values[i] = value;
    }
    return (fmi3Status)status;
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Boolean values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_GET_BOOLEAN, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : access_settle(self);
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        double number = 0.0;
        status = access_read(self, valueReferences[i], TYPE_BOOLEAN, &number);
        values[i] = number != 0.0;
    }
    return (fmi3Status)status;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_SET_FLOAT64, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_write(self, valueReferences[i], TYPE_REAL, values[i]);
    }
    return (fmi3Status)status;
}

fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Int32 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_SET_INT32, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_write(self, valueReferences[i], TYPE_INTEGER, (double)values[i]);
    }
    return (fmi3Status)status;
}

fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Int64 values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_SET_INT64, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_write(self, valueReferences[i], TYPE_ENUMERATION, (double)values[i]);
    }
    return (fmi3Status)status;
}

fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Boolean values[], size_t nValues)
{
    Instance *self = enter_values(instance, CALL3_SET_BOOLEAN, nValueReferences, nValues, valueReferences, values);
    Status status = self == NULL ? STATUS_ERROR : STATUS_OK;
    for (size_t i = 0; status == STATUS_OK && i < nValues; i++) {
        status = access_write(self, valueReferences[i], TYPE_BOOLEAN, values[i] ? 1.0 : 0.0);
    }
    return (fmi3Status)status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    Instance *self = fmi3_enter(instance, CALL3_DIRECTIONAL_DERIVATIVE);
    if (self == NULL || !arrays_good(self, nUnknowns, nSensitivity, unknowns, sensitivity)
        || !arrays_good(self, nKnowns, nSeed, knowns, seed)) {
        return fmi3Error;
    }
    Status status = access_settle(self);
    return (fmi3Status)(status != STATUS_OK ? status
                                            : access_directional(self, unknowns, nUnknowns, knowns, nKnowns, seed,
                                                                 sensitivity));
}
