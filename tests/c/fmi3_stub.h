/* fmi3_stub.h: what FMUs of FMI 3.0 for tests have in common: instances, modes, and an error for a call in the wrong one.
 *
 * Included by libraries of one source file each, which define FMI3_STUB_MODEL (a struct) and `reset` before, and their
 * own getters and setters after: it defines functions.
 */
#ifndef FMI3_STUB_H
#define FMI3_STUB_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

typedef enum { INSTANTIATED = 1, CONFIGURATION = 2, INITIALISATION = 4, EVENT = 8, CONTINUOUS = 16, STEP = 32 } Mode;

typedef struct {
    Mode mode;
    bool exchange, event_mode;
    double time;
    char token[32];
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update;
    FMI3_STUB_MODEL model;
} Stub;

static void reset(FMI3_STUB_MODEL *model);

static fmi3Status wrong(const Stub *stub, const char *what)
{
    stub->log(stub->environment, fmi3Error, "logStatusError", what);
    return fmi3Error;
}

static fmi3Status expect(const Stub *stub, unsigned modes, const char *call)
{
    return (stub->mode & modes) ? fmi3OK : wrong(stub, call);
}

#define EXPECT(stub, modes, call)                                                                                      \
    if (expect(stub, modes, call " is not allowed in this mode") != fmi3OK) {                                          \
        return fmi3Error;                                                                                              \
    }

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

static fmi3Instance made(fmi3String token, bool exchange, bool event_mode, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log)
{
    Stub *stub = calloc(1, sizeof *stub);
    if (stub != NULL) {
        stub->mode = INSTANTIATED;
        strncpy(stub->token, token, sizeof stub->token - 1);
        stub->exchange = exchange;
        stub->event_mode = event_mode;
        stub->environment = environment;
        stub->log = log;
        reset(&stub->model);
    }
    return stub;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    return made(token, true, true, environment, log);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return, (void)required;
    (void)n_required;
    Stub *stub = made(token, false, event_mode, environment, log);
    if (stub != NULL) {
        stub->update = update;
    }
    return stub;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)instance, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

static fmi3Status go(fmi3Instance instance, unsigned from, Mode to, const char *call)
{
    Stub *stub = instance;
    const fmi3Status status = expect(stub, from, call);
    stub->mode = status == fmi3OK ? to : stub->mode;
    return status;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return go(instance, INSTANTIATED, CONFIGURATION, "fmi3EnterConfigurationMode is not allowed in this mode");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return go(instance, CONFIGURATION, INSTANTIATED, "fmi3ExitConfigurationMode is not allowed in this mode");
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean told, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean ends, fmi3Float64 stop)
{
    (void)told, (void)tolerance, (void)ends, (void)stop;
    ((Stub *)instance)->time = start;
    return go(instance, INSTANTIATED, INITIALISATION, "fmi3EnterInitializationMode is not allowed in this mode");
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    const Stub *stub = instance;
    const Mode next = stub->event_mode ? EVENT : STEP;
    return go(instance, INITIALISATION, next, "fmi3ExitInitializationMode is not allowed in this mode");
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    const Stub *stub = instance;
    const unsigned from = stub->exchange ? CONTINUOUS : stub->event_mode ? STEP : 0U;
    return go(instance, from, EVENT, "fmi3EnterEventMode is not allowed in this mode");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return go(instance, EVENT, CONTINUOUS, "fmi3EnterContinuousTimeMode is not allowed in this mode");
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return go(instance, EVENT, STEP, "fmi3EnterStepMode is not allowed in this mode");
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    Stub *stub = instance;
    EXPECT(stub, CONTINUOUS | EVENT, "fmi3SetTime");
    stub->time = time;
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    Stub *copy = *state != NULL ? *state : malloc(sizeof *copy);
    if (copy == NULL) {
        return fmi3Error;
    }
    *copy = *(Stub *)instance;
    *state = copy;
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    *(Stub *)instance = *(Stub *)state;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

#endif
