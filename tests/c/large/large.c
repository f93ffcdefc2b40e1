/* large.c: FMUs of FMI 2.0 of any size, whose answers are known, for Model Exchange.
 *
 * The GUID says which and how large: "{large-rod-N}" is a rod of N cells, insulated at its right end, its left end at
 * the temperature u: dT_i/dt = N² (T_i-1 - 2 T_i + T_i+1), y = T_N. "{large-chain-N}" is a chain of N/2 masses on
 * springs between two walls, N even: positions first, then velocities; dv_i/dt = k (q_i-1 - 2 q_i + q_i+1) - c v_i +
 * u at the first mass, k = N²/4, c = 0.2, y = q of the last mass. "{large-cubic-N}" is the chain with a cubic spring to
 * the ground, -0.1 q³, at each mass. "{large-lying-N}" is the rod with one more path, from its last cell to its first,
 * of which its description says nothing.
 *
 * Value references: 0 is u, 1 is y, 2 … N + 1 the states, N + 2 … 2 N + 1 their derivatives.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

typedef enum { ROD, CHAIN, CUBIC, LYING, N_KINDS } Kind;
static const char *const names[N_KINDS] = {"rod", "chain", "cubic", "lying"};

typedef struct {
    Kind kind;
    size_t n;
    double u;
    double x[]; /* [n] states, then room for derivatives */
} Model;

#include "fmi2_stub.h"

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)location, (void)callbacks, (void)visible, (void)logging;
    (void)chosen; /* here the GUID says how large the model is, too */
    for (int kind = 0; kind < N_KINDS; kind++) {
        char begin[32];
        const int length = snprintf(begin, sizeof begin, "{large-%s-", names[kind]);
        if (strncmp(guid, begin, (size_t)length) == 0) {
            const size_t n = strtoul(guid + length, NULL, 10);
            Model *model = calloc(1, sizeof *model + 2 * n * sizeof(double));
            if (model != NULL) {
                model->kind = (Kind)kind;
                model->n = n;
            }
            return model;
        }
    }
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)c, (void)controlled, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi2OK;
}

NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2Reset)

/* Derivatives of states x under u; `linear`: of the linear part at the model's own states. */
static void derive(const Model *m, const double *x, double u, double *dx, int linear)
{
    const size_t n = m->n, half = n / 2;
    if (m->kind == ROD || m->kind == LYING) {
        const double a = (double)n * (double)n;
        for (size_t i = 0; i < n; i++) {
            const double left = i > 0 ? x[i - 1] : u, right = i + 1 < n ? x[i + 1] : x[i];
            dx[i] = a * (left - 2.0 * x[i] + right);
        }
        dx[0] += m->kind == LYING ? 0.25 * a * x[n - 1] : 0.0;
        return;
    }
    const double k = (double)half * (double)half;
    for (size_t i = 0; i < half; i++) {
        const double left = i > 0 ? x[i - 1] : 0.0, right = i + 1 < half ? x[i + 1] : 0.0, q = m->x[i];
        const double ground = m->kind == CUBIC ? 0.1 * (linear ? 3.0 * q * q * x[i] : x[i] * x[i] * x[i]) : 0.0;
        dx[i] = x[half + i];
        dx[half + i] = k * (left - 2.0 * x[i] + right) - 0.2 * x[half + i] - ground + (i == 0 ? u : 0.0);
    }
}

static double output(const Model *m, const double *x)
{
    return m->kind == CHAIN || m->kind == CUBIC ? x[m->n / 2 - 1] : x[m->n - 1];
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *m = c;
    derive(m, m->x, m->u, m->x + m->n, 0);
    for (size_t i = 0; i < n; i++) {
        value[i] = vr[i] == 0 ? m->u : vr[i] == 1 ? output(m, m->x) : m->x[vr[i] - 2];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == 0) {
            m->u = value[i];
        } else if (vr[i] >= 2 && vr[i] < m->n + 2) {
            m->x[vr[i] - 2] = value[i];
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real value[])
{
    Model *m = c;
    double u = 0.0, *dx = m->x + m->n, *x = calloc(m->n, sizeof(double));
    if (x == NULL) {
        return fmi2Error;
    }
    for (size_t i = 0; i < n_known; i++) {
        if (known[i] == 0) {
            u = seed[i];
        } else {
            x[known[i] - 2] = seed[i];
        }
    }
    derive(m, x, u, dx, 1);
    for (size_t i = 0; i < n_unknown; i++) {
        value[i] = unknown[i] == 1 ? output(m, x) : m->x[unknown[i] - 2];
    }
    free(x);
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    (void)c, (void)time;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_earlier, fmi2Boolean *event, fmi2Boolean *end)
{
    (void)c, (void)no_earlier;
    *event = *end = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    memcpy(((Model *)c)->x, x, n * sizeof *x);
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    memcpy(x, ((Model *)c)->x, n * sizeof *x);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    const Model *m = c;
    (void)n;
    derive(m, m->x, m->u, dx, 0);
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    (void)c;
    for (size_t i = 0; i < n; i++) {
        nominal[i] = 1.0;
    }
    return fmi2OK;
}

/* ---- state ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const Model *m = c;
    const size_t size = sizeof *m + 2 * m->n * sizeof(double);
    if (*state == NULL) {
        *state = malloc(size);
    }
    return *state != NULL ? (memcpy(*state, m, size), fmi2OK) : fmi2Error;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Model *m = c;
    memcpy(m, state, sizeof *m + 2 * m->n * sizeof(double));
    return fmi2OK;
}
