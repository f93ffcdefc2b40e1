/* mimics.c: FMUs of FMI 2.0 that behave as known exporters' do, or as FMI allows and few expect.
 *
 * All are one oscillator, dx/dt = v, dv/dt = c (u - x) - d v, y = x. All keep FMI's state machine: a call that its mode
 * does not allow is an error. How each behaves is chosen by the GUID, "{mimic-NAME}":
 *   plain        nothing unusual
 *   dymola       sets no time but in continuous-time mode and gives nothing before initialisation; in Co-Simulation a
 *                multistep method that is not restarted when an input jumps
 *   simulink     Co-Simulation of explicit Euler with a fixed step of 0.01 s; outputs are those of its last own step
 *   unlike       x is of the order 1e-9, v of the order 1e9, and the nominal values say so
 *   silent       the same, and the nominal values say 1
 *   tool         cannot be instantiated: its tool is not there
 *   warns        returns "warning" from every call
 *   nominals     refuses to tell its nominal values
 *   formats      logs with formats and arguments, in a category that it does not declare
 *   memory       takes its memory from the callbacks
 *   fast         was compiled with -ffast-math: tiny numbers are zero for the whole process from then on
 *   handles      sets a handler of a signal, as run-time systems of other languages do
 *   overshoots   Co-Simulation of Runge and Kutta's method with a fixed step of 0.01 s; the first that ends at or after the
 *                communication point is its last
 *   insists      Co-Simulation: refuses every communication step but 0.01 s
 *   slow         takes 2 ms for each of its own steps, of 1 ms
 *   finishes     Co-Simulation: goes no further than 2 s, unless it is told another stop time
 *   undefined    y is not a number from 0.5 s on
 *   discards     discards derivatives at trial points far from the last step
 *   resources    cannot be instantiated where the folder of its resources is not there, empty as it is
 *   repeats      takes a step that it is not promised to be final for one that is to be made again
 *   statics      has what only one instance can use; a second one in the same copy of the code ends the process
 */
#define _POSIX_C_SOURCE 199309L /* nanosleep */

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "fmi2Functions.h"

#if defined __x86_64__
#include <xmmintrin.h>
#endif

typedef enum {
    PLAIN, DYMOLA, SIMULINK, UNLIKE, SILENT, TOOL, WARNS, NOMINALS, FORMATS, MEMORY, FAST, HANDLES, DISCARDS,
    FORGETS, RESOURCES, REPEATS, STATICS, OVERSHOOTS, SLOW, FINISHES, UNDEFINED, INSISTS, N_WAYS
} Way;
static const char *const names[N_WAYS] = {"plain",    "dymola",  "simulink", "unlike", "silent",  "tool",    "warns",
                                          "nominals", "formats", "memory",   "fast",   "handles", "discards",
                                          "forgets",  "resources", "repeats", "statics",
                                          "overshoots", "slow", "finishes", "undefined", "insists"};

/* As in OpenModelica's runtime, where it holds a thread-specific key; here none was taken, as in co-simulation there. */
__attribute__((visibility("default"))) unsigned mmc_thread_data_key;

enum { VR_TIME, VR_U, VR_X, VR_V, VR_DER_X, VR_DER_V, VR_Y, VR_C, VR_D, N_VALUES, NX = 2 };
static const double START[N_VALUES] = {[VR_U] = 1.0, [VR_C] = 100.0, [VR_D] = 4.0};
static const double OWN_STEP = 1e-3;    /* of the integrators in Co-Simulation [s] */
static const double FIXED_STEP = 1e-2;  /* of "simulink", "overshoots" and "insists" [s] */
static const double FAR = 0.5;          /* of "discards": from v at the last completed step */

typedef enum { INSTANTIATED, INITIALISING, EVENT, CONTINUOUS, STEPPING, ENDED } Mode;

