/* reference2.c: small models with one subject each, of FMI 2.0; through fmi1_*.c of FMI 1.0, too.
 *
 * Which is chosen by the GUID: "{reference-stair}" counts 1, 2, ... at every second and ends its run when the count
 * reaches 10; "{reference-resource}" reads its output from resources/y.txt; "{reference-feedthrough}" passes values of
 * every type on, from each odd value reference to the next one. No states; in Co-Simulation time passes, no more.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

typedef enum { STAIR, RESOURCE, FEEDTHROUGH, N_MODELS } Which;
static const char *const names[N_MODELS] = {"stair", "resource", "feedthrough"};

enum { VR_TIME, VR_COUNT, N_VALUES = 16, TEXT = 64, LAST = 10 };

typedef struct {
    Which which;
    int ended;
    double v[N_VALUES];
    char text[N_VALUES][TEXT];
} Model;

#include "fmi2_stub.h"

/* "file:///…/resources" (FMI 2.0) or "file:///…" of the whole FMU (FMI 1.0). */
static int read_resource(const char *location, double *value)
{
    static const char *const endings[] = {"/y.txt", "/resources/y.txt"};
    const char *path = location != NULL ? location : "";
    path += strncmp(path, "file:", 5) == 0 ? 5 : 0;
    while (path[0] == '/' && path[1] == '/') {
        path++;
    }
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
        char name[4096];
        if (snprintf(name, sizeof name, "%s%s", path, endings[i]) >= (int)sizeof name) {
            return 0;
        }
        FILE *file = fopen(name, "r");
        if (file != NULL) {
            const int letter = fgetc(file);
            fclose(file);
            *value = letter;
            return 1;
        }
    }
    return 0;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    const Which which = (Which)chosen(guid, "reference", names, N_MODELS);
    (void)type;
    (void)visible;
    (void)logging;
    Model *model = which == N_MODELS ? NULL : calloc(1, sizeof *model);
    if (model == NULL) {
        return NULL;
    }
    model->which = which;
    model->v[VR_COUNT] = which == STAIR ? 1.0 : 0.0;
    snprintf(model->text[9], TEXT, "Set me!");
    if (which == RESOURCE && !read_resource(location, &model->v[VR_COUNT])) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError",
                          "cannot read resources/y.txt below %s", location);
        free(model);
        return NULL;
    }
    return model;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)controlled;
    (void)tolerance;
    (void)stop_defined;
    (void)stop;
    ((Model *)c)->v[VR_TIME] = start;
    return fmi2OK;
}

NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2CancelStep)

fmi2Status fmi2Reset(fmi2Component c)
{
    Model *model = c;
    memset(model->v, 0, sizeof model->v);
    model->v[VR_COUNT] = model->which == STAIR ? 1.0 : 0.0;
    model->ended = 0;
    return fmi2OK;
}

/* ---- values ---- */

/* The place of a value: outputs of the feed-through are their inputs, one reference before. */
static size_t place(const Model *model, fmi2ValueReference reference)
{
    const int passed_on = model->which == FEEDTHROUGH && reference > 0 && reference % 2 == 0 && reference <= 12;
    return reference - (size_t)passed_on;
}

#define VALUES(kind, type)                                                                                             \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[])                   \
    {                                                                                                                  \
        for (size_t i = 0; i < n; i++) {                                                                               \
            value[i] = (type)((Model *)c)->v[place(c, vr[i])];                                                         \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }                                                                                                                  \
    fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[])             \
    {                                                                                                                  \
        for (size_t i = 0; i < n; i++) {                                                                               \
            ((Model *)c)->v[vr[i]] = (double)value[i];                                                                 \
        }                                                                                                              \
        return fmi2OK;                                                                                                 \
    }
VALUES(Real, fmi2Real)
VALUES(Integer, fmi2Integer)
VALUES(Boolean, fmi2Boolean)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    for (size_t i = 0; i < n; i++) {
        value[i] = ((Model *)c)->text[place(c, vr[i])];
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    for (size_t i = 0; i < n; i++) {
        snprintf(((Model *)c)->text[vr[i]], TEXT, "%s", value[i]);
    }
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((Model *)c)->v[VR_TIME] = time;
    return fmi2OK;
}

/* Count as far as time has come; the stairs end with the last one. */
static void count(Model *model)
{
    if (model->which == STAIR) {
        model->v[VR_COUNT] = fmin(floor(model->v[VR_TIME] + 1e-9) + 1.0, LAST);
        model->ended = model->v[VR_COUNT] >= LAST;
    }
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    Model *model = c;
    count(model);
    memset(info, 0, sizeof *info);
    info->terminateSimulation = model->ended;
    info->nextEventTimeDefined = model->which == STAIR && !model->ended;
    info->nextEventTime = model->v[VR_COUNT];
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_way_back, fmi2Boolean *event,
                                       fmi2Boolean *terminate)
{
    (void)c;
    (void)no_way_back;
    *event = *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    (void)c;
    (void)x;
    return n == 0 ? fmi2OK : fmi2Error;
}

#define NO_STATES(name)                                                                                                \
    fmi2Status name(fmi2Component c, fmi2Real x[], size_t n)                                                           \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        (void)x;                                                                                                       \
        return n == 0 ? fmi2OK : fmi2Error;                                                                            \
    }
NO_STATES(fmi2GetContinuousStates)
NO_STATES(fmi2GetDerivatives)
NO_STATES(fmi2GetNominalsOfContinuousStates)

/* ---- Co-Simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_way_back)
{
    Model *model = c;
    (void)no_way_back;
    if (model->ended) {
        return fmi2Error; /* it has said that it ends */
    }
    model->v[VR_TIME] = time + step;
    if (model->which == STAIR && time + step > LAST - 1 + 1e-9) {
        model->v[VR_TIME] = LAST - 1;
        model->ended = 1;
    }
    const int ended = model->ended;
    count(model);
    model->ended = ended;
    return ended ? fmi2Discard : fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = ((Model *)c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = ((Model *)c)->v[VR_TIME];
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}

#define NO_STATUS(kind, type)                                                                                          \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2StatusKind asked, type *value)                                 \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        (void)asked;                                                                                                   \
        (void)value;                                                                                                   \
        return fmi2Discard;                                                                                            \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(StringStatus, fmi2String)

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)c;
    (void)vr;
    (void)order;
    (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    (void)c;
    (void)vr;
    (void)order;
    (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
