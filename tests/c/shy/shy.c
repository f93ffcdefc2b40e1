/* shy.c: co-simulation of FMI 3.0, dx/dt = u - x and y = x, that declares event mode and has its own mind about it.
 *
 * How is chosen by the token it is instantiated with: "{shy-works}" keeps its promise and wants an event at t = 1,
 * where x jumps to 0 (without event mode nothing jumps); "{shy-instantiate}" refuses to be instantiated with event
 * mode; "{shy-update}" refuses the first event iteration; "{shy-ends}" ends its run at t = 0.5; "{shy-lost}" says at
 * its event that the next one is at NaN. A step is exact for a held input.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

enum { VR_U = 1, VR_X = 2, VR_Y = 3 };
static const double JUMP = 1.0;
static const double END = 0.5;

typedef struct {
    char token[32];
    bool events, stepping;
    double u, x, time;
} Model;

static bool is(const Model *model, const char *behaviour)
{
    return strcmp(model->token, behaviour) == 0;
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early_return;
    (void)required;
    (void)n_required;
    (void)environment;
    (void)log;
    (void)update;
    if (event_mode && strcmp(token, "{shy-instantiate}") == 0) {
        return NULL;
    }
    Model *model = calloc(1, sizeof *model);
    if (model != NULL) {
        strncpy(model->token, token, sizeof model->token - 1);
        model->events = event_mode;
        model->u = 1.0;
    }
    return model;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)instance;
    (void)on;
    (void)n;
    (void)categories;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean told, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop)
{
    (void)told;
    (void)tolerance;
    (void)stops;
    (void)stop;
    ((Model *)instance)->time = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    ((Model *)instance)->stepping = !((Model *)instance)->events;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    Model *model = instance;
    const bool allowed = model->events && model->stepping;
    model->stepping = false;
    return allowed ? fmi3OK : fmi3Error;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    Model *model = instance;
    const bool allowed = model->events && !model->stepping;
    model->stepping = true;
    return allowed ? fmi3OK : fmi3Error;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *timed, fmi3Float64 *next)
{
    Model *model = instance;
    if (is(model, "{shy-update}") || !model->events || model->stepping) {
        return fmi3Error;
    }
    *again = *terminate = *nominals = *states = *timed = false;
    *next = 0.0;
    if (fabs(model->time - JUMP) < 1e-9) {
        model->x = 0.0;
        *timed = is(model, "{shy-lost}");
        *next = NAN;
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_way_back,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Model *model = instance;
    double end = time + step;
    (void)no_way_back;
    if (!model->stepping || fabs(time - model->time) > 1e-9) {
        return fmi3Error;
    }
    *event = *terminate = *early = false;
    if (is(model, "{shy-ends}") && end >= END - 1e-9) {
        end = fmin(end, END);
        *terminate = true;
        *early = end < time + step;
    } else if (model->events && time < JUMP - 1e-9 && end >= JUMP - 1e-9) {
        end = fmin(end, JUMP);
        *event = true;
        *early = end < time + step;
    }
    model->x = model->u + (model->x - model->u) * exp(-(end - time));
    model->time = *reached = end;
    return fmi3OK;
}

static double *at(Model *model, fmi3ValueReference reference)
{
    return reference == VR_U ? &model->u : &model->x;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Float64 values[],
                          size_t n_values)
{
    for (size_t i = 0; i < n && i < n_values; i++) {
        values[i] = *at(instance, references[i]);
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                          const fmi3Float64 values[], size_t n_values)
{
    for (size_t i = 0; i < n && i < n_values; i++) {
        *at(instance, references[i]) = values[i];
    }
    return fmi3OK;
}
