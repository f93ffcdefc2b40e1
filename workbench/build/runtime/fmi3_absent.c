/* fmi3_absent.c: FMI 3.0.2, functions for what the models do not have.
 *
 * No variables of the other types, no clocks, no structural parameters, no adjoint derivatives, no
 * dependencies of single elements. With nothing asked for they return OK, else an error that says so.
 */
#include "fmi3_calls.h"

/* Enters under the caller's own name but with the states of `call`. */
static fmi3Status absent(fmi3Instance instance, Fmi3Call call, const char *name, size_t n, const char *what)
{
    const Call own = {name, fmi3_calls[call].kinds, fmi3_calls[call].states};
    Instance *self = instance_enter(instance, &own);
    if (self == NULL) {
        return fmi3Error;
    }
    return n == 0 ? fmi3OK : (fmi3Status)instance_fail(self, "the model has no %s", what);
}

#define GETTER(Type)                                                                                                  \
    fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference valueReferences[],                       \
                             size_t nValueReferences, fmi3##Type values[], size_t nValues)                            \
    {                                                                                                                 \
        (void)valueReferences, (void)values;                                                                          \
        return absent(instance, CALL3_GET_OTHER, "fmi3Get" #Type, nValueReferences | nValues, #Type " variables");    \
    }

#define SETTER(Type)                                                                                                  \
    fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference valueReferences[],                       \
                             size_t nValueReferences, const fmi3##Type values[], size_t nValues)                      \
    {                                                                                                                 \
        (void)valueReferences, (void)values;                                                                          \
        return absent(instance, CALL3_SET_OTHER, "fmi3Set" #Type, nValueReferences | nValues, #Type " variables");    \
    }

GETTER(Float32)
SETTER(Float32)
GETTER(Int8)
SETTER(Int8)
GETTER(UInt8)
SETTER(UInt8)
GETTER(Int16)
SETTER(Int16)
GETTER(UInt16)
SETTER(UInt16)
GETTER(UInt32)
SETTER(UInt32)
GETTER(UInt64)
SETTER(UInt64)
GETTER(String)
SETTER(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         size_t valueSizes[], fmi3Binary values[], size_t nValues)
{
    (void)valueReferences, (void)valueSizes, (void)values;
    return absent(instance, CALL3_GET_OTHER, "fmi3GetBinary", nValueReferences | nValues, "Binary variables");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
{
    (void)valueReferences, (void)valueSizes, (void)values;
    return absent(instance, CALL3_SET_OTHER, "fmi3SetBinary", nValueReferences | nValues, "Binary variables");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Clock values[])
{
    (void)valueReferences, (void)values;
    return absent(instance, CALL3_CLOCK, "fmi3GetClock", nValueReferences, "clocks");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Clock values[])
{
    (void)valueReferences, (void)values;
    return absent(instance, CALL3_CLOCK, "fmi3SetClock", nValueReferences, "clocks");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences, (void)intervals, (void)qualifiers;
    return absent(instance, CALL3_CLOCK, "fmi3GetIntervalDecimal", nValueReferences, "clocks");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences, (void)counters, (void)resolutions, (void)qualifiers;
    return absent(instance, CALL3_CLOCK, "fmi3GetIntervalFraction", nValueReferences, "clocks");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[])
{
    (void)valueReferences, (void)shifts;
    return absent(instance, CALL3_CLOCK, "fmi3GetShiftDecimal", nValueReferences, "clocks");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)counters, (void)resolutions;
    return absent(instance, CALL3_CLOCK, "fmi3GetShiftFraction", nValueReferences, "clocks");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, const fmi3Float64 intervals[])
{
    (void)valueReferences, (void)intervals;
    return absent(instance, CALL3_CLOCK, "fmi3SetIntervalDecimal", nValueReferences, "clocks");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)counters, (void)resolutions;
    return absent(instance, CALL3_CLOCK, "fmi3SetIntervalFraction", nValueReferences, "clocks");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, const fmi3Float64 shifts[])
{
    (void)valueReferences, (void)shifts;
    return absent(instance, CALL3_CLOCK, "fmi3SetShiftDecimal", nValueReferences, "clocks");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)valueReferences, (void)counters, (void)resolutions;
    return absent(instance, CALL3_CLOCK, "fmi3SetShiftFraction", nValueReferences, "clocks");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime)
{
    (void)clockReference, (void)activationTime;
    fmi3_enter(instance, CALL3_ACTIVATE_PARTITION);
    return fmi3Error;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return absent(instance, CALL3_ENTER_CONFIGURATION, "fmi3EnterConfigurationMode", 1, "structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    fmi3_enter(instance, CALL3_EXIT_CONFIGURATION);
    return fmi3Error;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns;
    (void)seed, (void)nSeed, (void)sensitivity, (void)nSensitivity;
    return absent(instance, CALL3_ADJOINT_DERIVATIVE, "fmi3GetAdjointDerivative", 1, "adjoint derivatives");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference valueReference,
                                               size_t *nDependencies)
{
    (void)valueReference, (void)nDependencies;
    return absent(instance, CALL3_NUMBER_OF_DEPENDENCIES, "fmi3GetNumberOfVariableDependencies", 1,
                  "dependencies of elements; those in the model description do not change");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
                                       size_t nDependencies)
{
    (void)dependent, (void)elementIndicesOfDependent, (void)independents;
    (void)elementIndicesOfIndependents, (void)dependencyKinds, (void)nDependencies;
    return absent(instance, CALL3_DEPENDENCIES, "fmi3GetVariableDependencies", 1,
                  "dependencies of elements; those in the model description do not change");
}
