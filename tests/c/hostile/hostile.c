/* hostile.c: an FMU of FMI 2.0, dx/dt = u - x and y = x, that misbehaves from t = 0.5 on.
 *
 * How is chosen by the GUID it is instantiated with, "{hostile-segfault}": one library serves all.
 * Co-Simulation is one step of the explicit Euler method per communication step.
 *
 * Environment: where it hangs it first writes the number of its process to the file HOSTILE_TELLS; with
 * HOSTILE_HANGS_WHEN_LOADED it hangs already while the system loads the library.
 */
#define _POSIX_C_SOURCE 200809L /* getpid */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <process.h>
#else
#include <unistd.h>
#endif

#include "fmi2_stub.h"

#define FROM 0.5
#define BLOCK ((size_t)64 << 20)
#define MOST_BLOCKS 48 /* 3 GiB: enough for any limit, and not the end of the machine */

enum { VR_U, VR_X, VR_DER_X, VR_Y, N_VARIABLES };

typedef enum {
    NOTHING, SEGFAULT, ABORT, EXIT, HANG, MEMORY, NAN_OUTPUT, NAN_STATE, ERROR_STATUS, FATAL_STATUS,
    LAZY_RESTORE, WRONG_RESTORE, RANDOM, ONCE, CHATTER, SEGFAULT_AT_START,
    HANG_AT_START, N_BEHAVIOURS
} Behaviour;

static const char *const names[N_BEHAVIOURS] = {
    "nothing", "segfault", "abort", "exit", "hang", "memory", "nan-output", "nan-state", "error", "fatal",
    "lazy-restore", "wrong-restore", "random", "once", "chatter", "segfault-at-start",
    "hang-at-start",
};

typedef struct {
    Behaviour behaviour;
    const fmi2CallbackFunctions *callbacks;
    char name[256];
    double time;
    double v[N_VARIABLES];
} Model;

static int alive;
static unsigned noise;
static volatile int *volatile nowhere;
static void *volatile hoard;

static void hog(void)
{
    for (int i = 0; i < MOST_BLOCKS; i++) {
        char *block = malloc(BLOCK);
        if (block != NULL) {
            memset(block, i + 1, BLOCK);
            hoard = block;
        }
    }
}

static void hang(void)
{
    const char *name = getenv("HOSTILE_TELLS");
    FILE *file = name != NULL ? fopen(name, "w") : NULL;
    if (file != NULL) {
        fprintf(file, "%ld\n", (long)getpid());
        fclose(file);
    }
    for (volatile unsigned turns = 0;; turns = turns + 1) {
    }
}

__attribute__((constructor)) static void loaded(void)
{
    if (getenv("HOSTILE_HANGS_WHEN_LOADED") != NULL) {
        hang();
    }
}

static fmi2Status misbehave(Model *model)
{
    if (model->time < FROM) {
        return fmi2OK;
    }
    switch (model->behaviour) {
    case SEGFAULT:
        *nowhere = 1;
        break;
    case ABORT:
        abort();
    case EXIT:
        exit(3);
    case HANG:
        hang();
        break;
    case MEMORY:
        hog();
        break;
    case ERROR_STATUS:
    case FATAL_STATUS:
        if (model->callbacks != NULL && model->callbacks->logger != NULL) {
            model->callbacks->logger(model->callbacks->componentEnvironment, model->name, fmi2Error, "logStatusError",
                                     "the pump ran dry");
        }
        return model->behaviour == FATAL_STATUS ? fmi2Fatal : fmi2Error;
    case CHATTER:
        puts("hostile: a line that nobody wants");
        fflush(stdout);
        break;
    default:
        break;
    }
    return fmi2OK;
}

static double rate(Model *model)
{
    double dx = model->v[VR_U] - model->v[VR_X];
    if (model->behaviour == RANDOM) {
        noise = noise * 1103515245U + 12345U;
        dx += 1e-3 * ((double)(noise >> 16) / 65536.0 - 0.5);
    }
    return model->behaviour == NAN_STATE && model->time >= FROM ? NAN : dx;
}

/* ---- life ---- */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Behaviour behaviour = (Behaviour)chosen(guid, "hostile", names, N_BEHAVIOURS);
    (void)type;
    (void)location;
    (void)visible;
    (void)logging;
    if (behaviour == SEGFAULT_AT_START) {
        *nowhere = 1;
    }
    if (behaviour == HANG_AT_START) {
        hang();
    }
    if (behaviour == N_BEHAVIOURS || (behaviour == ONCE && alive > 0)) {
        const char *why = behaviour == ONCE ? "there is one already" : "the GUID is not that of this model";
        if (callbacks != NULL && callbacks->logger != NULL) {
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", why);
        }
        return NULL;
    }
    Model *model = calloc(1, sizeof *model);
    if (model != NULL) {
        model->behaviour = behaviour;
        model->callbacks = callbacks;
        snprintf(model->name, sizeof model->name, "%s", name != NULL ? name : "");
        model->v[VR_U] = 1.0;
        alive++;
    }
    return model;
}

void fmi2FreeInstance(fmi2Component c)
{
    alive -= c != NULL;
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)controlled;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    ((Model *)c)->time = start;
    return fmi2OK;
}

NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2Reset)

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *model = c;
    model->v[VR_DER_X] = rate(model);
    model->v[VR_Y] = model->behaviour == NAN_OUTPUT && model->time >= FROM ? NAN : model->v[VR_X];
    for (size_t i = 0; i < n; i++) {
        value[i] = model->v[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        ((Model *)c)->v[vr[i]] = value[i];
    }
    return fmi2OK;
}

/* ---- saved states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(Model));
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, c, sizeof(Model));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Model *model = c;
    if (model->behaviour == LAZY_RESTORE) {
        return fmi2OK;
    }
    memcpy(model, state, sizeof *model);
    model->v[VR_X] += model->behaviour == WRONG_RESTORE ? 1e-4 : 0.0;
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set, fmi2Boolean *event, fmi2Boolean *terminate)
{
    (void)c;
    (void)no_set;
    *event = fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((Model *)c)->time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    (void)n;
    ((Model *)c)->v[VR_X] = x[0];
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    (void)n;
    x[0] = ((Model *)c)->v[VR_X];
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    (void)n;
    dx[0] = rate(c);
    return misbehave(c);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    (void)c;
    (void)n;
    nominal[0] = 1.0;
    return fmi2OK;
}

/* ---- Co-Simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_set)
{
    Model *model = c;
    (void)no_set;
    model->time = point;
    model->v[VR_X] += size * rate(model);
    fmi2Status status = misbehave(model);
    model->time = point + size;
    return status;
}
