/* prefixed.c: an FMU of FMI 2.0 whose functions have the prefix for static linking, as many exports have: y = GAIN u. */
#define FMI2_FUNCTION_PREFIX prefixed_

#include "fmi2_stub.h"
#include "gain.h"

typedef struct {
    fmi2Real u;
} Model;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name;
    (void)type;
    (void)guid;
    (void)resources;
    (void)functions;
    (void)visible;
    (void)logging;
    return calloc(1, sizeof(Model));
}

void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean told, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends,
                               fmi2Real stop)
{
    (void)c;
    (void)told;
    (void)tolerance;
    (void)start;
    (void)ends;
    (void)stop;
    return fmi2OK;
}

NOTHING_TO_DO(fmi2ExitInitializationMode)

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Model *model = c;
    for (size_t i = 0; i < n; i++) {
        value[i] = vr[i] == 0 ? model->u : GAIN * model->u;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Model *model = c;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != 0) {
            return fmi2Error;
        }
        model->u = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keeps)
{
    (void)c;
    (void)time;
    (void)step;
    (void)keeps;
    return fmi2OK;
}
