/* fmi2_calls.h: which function of FMI 2.0 may be called in which state.
 *
 * Source: FMI 2.0.4, tables at the end of sections 3.2.3 (Model Exchange) and 4.2.4 (Co-Simulation).
 */
#ifndef WORKBENCH_FMI2_CALLS_H
#define WORKBENCH_FMI2_CALLS_H

#include "instance.h"

#include "fmi2Functions.h"

#define FMI2_ANY                                                                                                      \
    (STATE_INSTANTIATED | STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_STEP | STATE_STEP_FAILED      \
     | STATE_TERMINATED | STATE_ERROR)
#define FMI2_AFTER_START (FMI2_ANY & ~(unsigned)STATE_INSTANTIATED)
#define FMI2_SETTABLE (STATE_INSTANTIATED | STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_STEP)
#define FMI2_ME_VALUES                                                                                                \
    (STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_TERMINATED | STATE_ERROR)
#define FMI2_CS_STATUS (STATE_STEP | STATE_STEP_FAILED | STATE_TERMINATED)

/* The one table: X(constant, function, kinds, states). */
#define FMI2_CALLS(X)                                                                                                 \
    X(SET_DEBUG_LOGGING, fmi2SetDebugLogging, KIND_BOTH, FMI2_ANY)                                                    \
    X(SETUP_EXPERIMENT, fmi2SetupExperiment, KIND_BOTH, STATE_INSTANTIATED)                                           \
    X(ENTER_INITIALIZATION, fmi2EnterInitializationMode, KIND_BOTH, STATE_INSTANTIATED)                               \
    X(EXIT_INITIALIZATION, fmi2ExitInitializationMode, KIND_BOTH, STATE_INITIALISATION)                               \
    X(TERMINATE, fmi2Terminate, KIND_BOTH, STATE_EVENT | STATE_CONTINUOUS | STATE_STEP | STATE_STEP_FAILED)           \
    X(RESET, fmi2Reset, KIND_BOTH, FMI2_ANY)                                                                          \
    X(GET_REAL, fmi2GetReal, KIND_BOTH, FMI2_AFTER_START)                                                             \
    X(GET_INTEGER, fmi2GetInteger, KIND_BOTH, FMI2_AFTER_START)                                                       \
    X(GET_BOOLEAN, fmi2GetBoolean, KIND_BOTH, FMI2_AFTER_START)                                                       \
    X(GET_STRING, fmi2GetString, KIND_BOTH, FMI2_AFTER_START)                                                         \
    X(SET_REAL, fmi2SetReal, KIND_BOTH, FMI2_SETTABLE)                                                                \
    X(SET_INTEGER, fmi2SetInteger, KIND_BOTH, FMI2_SETTABLE & ~(unsigned)STATE_CONTINUOUS)                            \
    X(SET_BOOLEAN, fmi2SetBoolean, KIND_BOTH, FMI2_SETTABLE & ~(unsigned)STATE_CONTINUOUS)                            \
    X(SET_STRING, fmi2SetString, KIND_BOTH, FMI2_SETTABLE & ~(unsigned)STATE_CONTINUOUS)                              \
    X(GET_FMU_STATE, fmi2GetFMUstate, KIND_BOTH, FMI2_ANY)                                                            \
    X(SET_FMU_STATE, fmi2SetFMUstate, KIND_BOTH, FMI2_ANY)                                                            \
    X(FREE_FMU_STATE, fmi2FreeFMUstate, KIND_BOTH, FMI2_ANY)                                                          \
    X(SERIALIZED_SIZE, fmi2SerializedFMUstateSize, KIND_BOTH, FMI2_ANY)                                               \
    X(SERIALIZE, fmi2SerializeFMUstate, KIND_BOTH, FMI2_ANY)                                                          \
    X(DESERIALIZE, fmi2DeSerializeFMUstate, KIND_BOTH, FMI2_ANY)                                                      \
    X(DIRECTIONAL_DERIVATIVE, fmi2GetDirectionalDerivative, KIND_BOTH, FMI2_AFTER_START)                              \
    X(ENTER_EVENT_MODE, fmi2EnterEventMode, KIND_ME, STATE_EVENT | STATE_CONTINUOUS)                                  \
    X(NEW_DISCRETE_STATES, fmi2NewDiscreteStates, KIND_ME, STATE_EVENT)                                               \
    X(ENTER_CONTINUOUS, fmi2EnterContinuousTimeMode, KIND_ME, STATE_EVENT)                                            \
    X(COMPLETED_STEP, fmi2CompletedIntegratorStep, KIND_ME, STATE_CONTINUOUS)                                         \
    X(SET_TIME, fmi2SetTime, KIND_ME, STATE_EVENT | STATE_CONTINUOUS)                                                 \
    X(SET_STATES, fmi2SetContinuousStates, KIND_ME, STATE_CONTINUOUS)                                                 \
    X(GET_DERIVATIVES, fmi2GetDerivatives, KIND_ME, FMI2_ME_VALUES)                                                   \
    X(GET_INDICATORS, fmi2GetEventIndicators, KIND_ME, FMI2_ME_VALUES)                                                \
    X(GET_STATES, fmi2GetContinuousStates, KIND_ME, FMI2_ME_VALUES)                                                   \
    X(GET_NOMINALS, fmi2GetNominalsOfContinuousStates, KIND_ME, FMI2_ME_VALUES | STATE_INSTANTIATED)                  \
    X(SET_INPUT_DERIVATIVES, fmi2SetRealInputDerivatives, KIND_CS,                                                    \
      STATE_INSTANTIATED | STATE_INITIALISATION | STATE_STEP)                                                         \
    X(GET_OUTPUT_DERIVATIVES, fmi2GetRealOutputDerivatives, KIND_CS,                                                  \
      STATE_STEP | STATE_STEP_FAILED | STATE_TERMINATED | STATE_ERROR)                                                \
    X(DO_STEP, fmi2DoStep, KIND_CS, STATE_STEP)                                                                       \
    X(CANCEL_STEP, fmi2CancelStep, KIND_CS, 0U) /* only while doStep runs asynchronously: never */                    \
    X(GET_STATUS, fmi2GetStatus, KIND_CS, FMI2_CS_STATUS)                                                             \
    X(GET_REAL_STATUS, fmi2GetRealStatus, KIND_CS, FMI2_CS_STATUS)                                                    \
    X(GET_INTEGER_STATUS, fmi2GetIntegerStatus, KIND_CS, FMI2_CS_STATUS)                                              \
    X(GET_BOOLEAN_STATUS, fmi2GetBooleanStatus, KIND_CS, FMI2_CS_STATUS)                                              \
    X(GET_STRING_STATUS, fmi2GetStringStatus, KIND_CS, FMI2_CS_STATUS)

typedef enum {
#define X(constant, function, kinds, states) CALL2_##constant,
    FMI2_CALLS(X)
#undef X
} Fmi2Call;

extern const Call fmi2_calls[];

static inline Instance *fmi2_enter(fmi2Component component, Fmi2Call call)
{
    return instance_enter(component, &fmi2_calls[call]);
}

/* True after logging when one of n > 0 values has no array. */
static inline bool fmi2_missing(Instance *instance, size_t n, const void *references, const void *values)
{
    return n > 0
        && (instance_missing(instance, references, "vr") || instance_missing(instance, values, "value"));
}

#endif