typedef struct {
    Way way;
    Mode mode;
    int exchange;             /* Model Exchange */
    int started;              /* the multistep method has a slope */
    double slope[NX];         /* of its last own step */
    double accepted;          /* v at the last completed step */
    double scale[NX];
    double shown;             /* y of "simulink" */
    double reached;           /* time of "overshoots": of its last own step */
    double finish;            /* of "finishes" [s] */
    double before[NX];        /* states at the begin of the last step */
    double v[N_VALUES];
    const fmi2CallbackFunctions *callbacks;
} Model;

#define FMI2_STUB_OWN_LIFE
#define FMI2_STUB_OWN_MODES
#include "fmi2_stub.h"

static fmi2Status said(const Model *model, int allowed)
{
    if (!allowed) {
        model->callbacks->logger(model->callbacks->componentEnvironment, "mimic", fmi2Error, "logStatusError",
                                 "this call is not allowed in mode %d", (int)model->mode);
        return fmi2Error;
    }
    return model->way == WARNS ? fmi2Warning : fmi2OK;
}

static fmi2Status go(fmi2Component c, Mode from, Mode to)
{
    Model *model = c;
    const fmi2Status status = said(model, model->mode == from);
    model->mode = status == fmi2Error ? model->mode : to;
    return status;
}

/* ---- life ---- */

static void set_up(Model *model)
{
    memcpy(model->v, START, sizeof model->v);
    model->started = 0;
    model->accepted = 0.0;
    model->mode = INSTANTIATED;
}

static void handle(int number)
{
    (void)number;
}

static void be_fast(void)
{
#if defined __x86_64__
    _mm_setcsr(_mm_getcsr() | 0x8040);
#elif defined __aarch64__
    unsigned long long control = 0;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    control |= 1ULL << 24;
    __asm__ volatile("msr fpcr, %0" : : "r"(control));
#endif
}

static int is_folder(const char *uri)
{
    struct stat found;
    const size_t scheme = strlen("file://");
    return strlen(uri) > scheme && stat(uri + scheme, &found) == 0 && S_ISDIR(found.st_mode);
}

static int taken; /* "statics": the one instance */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    const Way way = (Way)chosen(guid, "mimic", names, N_WAYS);
    (void)visible;
    (void)logging;
    if (way == N_WAYS) {
        return NULL;
    }
    if (way == TOOL) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError",
                          "the simulator MimicTool is not installed on this machine");
        return NULL;
    }
    if (way == RESOURCES && !is_folder(location)) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError",
                          "the folder %s does not exist", location);
        return NULL;
    }
    if (way == STATICS && taken++) {
        abort();
    }
    Model *model = way == MEMORY ? callbacks->allocateMemory(1, sizeof *model) : calloc(1, sizeof *model);
    if (model == NULL) {
        return NULL;
    }
    model->way = way;
    model->exchange = type == fmi2ModelExchange;
    model->callbacks = callbacks;
    const int odd = way == UNLIKE || way == SILENT;
    model->scale[0] = odd ? 1e-9 : 1.0;
    model->scale[1] = odd ? 1e9 : 1.0;
    set_up(model);
    if (way == FORMATS) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2OK, "Ünlisted", "%s has #r%u# = %g, 100%%", name,
                          (unsigned)VR_C, model->v[VR_C]);
    } else if (way == FAST) {
        be_fast();
    } else if (way == HANDLES) {
        signal(SIGFPE, handle);
    }
    return model;
}

void fmi2FreeInstance(fmi2Component c)
{
    Model *model = c;
    if (model != NULL && model->way == MEMORY) {
        model->callbacks->freeMemory(model);
    } else {
        free(model);
    }
}

fmi2Status fmi2Reset(fmi2Component c)
{
    set_up(c);
    return said(c, 1);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)controlled;
    (void)tolerance;
    Model *model = c;
    model->finish = stop_defined ? stop : 2.0;
    if (model->way == FORGETS) {
        model->v[VR_C] = START[VR_C];
        model->v[VR_D] = START[VR_D];
    }
    model->v[VR_TIME] = model->reached = start;
    return said(model, model->mode == INSTANTIATED);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    return go(c, INSTANTIATED, INITIALISING);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Model *model = c;
    model->shown = model->v[VR_X];
    model->accepted = model->v[VR_V];
    memcpy(model->before, &model->v[VR_X], sizeof model->before);
    return go(c, INITIALISING, model->exchange ? EVENT : STEPPING);
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    return go(c, CONTINUOUS, EVENT);
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    return go(c, EVENT, CONTINUOUS);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Model *model = c;
    const int running = model->mode == EVENT || model->mode == CONTINUOUS || model->mode == STEPPING;
    const fmi2Status status = said(model, running);
    model->mode = ENDED;
    return status;
}

