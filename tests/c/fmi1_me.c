/* fmi1_me.c: FMI 1.0 for Model Exchange. */
#include "fmi1.h"

void before_discrete(fmi1Component c)
{
    if (((Component *)c)->initialised) {
        fmi2EnterEventMode(inner(c));
    }
}

EXPORT const char *FMI1(fmiGetModelTypesPlatform)(void)
{
    return "standard32";
}

EXPORT fmi1Component FMI1(fmiInstantiateModel)(fmi1String name, fmi1String guid, fmi1CallbackFunctions functions,
                                               fmi1Boolean logging)
{
    return component_new(fmi2ModelExchange, name, guid, "", functions, logging);
}

EXPORT void FMI1(fmiFreeModelInstance)(fmi1Component c)
{
    component_free(c);
}

EXPORT fmi1Status FMI1(fmiSetTime)(fmi1Component c, fmi1Real time)
{
    Component *component = c;
    component->time = time;
    return component->initialised ? (fmi1Status)fmi2SetTime(component->inner, time) : fmi1OK;
}

EXPORT fmi1Status FMI1(fmiSetContinuousStates)(fmi1Component c, const fmi1Real x[], size_t nx)
{
    return (fmi1Status)fmi2SetContinuousStates(inner(c), x, nx);
}

EXPORT fmi1Status FMI1(fmiCompletedIntegratorStep)(fmi1Component c, fmi1Boolean *call_event_update)
{
    fmi2Boolean event = fmi2False;
    fmi2Boolean terminate = fmi2False;
    fmi2Status status = fmi2CompletedIntegratorStep(inner(c), fmi2True, &event, &terminate);
    *call_event_update = event != fmi2False ? fmi1True : fmi1False;
    return (fmi1Status)status;
}

static void report(const fmi2EventInfo *found, fmi1EventInfo *info, int jumped)
{
    info->iterationConverged = found->newDiscreteStatesNeeded ? fmi1False : fmi1True;
    info->stateValueReferencesChanged = fmi1False;
    info->stateValuesChanged = jumped ? fmi1True : fmi1False;
    info->terminateSimulation = found->terminateSimulation ? fmi1True : fmi1False;
    info->upcomingTimeEvent = found->nextEventTimeDefined ? fmi1True : fmi1False;
    info->nextEventTime = found->nextEventTime;
}

/* To the end, or one iteration where the environment wants to see intermediate results. */
static fmi1Status iterate(fmi1Component c, fmi1Boolean intermediate, fmi1EventInfo *info)
{
    fmi2EventInfo found = {.newDiscreteStatesNeeded = fmi2True};
    fmi2Status status = fmi2OK;
    int jumped = 0;
    do {
        status = fmi2NewDiscreteStates(inner(c), &found);
        jumped = jumped || found.valuesOfContinuousStatesChanged;
    } while (status <= fmi2Warning && found.newDiscreteStatesNeeded && !intermediate);
    report(&found, info, jumped);
    if (status <= fmi2Warning && !found.newDiscreteStatesNeeded) {
        status = fmi2EnterContinuousTimeMode(inner(c));
    }
    return (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiInitialize)(fmi1Component c, fmi1Boolean controlled, fmi1Real tolerance, fmi1EventInfo *info)
{
    Component *component = c;
    fmi2Status status = fmi2SetupExperiment(component->inner, controlled, tolerance, component->time, fmi2False, 0.0);
    status = status <= fmi2Warning ? fmi2EnterInitializationMode(component->inner) : status;
    status = status <= fmi2Warning ? fmi2ExitInitializationMode(component->inner) : status;
    component->initialised = 1;
    return status <= fmi2Warning ? iterate(c, fmi1False, info) : (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiEventUpdate)(fmi1Component c, fmi1Boolean intermediate, fmi1EventInfo *info)
{
    fmi2Status status = fmi2EnterEventMode(inner(c));
    return status <= fmi2Warning ? iterate(c, intermediate, info) : (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiGetDerivatives)(fmi1Component c, fmi1Real derivatives[], size_t nx)
{
    return (fmi1Status)fmi2GetDerivatives(inner(c), derivatives, nx);
}

EXPORT fmi1Status FMI1(fmiGetEventIndicators)(fmi1Component c, fmi1Real indicators[], size_t ni)
{
    return (fmi1Status)fmi2GetEventIndicators(inner(c), indicators, ni);
}

EXPORT fmi1Status FMI1(fmiGetContinuousStates)(fmi1Component c, fmi1Real x[], size_t nx)
{
    return (fmi1Status)fmi2GetContinuousStates(inner(c), x, nx);
}

EXPORT fmi1Status FMI1(fmiGetNominalContinuousStates)(fmi1Component c, fmi1Real nominal[], size_t nx)
{
    return (fmi1Status)fmi2GetNominalsOfContinuousStates(inner(c), nominal, nx);
}

EXPORT fmi1Status FMI1(fmiGetStateValueReferences)(fmi1Component c, fmi1ValueReference vrx[], size_t nx)
{
    (void)c;
    for (size_t i = 0; i < nx; i++) {
        vrx[i] = model_info.states[i];
    }
    return fmi1OK;
}

EXPORT fmi1Status FMI1(fmiTerminate)(fmi1Component c)
{
    return (fmi1Status)fmi2Terminate(inner(c));
}
