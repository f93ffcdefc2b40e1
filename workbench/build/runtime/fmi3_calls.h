/* fmi3_calls.h: which function of FMI 3.0 may be called in which state.
 *
 * Source: FMI 3.0.2, sections 2.3 (common states), 3.2 (Model Exchange), 4.2 (Co-Simulation). What
 * is read in Instantiated is the start value.
 */
#ifndef WORKBENCH_FMI3_CALLS_H
#define WORKBENCH_FMI3_CALLS_H

#include "instance.h"

#include "fmi3Functions.h"

#define FMI3_SETABLE                                                                                                  \
    (STATE_INSTANTIATED | STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_STEP | STATE_TERMINATED)
#define FMI3_ANY (FMI3_SETABLE | STATE_INTERMEDIATE)
#define FMI3_READ FMI3_ANY
#define FMI3_WRITE (STATE_INSTANTIATED | STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_STEP)
#define FMI3_WRITE_DISCRETE (FMI3_WRITE & ~(unsigned)STATE_CONTINUOUS)
#define FMI3_DERIVATIVE (FMI3_SETABLE & ~(unsigned)STATE_INSTANTIATED)
#define FMI3_ME_VALUES (STATE_INITIALISATION | STATE_EVENT | STATE_CONTINUOUS | STATE_TERMINATED)
#define FMI3_ME_NUMBERS (FMI3_ME_VALUES | STATE_INSTANTIATED)
#define FMI3_CLOCKS (STATE_INITIALISATION | STATE_EVENT | STATE_STEP)

