/* reference3.c: small models with one subject each, of FMI 3.0, for Model Exchange and Co-Simulation.
 *
 * Which is chosen by the token: "{reference-stair}" counts 1, 2, ... at every second and ends its run when the count
 * reaches 10; "{reference-resource}" reads its output from resources/y.txt; "{reference-feedthrough}" passes values of
 * every type on, from each odd value reference to the next one; "{reference-space}" is dx/dt = A x + B u, y = C x + D u
 * with sizes that are structural parameters; "{reference-clocks}" counts the ticks of a periodic clock and of a
 * triggered one. In Co-Simulation an own step is 1 ms, by the classical method of Runge and Kutta.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

typedef enum { STAIR, RESOURCE, FEEDTHROUGH, SPACE, CLOCKS, N_MODELS } Which;
static const char *const names[N_MODELS] = {"stair", "resource", "feedthrough", "space", "clocks"};

enum { N_VALUES = 40, TEXT = 64, MOST = 5, LAST = 10, VR_COUNT = 1, VR_SLOWER = 2, VR_PERIODIC = 3, VR_TRIGGERED = 4 };
/* The feed-through's references of strings and of binaries. */
enum { VR_STRING = 25, VR_BINARY = 27 };
/* The state space: its sizes, its arrays in the order of their references. */
enum { VR_M = 1, VR_N = 2, VR_R = 3, VR_A = 4, VR_B, VR_C, VR_D, VR_X0, VR_U, VR_Y, VR_X, VR_DER_X, N_ARRAYS = 9 };

typedef enum { INSTANTIATED, CONFIGURING, INITIALISING, EVENT, CONTINUOUS, STEPPING } Mode;

typedef struct {
    Which which;
    Mode mode;
    bool exchange, events, ended, ticks[2];
    double v[N_VALUES];
    double array[N_ARRAYS][MOST * MOST];
    char text[TEXT];
    unsigned char bytes[TEXT];
    size_t n_bytes;
} Model;

static fmi3Status said(bool allowed)
{
    return allowed ? fmi3OK : fmi3Error;
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* ---- life ---- */

static void set_up(Model *model)
{
    memset(model->v, 0, sizeof model->v);
    model->mode = INSTANTIATED;
    model->ended = false;
    model->v[VR_COUNT] = model->which == STAIR ? 1.0 : 0.0;
    snprintf(model->text, TEXT, "Set me!");
    memcpy(model->bytes, "foo", 3);
    model->n_bytes = 3;
    if (model->which == SPACE) {
        model->v[VR_M] = model->v[VR_R] = 1.0;
        model->v[VR_N] = 2.0;
        static const double A[] = {-1.0, 2.0, -2.0, -1.0}, B[] = {1.0, 0.0}, C[] = {0.0, 1.0};
        memcpy(model->array[VR_A - VR_A], A, sizeof A);
        memcpy(model->array[VR_B - VR_A], B, sizeof B);
        memcpy(model->array[VR_C - VR_A], C, sizeof C);
    }
}

static bool read_resource(const char *folder, double *value)
{
    char name[4096];
    if (folder == NULL || snprintf(name, sizeof name, "%sy.txt", folder) >= (int)sizeof name) {
        return false;
    }
    FILE *file = fopen(name, "r");
    if (file == NULL) {
        return false;
    }
    *value = fgetc(file);
    fclose(file);
    return true;
}

static Model *model_new(fmi3String token, fmi3String resources, bool exchange, bool events)
{
    Model *model = NULL;
    for (int i = 0; i < N_MODELS; i++) {
        char wanted[TEXT];
        snprintf(wanted, sizeof wanted, "{reference-%s}", names[i]);
        if (strcmp(token, wanted) == 0 && (model = calloc(1, sizeof *model)) != NULL) {
            model->which = (Which)i;
            set_up(model);
        }
    }
    if (model != NULL && model->which == RESOURCE && !read_resource(resources, &model->v[VR_COUNT])) {
        free(model);
        return NULL;
    }
    if (model != NULL) {
        model->exchange = exchange;
        model->events = events;
    }
    return model;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name;
    (void)visible;
    (void)logging;
    (void)environment;
    (void)log;
    return model_new(token, resources, true, true);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)name;
    (void)visible;
    (void)logging;
    (void)early_return;
    (void)required;
    (void)n_required;
    (void)environment;
    (void)log;
    (void)update;
    return model_new(token, resources, false, event_mode);
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    Model *model = instance;
    const double resource = model->v[VR_COUNT];
    set_up(model);
    model->v[VR_COUNT] = model->which == RESOURCE ? resource : model->v[VR_COUNT];
    return fmi3OK;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)instance;
    (void)on;
    (void)n;
    (void)categories;
    return fmi3OK;
}