/* ---- values ---- */

static void evaluate(Model *model)
{
    double *v = model->v;
    v[VR_DER_X] = v[VR_V];
    v[VR_DER_V] = v[VR_C] * (v[VR_U] - v[VR_X]) - v[VR_D] * v[VR_V];
    v[VR_Y] = model->way == SIMULINK && !model->exchange && model->mode == STEPPING ? model->shown : v[VR_X];
    if (model->way == UNDEFINED && v[VR_TIME] >= 0.5) {
        v[VR_Y] = NAN;
    }
}

static double scale_of(const Model *model, fmi2ValueReference reference)
{
    switch (reference) {
    case VR_X:
    case VR_DER_X:
        return model->scale[0];
    case VR_V:
    case VR_DER_V:
        return model->scale[1];
    default:
        return 1.0;
    }
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *model = c;
    evaluate(model);
    for (size_t i = 0; i < n; i++) {
        value[i] = model->v[vr[i]] * scale_of(model, vr[i]);
    }
    return said(model, model->mode != INSTANTIATED);
}

/* Parameters and states before the end of initialisation, the input and c at any time. */
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Model *model = c;
    int allowed = model->mode != ENDED;
    for (size_t i = 0; i < n; i++) {
        const int early = model->mode == INSTANTIATED || model->mode == INITIALISING;
        const int tunable = vr[i] == VR_C && model->mode != CONTINUOUS;
        allowed = allowed && (early || vr[i] == VR_U || tunable);
    }
    const fmi2Status status = said(model, allowed);
    for (size_t i = 0; status != fmi2Error && i < n; i++) {
        model->v[vr[i]] = value[i] / scale_of(model, vr[i]);
    }
    return status;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    Model *model = c;
    model->v[VR_TIME] = time;
    return said(model, model->mode == CONTINUOUS || (model->mode == EVENT && model->way != DYMOLA));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    memset(info, 0, sizeof *info);
    ((Model *)c)->accepted = ((Model *)c)->v[VR_V];
    return said(c, ((Model *)c)->mode == EVENT);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_way_back, fmi2Boolean *event,
                                       fmi2Boolean *terminate)
{
    (void)no_way_back;
    *event = *terminate = fmi2False;
    ((Model *)c)->accepted = ((Model *)c)->v[VR_V];
    return said(c, ((Model *)c)->mode == CONTINUOUS);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    Model *model = c;
    for (size_t i = 0; i < n && i < NX; i++) {
        model->v[VR_X + i] = x[i] / model->scale[i];
    }
    return said(model, model->mode == CONTINUOUS && n == NX);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    const Model *model = c;
    for (size_t i = 0; i < n && i < NX; i++) {
        x[i] = model->v[VR_X + i] * model->scale[i];
    }
    return said(model, n == NX);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    Model *model = c;
    evaluate(model);
    for (size_t i = 0; i < n && i < NX; i++) {
        dx[i] = model->v[VR_DER_X + i] * model->scale[i];
    }
    if (model->way == DISCARDS && model->mode == CONTINUOUS && fabs(model->v[VR_V] - model->accepted) > FAR) {
        return fmi2Discard;
    }
    return said(model, n == NX);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    const Model *model = c;
    for (size_t i = 0; i < n && i < NX; i++) {
        x[i] = model->way == SILENT ? 1.0 : model->scale[i];
    }
    return said(model, model->way != NOMINALS && n == NX);
}

