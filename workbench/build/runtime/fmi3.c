/* fmi3.c: FMI 3.0.2, what Model Exchange and Co-Simulation share: life, modes, saved states.
 *
 * Variables are in fmi3_values.c, the rest in fmi3_me.c, fmi3_cs.c and fmi3_absent.c.
 */
#include "fmi3_calls.h"

#include <stdlib.h>

const Call fmi3_calls[] = {
#define X(constant, function, kinds, states) {#function, kinds, states},
    FMI3_CALLS(X)
#undef X
};

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

static void emit(const Instance *instance, Status status, const char *category, const char *message)
{
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)instance->logger;
    if (logger != NULL) {
        logger(instance->environment, (fmi3Status)status, category, message);
    }
}

static Birth birth_of(Kind kind, fmi3String name, fmi3String token, fmi3Boolean logging,
                      fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    Birth birth = {
        .fmi = 3,
        .kind = kind,
        .memory = {calloc, free},
        .name = name,
        .token = token,
        .logging = logging,
        .emit = emit,
        .logger = (void (*)(void))logger,
        .environment = environment,
    };
    return birth;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)resourcePath; /* nothing is read from there */
    (void)visible;
    Birth birth = birth_of(KIND_ME, instanceName, instantiationToken, loggingOn, instanceEnvironment, logMessage);
    return instance_new(&birth, "fmi3InstantiateModelExchange");
}

/* Calls the environment between two internal steps, in Intermediate Update Mode. */
static bool intermediate_update(Instance *instance, double *stop_at)
{
    fmi3IntermediateUpdateCallback update = (fmi3IntermediateUpdateCallback)instance->update;
    const char *call = instance->call;
    fmi3Boolean requested = fmi3False;
    fmi3Float64 time = core_time(instance->core);
    fmi3Float64 return_time = time;
    instance_set_state(instance, STATE_INTERMEDIATE);
    update(instance->environment, time, fmi3False, fmi3True, fmi3True, instance->early_return_allowed, &requested,
           &return_time);
    instance->call = call;
    if (instance_state(instance) != STATE_INTERMEDIATE) {
        return false; /* a call in there failed and has said why */
    }
    instance_set_state(instance, STATE_STEP);
    if (requested && instance->early_return_allowed) {
        *stop_at = return_time > time ? return_time : time;
    }
    return true;
}

static bool intermediate_variables_good(Instance *instance, const fmi3ValueReference references[], size_t n)
{
    if (n > 0 && instance_missing(instance, references, "requiredIntermediateVariables")) {
        return false;
    }
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= model_info.n_variables
            || model_info.variables[references[i]].variability != VARIABILITY_CONTINUOUS) {
            instance_fail(instance, "required intermediate variable %u is no continuous variable", references[i]);
            return false;
        }
    }
    return true;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)resourcePath;
    (void)visible;
    Birth birth = birth_of(KIND_CS, instanceName, instantiationToken, loggingOn, instanceEnvironment, logMessage);
    Instance *instance = instance_new(&birth, "fmi3InstantiateCoSimulation");
    if (instance == NULL) {
        return NULL;
    }
    if (!intermediate_variables_good(instance, requiredIntermediateVariables, nRequiredIntermediateVariables)) {
        instance_free(instance);
        return NULL;
    }
    instance->event_mode_used = eventModeUsed;
    instance->early_return_allowed = earlyReturnAllowed;
    instance->update = (void (*)(void))intermediateUpdate;
    instance->intermediate = intermediateUpdate != NULL ? intermediate_update : NULL;
    return instance;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible;
    (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    if (logMessage != NULL && loggingOn) {
        logMessage(instanceEnvironment, fmi3Error, "logStatusError",
                   "fmi3InstantiateScheduledExecution: not available, use Model Exchange or Co-Simulation");
    }
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    instance_free(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    Instance *self = fmi3_enter(instance, CALL3_SET_DEBUG_LOGGING);
    return self == NULL ? fmi3Error : (fmi3Status)instance_set_logging(self, loggingOn, nCategories, categories);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    Instance *self = fmi3_enter(instance, CALL3_ENTER_INITIALIZATION);
    if (self == NULL) {
        return fmi3Error;
    }
    Status status = instance_set_experiment(self, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime);
    return (fmi3Status)(status != STATUS_OK ? status : instance_enter_initialisation(self));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_EXIT_INITIALIZATION);
    return self == NULL ? fmi3Error : (fmi3Status)instance_exit_initialisation(self);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_ENTER_EVENT_MODE);
    if (self == NULL) {
        return fmi3Error;
    }
    if (self->kind == KIND_CS && !self->event_mode_used) {
        return (fmi3Status)instance_fail(self, "the instance was made with eventModeUsed = false");
    }
    return (fmi3Status)instance_enter_event(self);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    Instance *self = fmi3_enter(instance, CALL3_UPDATE_DISCRETE_STATES);
    if (self == NULL || instance_missing(self, discreteStatesNeedUpdate, "discreteStatesNeedUpdate")
        || instance_missing(self, terminateSimulation, "terminateSimulation")
        || instance_missing(self, nominalsOfContinuousStatesChanged, "nominalsOfContinuousStatesChanged")
        || instance_missing(self, valuesOfContinuousStatesChanged, "valuesOfContinuousStatesChanged")
        || instance_missing(self, nextEventTimeDefined, "nextEventTimeDefined")
        || instance_missing(self, nextEventTime, "nextEventTime")) {
        return fmi3Error;
    }
    CoreEventInfo info;
    Status status = instance_new_discrete_states(self, &info);
    *discreteStatesNeedUpdate = info.discrete_states_need_update;
    *terminateSimulation = info.terminate;
    *nominalsOfContinuousStatesChanged = info.nominals_changed;
    *valuesOfContinuousStatesChanged = info.continuous_states_changed;
    *nextEventTimeDefined = info.next_event_time_defined;
    *nextEventTime = info.next_event_time_defined ? info.next_event_time : 0.0;
    return (fmi3Status)status;
}

/* providesEvaluateDiscreteStates is false: FMI 3.0 says that the call is ignored. */
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return fmi3_enter(instance, CALL3_EVALUATE_DISCRETE_STATES) == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_TERMINATE);
    if (self == NULL) {
        return fmi3Error;
    }
    instance_set_state(self, STATE_TERMINATED);
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    Instance *self = fmi3_enter(instance, CALL3_RESET);
    if (self == NULL) {
        return fmi3Error;
    }
    instance_reset(self);
    return fmi3OK;
}

/* ---- saved states ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    Instance *self = fmi3_enter(instance, CALL3_GET_FMU_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_save(self, FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    Instance *self = fmi3_enter(instance, CALL3_SET_FMU_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_restore(self, FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    Instance *self = fmi3_enter(instance, CALL3_FREE_FMU_STATE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_delete(self, FMUState);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    Instance *self = fmi3_enter(instance, CALL3_SERIALIZED_SIZE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_size(self, FMUState, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    Instance *self = fmi3_enter(instance, CALL3_SERIALIZE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_write(self, FMUState, serializedState, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState)
{
    Instance *self = fmi3_enter(instance, CALL3_DESERIALIZE);
    return self == NULL ? fmi3Error : (fmi3Status)snapshot_read(self, serializedState, size, FMUState);
}