static fmi3Status go(fmi3Instance instance, Mode from, Mode to)
{
    Model *model = instance;
    const bool allowed = model->mode == from;
    model->mode = allowed ? to : model->mode;
    return said(allowed);
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return go(instance, INSTANTIATED, CONFIGURING);
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return go(instance, CONFIGURING, INSTANTIATED);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean told, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop)
{
    (void)told;
    (void)tolerance;
    (void)stops;
    (void)stop;
    ((Model *)instance)->v[0] = start;
    return go(instance, INSTANTIATED, INITIALISING);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Model *model = instance;
    if (model->which == SPACE) {
        memcpy(model->array[VR_X - VR_A], model->array[VR_X0 - VR_A], sizeof model->array[0]);
    }
    return go(instance, INITIALISING, model->events ? EVENT : STEPPING);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    Model *model = instance;
    return model->events ? go(instance, model->exchange ? CONTINUOUS : STEPPING, EVENT) : fmi3Error;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return ((Model *)instance)->exchange ? go(instance, EVENT, CONTINUOUS) : fmi3Error;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return ((Model *)instance)->exchange ? fmi3Error : go(instance, EVENT, STEPPING);
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

/* ---- the state space ---- */

static size_t size_of(const Model *model, fmi3ValueReference reference)
{
    const size_t m = (size_t)model->v[VR_M], n = (size_t)model->v[VR_N], r = (size_t)model->v[VR_R];
    const size_t sizes[N_ARRAYS] = {n * n, n * m, r * n, r * m, n, m, r, n, n};
    return model->which == SPACE && reference >= VR_A && reference <= VR_DER_X ? sizes[reference - VR_A] : 1;
}

static void evaluate(Model *model)
{
    if (model->which != SPACE) {
        return;
    }
    const size_t m = (size_t)model->v[VR_M], n = (size_t)model->v[VR_N], r = (size_t)model->v[VR_R];
    double(*a)[MOST * MOST] = model->array;
    const double *u = a[VR_U - VR_A], *x = a[VR_X - VR_A];
    double *y = a[VR_Y - VR_A], *dx = a[VR_DER_X - VR_A];
    for (size_t i = 0; i < n; i++) {
        dx[i] = 0.0;
        for (size_t j = 0; j < n; j++) {
            dx[i] += a[VR_A - VR_A][i * n + j] * x[j];
        }
        for (size_t j = 0; j < m; j++) {
            dx[i] += a[VR_B - VR_A][i * m + j] * u[j];
        }
    }
    for (size_t i = 0; i < r; i++) {
        y[i] = 0.0;
        for (size_t j = 0; j < n; j++) {
            y[i] += a[VR_C - VR_A][i * n + j] * x[j];
        }
        for (size_t j = 0; j < m; j++) {
            y[i] += a[VR_D - VR_A][i * m + j] * u[j];
        }
    }
}

static size_t n_states(const Model *model)
{
    return model->which == SPACE ? (size_t)model->v[VR_N] : 0;
}

/* ---- values ---- */

/* Where a value lies: outputs of the feed-through are their inputs, one reference before. */
static double *place(Model *model, fmi3ValueReference reference)
{
    if (model->which == SPACE && reference >= VR_A && reference <= VR_DER_X) {
        return model->array[reference - VR_A];
    }
    const bool passed_on = model->which == FEEDTHROUGH && reference > 0 && reference % 2 == 0;
    return &model->v[(passed_on ? reference - 1 : reference) % N_VALUES];
}

/* Sizes may be set while it is configured only. */
static bool may_set(const Model *model, fmi3ValueReference reference)
{
    const bool is_size = model->which == SPACE && reference >= VR_M && reference <= VR_R;
    return is_size == (model->mode == CONFIGURING);
}

/* Whole numbers of 64 bits lie there bit by bit, since a double has 53; the sizes of SPACE are small. */
#define BITS(model, kind) ((model)->which == FEEDTHROUGH && sizeof(fmi3##kind) == 8 && (fmi3##kind)0.5 == 0)

#define VALUES(kind)                                                                                                   \
    fmi3Status fmi3Get##kind(fmi3Instance instance, const fmi3ValueReference references[], size_t n,                   \
                             fmi3##kind values[], size_t n_values)                                                     \
    {                                                                                                                  \
        Model *model = instance;                                                                                       \
        size_t k = 0;                                                                                                  \
        evaluate(model);                                                                                               \
        for (size_t i = 0; i < n; i++) {                                                                               \
            for (size_t j = 0; j < size_of(model, references[i]) && k < n_values; j++) {                               \
                const double *held = &place(model, references[i])[j];                                                  \
                values[k] = (fmi3##kind)*held;                                                                         \
                if (BITS(model, kind)) {                                                                               \
                    memcpy(&values[k], held, sizeof *held);                                                            \
                }                                                                                                      \
                k++;                                                                                                   \
            }                                                                                                          \
        }                                                                                                              \
        return said(k == n_values);                                                                                    \
    }                                                                                                                  \
    fmi3Status fmi3Set##kind(fmi3Instance instance, const fmi3ValueReference references[], size_t n,                   \
                             const fmi3##kind values[], size_t n_values)                                               \
    {                                                                                                                  \
        Model *model = instance;                                                                                       \
        size_t k = 0;                                                                                                  \
        bool allowed = true;                                                                                           \
        for (size_t i = 0; i < n; i++) {                                                                               \
            allowed = allowed && may_set(model, references[i]);                                                        \
            for (size_t j = 0; allowed && j < size_of(model, references[i]) && k < n_values; j++) {                    \
                double *held = &place(model, references[i])[j];                                                        \
                *held = (double)values[k];                                                                             \
                if (BITS(model, kind)) {                                                                               \
                    memcpy(held, &values[k], sizeof *held);                                                            \
                }                                                                                                      \
                k++;                                                                                                   \
            }                                                                                                          \
        }                                                                                                              \
        return said(allowed && k == n_values);                                                                         \
    }
VALUES(Float32)
VALUES(Float64)
VALUES(Int8)
VALUES(UInt8)
VALUES(Int16)
VALUES(UInt16)
VALUES(Int32)
VALUES(UInt32)
VALUES(Int64)
VALUES(UInt64)
VALUES(Boolean)

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3String values[],
                         size_t n_values)
{
    (void)references;
    for (size_t i = 0; i < n && i < n_values; i++) {
        values[i] = ((Model *)instance)->text;
    }
    return fmi3OK;
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                         const fmi3String values[], size_t n_values)
{
    for (size_t i = 0; i < n && i < n_values; i++) {
        if (references[i] != VR_STRING) {
            return fmi3Error;
        }
        snprintf(((Model *)instance)->text, TEXT, "%s", values[i]);
    }
    return fmi3OK;
}

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t n_values)
{
    (void)references;
    for (size_t i = 0; i < n && i < n_values; i++) {
        values[i] = ((Model *)instance)->bytes;
        sizes[i] = ((Model *)instance)->n_bytes;
    }
    return fmi3OK;
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values)
{
    Model *model = instance;
    for (size_t i = 0; i < n && i < n_values; i++) {
        if (references[i] != VR_BINARY || sizes[i] > TEXT) {
            return fmi3Error;
        }
        memcpy(model->bytes, values[i], sizes[i]);
        model->n_bytes = sizes[i];
    }
    return fmi3OK;
}