/* Of the two equations and of y only: an output that is the state x itself answers 0, as those of Reference FMUs do. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    const Model *model = c;
    double dx = 0.0, dv = 0.0, du = 0.0;
    for (size_t j = 0; j < n_known; j++) {
        dx += known[j] == VR_X ? seed[j] / model->scale[0] : 0.0;
        dv += known[j] == VR_V ? seed[j] / model->scale[1] : 0.0;
        du += known[j] == VR_U ? seed[j] : 0.0;
    }
    for (size_t i = 0; i < n_unknown; i++) {
        const double ddv = model->v[VR_C] * (du - dx) - model->v[VR_D] * dv;
        const double answer = unknown[i] == VR_DER_X ? dv : unknown[i] == VR_DER_V ? ddv : unknown[i] == VR_Y ? dx : 0.0;
        sensitivity[i] = answer * scale_of(model, unknown[i]);
    }
    return said(model, model->mode != INSTANTIATED);
}

/* ---- Co-Simulation ---- */

static void advance(Model *model, double h)
{
    if (model->way == SLOW) {
        nanosleep(&(struct timespec){.tv_nsec = 2000000}, NULL);
    }
    evaluate(model);
    const double now[NX] = {model->v[VR_DER_X], model->v[VR_DER_V]};
    if (model->way == SIMULINK) {
        model->shown = model->v[VR_X];
        for (int i = 0; i < NX; i++) {
            model->v[VR_X + i] += h * now[i];
        }
        return;
    }
    if (model->way == DYMOLA) { /* Adams-Bashforth of order two, across the jumps of its input */
        for (int i = 0; i < NX; i++) {
            model->v[VR_X + i] += h * (model->started ? 1.5 * now[i] - 0.5 * model->slope[i] : now[i]);
            model->slope[i] = now[i];
        }
        model->started = 1;
        return;
    }
    const double x[NX] = {model->v[VR_X], model->v[VR_V]};
    double sum[NX] = {now[0], now[1]};
    static const double ahead[] = {0.5, 0.5, 1.0}, weight[] = {2.0, 2.0, 1.0};
    for (int stage = 0; stage < 3; stage++) { /* the classical method of Runge and Kutta */
        const double slope[NX] = {model->v[VR_DER_X], model->v[VR_DER_V]};
        for (int i = 0; i < NX; i++) {
            model->v[VR_X + i] = x[i] + ahead[stage] * h * slope[i];
        }
        evaluate(model);
        sum[0] += weight[stage] * model->v[VR_DER_X];
        sum[1] += weight[stage] * model->v[VR_DER_V];
    }
    for (int i = 0; i < NX; i++) {
        model->v[VR_X + i] = x[i] + h / 6.0 * sum[i];
    }
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_way_back)
{
    Model *model = c;
    if (model->way == REPEATS && !no_way_back) {
        memcpy(&model->v[VR_X], model->before, sizeof model->before);
    }
    memcpy(model->before, &model->v[VR_X], sizeof model->before);
    const fmi2Status status =
        said(model, model->mode == STEPPING && (model->way != FINISHES || time + step < model->finish + 1e-9) &&
                        (model->way != INSISTS || fabs(step - FIXED_STEP) < 1e-9) &&
                        fabs(time - model->v[VR_TIME]) < 1e-6 * (1.0 + fabs(time)));
    if (status == fmi2Error) {
        return status;
    }
    const double end = time + step, own = model->way == SIMULINK ? FIXED_STEP : OWN_STEP;
    if (model->way == SIMULINK) { /* whole steps of its own, as many as end before or at the point */
        double now = model->v[VR_TIME];
        while (now + 0.5 * own < end) {
            advance(model, own);
            now += own;
        }
    } else if (model->way == OVERSHOOTS) {
        for (; model->reached < end; model->reached += FIXED_STEP) {
            advance(model, FIXED_STEP);
        }
    } else {
        const int n = (int)ceil(step / own - 1e-9);
        for (int i = 0; i < n; i++) {
            advance(model, step / n);
        }
    }
    model->v[VR_TIME] = end;
    return status;
}
