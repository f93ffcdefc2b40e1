/* methods.c: a co-simulation FMU of FMI 2.0 that makes one step of a known method of each communication step.
 *
 * dx_i/dt = -RATE_i (x_i - u) for i = 1, 2, y = x_1 + x_2. The GUID it is instantiated with, "{methods-rk4}", tells the
 * method. Closed forms: R(z) of a step is 1 + z (euler), 1 + z + z^2/2 (heun), up to z^4/24 (rk4), 1 / (1 - z)
 * (implicit). "undamped" is Euler's method for an oscillator, "resting" does not move, "slow" sleeps in each step.
 */
#define _POSIX_C_SOURCE 199309L
#include <string.h>
#include <time.h>

#include "fmi2_stub.h"

#define FREQUENCY 5.0  /* [rad/s], of the oscillator */
#define SLEEP 15000000 /* [ns] */

enum { VR_X1, VR_X2, VR_U, VR_Y };

typedef enum { EULER, HEUN, RK4, IMPLICIT, UNDAMPED, RESTING, SLOW, N_METHODS } Method;

static const char *const names[N_METHODS] = {"euler", "heun", "rk4", "implicit", "undamped", "resting", "slow"};
static const double rates[2] = {1.0, 50.0};

typedef struct {
    Method method;
    double x[2], u;
} Model;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    const Method method = (Method)chosen(guid, "methods", names, N_METHODS);
    (void)name, (void)type, (void)location, (void)callbacks, (void)visible, (void)logging;
    Model *m = method == N_METHODS ? NULL : calloc(1, sizeof *m);
    if (m != NULL) {
        m->method = method;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Model *m = c;
    memset(m->x, 0, sizeof m->x);
    m->u = 0.0;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)c, (void)controlled, (void)tolerance, (void)start, (void)stop_defined, (void)stop;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Model *m = c;
    for (size_t i = 0; i < n; i++) {
        value[i] = vr[i] == VR_Y ? m->x[0] + m->x[1] : vr[i] == VR_U ? m->u : m->x[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != VR_U) {
            return fmi2Error;
        }
        ((Model *)c)->u = value[i];
    }
    return fmi2OK;
}

/* R(z) of one step. */
static double factor(Method method, double z)
{
    const double first = 1.0 + z, second = first + z * z / 2.0;
    switch (method) {
    case HEUN:
        return second;
    case RK4:
        return second + z * z * z / 6.0 + z * z * z * z / 24.0;
    case IMPLICIT:
        return 1.0 / (1.0 - z);
    default:
        return first;
    }
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_set)
{
    Model *m = c;
    (void)point, (void)no_set;
    if (m->method == SLOW) {
        nanosleep(&(struct timespec){.tv_nsec = SLEEP}, NULL);
    }
    if (m->method == UNDAMPED) {
        const double x = m->x[0] - m->u, v = m->x[1];
        m->x[0] += size * FREQUENCY * v;
        m->x[1] -= size * FREQUENCY * x;
    } else if (m->method != RESTING) {
        for (int i = 0; i < 2; i++) {
            m->x[i] = m->u + factor(m->method, -rates[i] * size) * (m->x[i] - m->u);
        }
    }
    return fmi2OK;
}