/* ---- clocks: references VR_PERIODIC, of 1 s, and VR_TRIGGERED ---- */

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                        const fmi3Clock values[])
{
    Model *model = instance;
    bool allowed = model->which == CLOCKS && model->mode == EVENT;
    for (size_t i = 0; i < n; i++) {
        allowed = allowed && references[i] >= VR_PERIODIC && references[i] <= VR_TRIGGERED;
        if (allowed) {
            model->ticks[references[i] - VR_PERIODIC] = values[i];
        }
    }
    return said(allowed);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Clock values[])
{
    const Model *model = instance;
    bool allowed = model->which == CLOCKS && model->mode == EVENT;
    for (size_t i = 0; i < n; i++) {
        allowed = allowed && references[i] >= VR_PERIODIC && references[i] <= VR_TRIGGERED;
        values[i] = allowed && model->ticks[references[i] - VR_PERIODIC];
    }
    return said(allowed);
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    (void)instance;
    for (size_t i = 0; i < n; i++) {
        intervals[i] = 1.0;
        qualifiers[i] = references[i] == VR_PERIODIC ? fmi3IntervalUnchanged : fmi3IntervalNotYetKnown;
    }
    return fmi3OK;
}

/* ---- events ---- */

/* Count as far as time has come; the stairs end with the last one. */
static void count(Model *model)
{
    if (model->which == STAIR) {
        model->v[VR_COUNT] = fmin(floor(model->v[0] + 1e-9) + 1.0, LAST);
        model->ended = model->v[VR_COUNT] >= LAST;
    }
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *timed, fmi3Float64 *next)
{
    Model *model = instance;
    count(model);
    for (int i = 0; i < 2 && model->which == CLOCKS; i++) {
        model->v[VR_COUNT + i] += model->ticks[i];
        model->ticks[i] = false;
    }
    *again = *nominals = *states = false;
    *terminate = model->ended;
    *timed = model->which == STAIR && !model->ended;
    *next = model->v[VR_COUNT];
    return said(model->mode == EVENT);
}