/* The one table: X(constant, function, kinds, states). */
#define FMI3_CALLS(X)                                                                                                 \
    X(SET_DEBUG_LOGGING, fmi3SetDebugLogging, KIND_BOTH, FMI3_ANY)                                                    \
    X(ENTER_INITIALIZATION, fmi3EnterInitializationMode, KIND_BOTH, STATE_INSTANTIATED)                               \
    X(EXIT_INITIALIZATION, fmi3ExitInitializationMode, KIND_BOTH, STATE_INITIALISATION)                               \
    X(ENTER_EVENT_MODE, fmi3EnterEventMode, KIND_BOTH, STATE_CONTINUOUS | STATE_STEP)                                 \
    X(TERMINATE, fmi3Terminate, KIND_BOTH, STATE_EVENT | STATE_CONTINUOUS | STATE_STEP)                               \
    X(RESET, fmi3Reset, KIND_BOTH, FMI3_SETABLE)                                                                      \
    X(GET_FLOAT64, fmi3GetFloat64, KIND_BOTH, FMI3_READ)                                                              \
    X(GET_INT32, fmi3GetInt32, KIND_BOTH, FMI3_READ)                                                                  \
    X(GET_INT64, fmi3GetInt64, KIND_BOTH, FMI3_READ)                                                                  \
    X(GET_BOOLEAN, fmi3GetBoolean, KIND_BOTH, FMI3_READ)                                                              \
    X(GET_OTHER, fmi3Get, KIND_BOTH, FMI3_READ)                                                                       \
    X(SET_FLOAT64, fmi3SetFloat64, KIND_BOTH, FMI3_WRITE)                                                             \
    X(SET_INT32, fmi3SetInt32, KIND_BOTH, FMI3_WRITE_DISCRETE)                                                        \
    X(SET_INT64, fmi3SetInt64, KIND_BOTH, FMI3_WRITE_DISCRETE)                                                        \
    X(SET_BOOLEAN, fmi3SetBoolean, KIND_BOTH, FMI3_WRITE_DISCRETE)                                                    \
    X(SET_OTHER, fmi3Set, KIND_BOTH, FMI3_WRITE)                                                                      \
    X(NUMBER_OF_DEPENDENCIES, fmi3GetNumberOfVariableDependencies, KIND_BOTH, FMI3_ANY)                               \
    X(DEPENDENCIES, fmi3GetVariableDependencies, KIND_BOTH, FMI3_ANY)                                                 \
    X(GET_FMU_STATE, fmi3GetFMUState, KIND_BOTH, FMI3_SETABLE)                                                        \
    X(SET_FMU_STATE, fmi3SetFMUState, KIND_BOTH, FMI3_SETABLE)                                                        \
    X(FREE_FMU_STATE, fmi3FreeFMUState, KIND_BOTH, FMI3_SETABLE)                                                      \
    X(SERIALIZED_SIZE, fmi3SerializedFMUStateSize, KIND_BOTH, FMI3_SETABLE)                                           \
    X(SERIALIZE, fmi3SerializeFMUState, KIND_BOTH, FMI3_SETABLE)                                                      \
    X(DESERIALIZE, fmi3DeserializeFMUState, KIND_BOTH, FMI3_SETABLE)                                                  \
    X(DIRECTIONAL_DERIVATIVE, fmi3GetDirectionalDerivative, KIND_BOTH, FMI3_DERIVATIVE)                               \
    X(ADJOINT_DERIVATIVE, fmi3GetAdjointDerivative, KIND_BOTH, FMI3_DERIVATIVE)                                       \
    X(ENTER_CONFIGURATION, fmi3EnterConfigurationMode, KIND_BOTH, STATE_INSTANTIATED | STATE_EVENT | STATE_STEP)      \
    X(EXIT_CONFIGURATION, fmi3ExitConfigurationMode, KIND_BOTH, 0U) /* cannot be entered */                           \
    X(CLOCK, fmi3Clock, KIND_BOTH, FMI3_CLOCKS)                                                                       \
    X(EVALUATE_DISCRETE_STATES, fmi3EvaluateDiscreteStates, KIND_BOTH, STATE_EVENT)                                   \
    X(UPDATE_DISCRETE_STATES, fmi3UpdateDiscreteStates, KIND_BOTH, STATE_EVENT)                                       \
    X(ENTER_CONTINUOUS, fmi3EnterContinuousTimeMode, KIND_ME, STATE_EVENT)                                            \
    X(COMPLETED_STEP, fmi3CompletedIntegratorStep, KIND_ME, STATE_CONTINUOUS)                                         \
    X(SET_TIME, fmi3SetTime, KIND_ME, STATE_EVENT | STATE_CONTINUOUS)                                                 \
    X(SET_STATES, fmi3SetContinuousStates, KIND_ME, STATE_CONTINUOUS)                                                 \
    X(GET_DERIVATIVES, fmi3GetContinuousStateDerivatives, KIND_ME, FMI3_ME_VALUES)                                    \
    X(GET_INDICATORS, fmi3GetEventIndicators, KIND_ME, FMI3_ME_VALUES)                                                \
    X(GET_STATES, fmi3GetContinuousStates, KIND_ME, FMI3_ME_VALUES)                                                   \
    X(GET_NOMINALS, fmi3GetNominalsOfContinuousStates, KIND_ME, FMI3_ME_NUMBERS)                                      \
    X(NUMBER_OF_INDICATORS, fmi3GetNumberOfEventIndicators, KIND_ME, FMI3_ME_NUMBERS)                                 \
    X(NUMBER_OF_STATES, fmi3GetNumberOfContinuousStates, KIND_ME, FMI3_ME_NUMBERS)                                    \
    X(ENTER_STEP_MODE, fmi3EnterStepMode, KIND_CS, STATE_EVENT)                                                       \
    X(GET_OUTPUT_DERIVATIVES, fmi3GetOutputDerivatives, KIND_CS,                                                      \
      STATE_STEP | STATE_INTERMEDIATE | STATE_TERMINATED)                                                             \
    X(DO_STEP, fmi3DoStep, KIND_CS, STATE_STEP)                                                                       \
    X(ACTIVATE_PARTITION, fmi3ActivateModelPartition, KIND_BOTH, 0U) /* Scheduled Execution only */

typedef enum {
#define X(constant, function, kinds, states) CALL3_##constant,
    FMI3_CALLS(X)
#undef X
} Fmi3Call;

extern const Call fmi3_calls[];

static inline Instance *fmi3_enter(fmi3Instance instance, Fmi3Call call)
{
    return instance_enter(instance, &fmi3_calls[call]);
}

#endif
