/* fmi2.c: FMI 2.0.4, what Model Exchange and Co-Simulation share: life, modes, saved states.
 *
 * Variables are in fmi2_values.c, the rest in fmi2_me.c and fmi2_cs.c.
 */
#include "fmi2_calls.h"

#include <stdlib.h>

const Call fmi2_calls[] = {
#define X(constant, function, kinds, states) {#function, kinds, states},
    FMI2_CALLS(X)
#undef X
};

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* The message is a format to the logger, and # starts a variable's reference: both are doubled. */
static void escape(const char *message, char *escaped, size_t size)
{
    size_t used = 0;
    for (; *message != '\0' && used + 2 < size; message++) {
        if (*message == '%' || *message == '#') {
            escaped[used++] = *message;
        }
        escaped[used++] = *message;
    }
    escaped[used] = '\0';
}

static void emit(const Instance *instance, Status status, const char *category, const char *message)
{
    fmi2CallbackLogger logger = (fmi2CallbackLogger)instance->logger;
    char escaped[2048];
    if (logger != NULL) {
        escape(message, escaped, sizeof escaped);
        logger(instance->environment, instance->name, (fmi2Status)status, category, escaped);
    }
}

static Memory memory_of(const fmi2CallbackFunctions *functions)
{
    Memory memory = {calloc, free};
    if (functions->allocateMemory != NULL && functions->freeMemory != NULL) {
        memory.allocate = functions->allocateMemory;
        memory.release = functions->freeMemory;
    }
    return memory;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    (void)fmuResourceLocation; /* nothing is read from there */
    (void)visible;
    if (functions == NULL || (fmuType != fmi2ModelExchange && fmuType != fmi2CoSimulation)) {
        return NULL;
    }
    Birth birth = {
        .fmi = 2,
        .kind = fmuType == fmi2ModelExchange ? KIND_ME : KIND_CS,
        .memory = memory_of(functions),
        .name = instanceName,
        .token = fmuGUID,
        .logging = loggingOn != fmi2False,
        .emit = emit,
        .logger = (void (*)(void))functions->logger,
        .environment = functions->componentEnvironment,
    };
    return instance_new(&birth, "fmi2Instantiate");
}

void fmi2FreeInstance(fmi2Component c)
{
    instance_free(c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    Instance *instance = fmi2_enter(c, CALL2_SET_DEBUG_LOGGING);
    if (instance == NULL) {
        return fmi2Error;
    }
    return (fmi2Status)instance_set_logging(instance, loggingOn != fmi2False, nCategories, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    Instance *instance = fmi2_enter(c, CALL2_SETUP_EXPERIMENT);
    if (instance == NULL) {
        return fmi2Error;
    }
    return (fmi2Status)instance_set_experiment(instance, toleranceDefined != fmi2False, tolerance, startTime,
                                               stopTimeDefined != fmi2False, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_ENTER_INITIALIZATION);
    return instance == NULL ? fmi2Error : (fmi2Status)instance_enter_initialisation(instance);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_EXIT_INITIALIZATION);
    return instance == NULL ? fmi2Error : (fmi2Status)instance_exit_initialisation(instance);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_TERMINATE);
    if (instance == NULL) {
        return fmi2Error;
    }
    instance_set_state(instance, STATE_TERMINATED);
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *instance = fmi2_enter(c, CALL2_RESET);
    if (instance == NULL) {
        return fmi2Error;
    }
    instance_reset(instance);
    return fmi2OK;
}

/* ---- saved states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    Instance *instance = fmi2_enter(c, CALL2_GET_FMU_STATE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_save(instance, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    Instance *instance = fmi2_enter(c, CALL2_SET_FMU_STATE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_restore(instance, FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    Instance *instance = fmi2_enter(c, CALL2_FREE_FMU_STATE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_delete(instance, FMUstate);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    Instance *instance = fmi2_enter(c, CALL2_SERIALIZED_SIZE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_size(instance, FMUstate, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    Instance *instance = fmi2_enter(c, CALL2_SERIALIZE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_write(instance, FMUstate, serializedState, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    Instance *instance = fmi2_enter(c, CALL2_DESERIALIZE);
    return instance == NULL ? fmi2Error : (fmi2Status)snapshot_read(instance, serializedState, size, FMUstate);
}
