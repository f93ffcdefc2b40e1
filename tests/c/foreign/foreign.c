/* foreign.c: an FMU of FMI 2.0, dx/dt = u - x and y = x, with the manners of other exporters.
 *
 * How is chosen by the GUID it is instantiated with: "{foreign-plain}" does nothing unusual; "{foreign-strict}" refuses
 * the time outside continuous-time mode, as FMUs of Dymola do; "{foreign-event}" ends its run with the event at
 * t = 0.5; "{foreign-step}" with the first step that reaches t = 0.5. In Co-Simulation both discard the step that
 * crosses 0.5, having gone so far, and say "terminated". A step of Co-Simulation is exact for a held input.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { VR_U, VR_X, VR_DER_X, VR_Y, VR_CLOCK, N_VARIABLES };
typedef enum { PLAIN, STRICT, EVENT, STEP, N_BEHAVIOURS } Behaviour;
static const char *const names[N_BEHAVIOURS] = {"plain", "strict", "event", "step"};
static const double END = 0.5;

typedef struct {
    Behaviour behaviour;
    int continuous, ended;
    double time;
    double v[N_VARIABLES];
} Model;

#define FMI2_STUB_OWN_MODES
#include "fmi2_stub.h"

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    const Behaviour behaviour = (Behaviour)chosen(guid, "foreign", names, N_BEHAVIOURS);
    (void)name;
    (void)type;
    (void)location;
    (void)callbacks;
    (void)visible;
    (void)logging;
    Model *model = behaviour == N_BEHAVIOURS ? NULL : calloc(1, sizeof *model);
    if (model != NULL) {
        model->behaviour = behaviour;
        model->v[VR_U] = 1.0;
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
    ((Model *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    ((Model *)c)->continuous = 0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    ((Model *)c)->continuous = 1;
    return fmi2OK;
}

NOTHING_TO_DO(fmi2ExitInitializationMode)
NOTHING_TO_DO(fmi2Reset)

/* ---- values ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *model = c;
    model->v[VR_DER_X] = model->v[VR_U] - model->v[VR_X];
    model->v[VR_Y] = model->v[VR_X];
    model->v[VR_CLOCK] = model->time;
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

/* ---- Model Exchange ---- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    Model *model = c;
    if (model->behaviour == STRICT && !model->continuous) {
        return fmi2Error;
    }
    model->time = time;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    Model *model = c;
    memset(info, 0, sizeof *info);
    if (model->behaviour == EVENT) {
        info->terminateSimulation = model->time >= END;
        info->nextEventTimeDefined = model->time < END;
        info->nextEventTime = END;
    }
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_way_back, fmi2Boolean *event,
                                       fmi2Boolean *terminate)
{
    Model *model = c;
    (void)no_way_back;
    *event = fmi2False;
    *terminate = model->behaviour == STEP && model->time >= END;
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
    dx[0] = ((Model *)c)->v[VR_U] - ((Model *)c)->v[VR_X];
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    (void)c;
    (void)n;
    x[0] = 1.0;
    return fmi2OK;
}

/* ---- Co-Simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_way_back)
{
    Model *model = c;
    double end = time + step;
    (void)no_way_back;
    model->ended = (model->behaviour == EVENT || model->behaviour == STEP) && end > END + 1e-12;
    end = model->ended ? fmax(time, END) : end;
    model->v[VR_X] = model->v[VR_U] + (model->v[VR_X] - model->v[VR_U]) * exp(-(end - time));
    model->time = end;
    return model->ended ? fmi2Discard : fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    *value = ((Model *)c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    *value = ((Model *)c)->time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}