/* ---- Model Exchange ---- */

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    ((Model *)instance)->v[0] = time;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_way_back, fmi3Boolean *event,
                                       fmi3Boolean *terminate)
{
    (void)instance;
    (void)no_way_back;
    *event = *terminate = false;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    *n = n_states(instance);
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    (void)instance;
    *n = 0;
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 z[], size_t n)
{
    (void)instance;
    (void)z;
    return said(n == 0);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    Model *model = instance;
    if (n != n_states(model)) {
        return fmi3Error;
    }
    memcpy(model->array[VR_X - VR_A], x, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    Model *model = instance;
    if (n != n_states(model)) {
        return fmi3Error;
    }
    memcpy(x, model->array[VR_X - VR_A], n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t n)
{
    Model *model = instance;
    if (n != n_states(model)) {
        return fmi3Error;
    }
    evaluate(model);
    memcpy(dx, model->array[VR_DER_X - VR_A], n * sizeof *dx);
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    (void)instance;
    for (size_t i = 0; i < n; i++) {
        x[i] = 1.0;
    }
    return fmi3OK;
}

/* ---- saved states: the whole model ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    if (*state == NULL && (*state = malloc(sizeof(Model))) == NULL) {
        return fmi3Error;
    }
    memcpy(*state, instance, sizeof(Model));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    memcpy(instance, state, sizeof(Model));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

/* ---- Co-Simulation ---- */

static void advance(Model *model, double h)
{
    const size_t n = n_states(model);
    double *x = model->array[VR_X - VR_A], *dx = model->array[VR_DER_X - VR_A];
    double old[MOST] = {0}, sum[MOST] = {0};
    static const double ahead[] = {0.5, 0.5, 1.0, 0.0}, weight[] = {1.0, 2.0, 2.0, 1.0};
    memcpy(old, x, n * sizeof *x);
    for (int stage = 0; stage < 4; stage++) {
        evaluate(model);
        for (size_t i = 0; i < n; i++) {
            sum[i] += weight[stage] * dx[i];
            x[i] = old[i] + ahead[stage] * h * dx[i];
        }
    }
    for (size_t i = 0; i < n; i++) {
        x[i] = old[i] + h / 6.0 * sum[i];
    }
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_way_back,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Model *model = instance;
    (void)no_way_back;
    if (model->mode != STEPPING || model->ended || fabs(time - model->v[0]) > 1e-9 * (1.0 + fabs(time))) {
        return fmi3Error;
    }
    const int n = (int)ceil(step / 1e-3 - 1e-9);
    for (int i = 0; i < n && model->which == SPACE; i++) {
        advance(model, step / n);
    }
    model->v[0] = time + step;
    const double before = model->v[VR_COUNT];
    count(model);
    if (model->ended) {
        model->v[0] = LAST - 1;
    }
    *event = model->events && model->which == STAIR && before < model->v[VR_COUNT];
    *terminate = model->ended;
    *early = model->v[0] < time + step;
    *reached = model->v[0];
    return fmi3OK;
}
