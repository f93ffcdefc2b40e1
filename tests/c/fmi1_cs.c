/* fmi1_cs.c: FMI 1.0 for Co-Simulation. */
#include "fmi1.h"

void before_discrete(fmi1Component c)
{
    (void)c; /* the runtime makes the event itself */
}

EXPORT const char *FMI1(fmiGetTypesPlatform)(void)
{
    return "standard32";
}

EXPORT fmi1Component FMI1(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime,
                                               fmi1Real timeout, fmi1Boolean visible, fmi1Boolean interactive,
                                               fmi1CallbackFunctions functions, fmi1Boolean logging)
{
    (void)mime;
    (void)timeout;
    (void)visible;
    (void)interactive;
    return component_new(fmi2CoSimulation, name, guid, location, functions, logging);
}

EXPORT void FMI1(fmiFreeSlaveInstance)(fmi1Component c)
{
    component_free(c);
}

EXPORT fmi1Status FMI1(fmiInitializeSlave)(fmi1Component c, fmi1Real start, fmi1Boolean stop_defined, fmi1Real stop)
{
    fmi2Status status = fmi2SetupExperiment(inner(c), fmi2False, 0.0, start, stop_defined, stop);
    status = status <= fmi2Warning ? fmi2EnterInitializationMode(inner(c)) : status;
    status = status <= fmi2Warning ? fmi2ExitInitializationMode(inner(c)) : status;
    return (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiTerminateSlave)(fmi1Component c)
{
    return (fmi1Status)fmi2Terminate(inner(c));
}

EXPORT fmi1Status FMI1(fmiResetSlave)(fmi1Component c)
{
    return (fmi1Status)fmi2Reset(inner(c));
}

EXPORT fmi1Status FMI1(fmiSetRealInputDerivatives)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                                   const fmi1Integer order[], const fmi1Real value[])
{
    return (fmi1Status)fmi2SetRealInputDerivatives(inner(c), vr, n, order, value);
}

EXPORT fmi1Status FMI1(fmiGetRealOutputDerivatives)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                                    const fmi1Integer order[], fmi1Real value[])
{
    return (fmi1Status)fmi2GetRealOutputDerivatives(inner(c), vr, n, order, value);
}

EXPORT fmi1Status FMI1(fmiCancelStep)(fmi1Component c)
{
    return (fmi1Status)fmi2CancelStep(inner(c));
}

EXPORT fmi1Status FMI1(fmiDoStep)(fmi1Component c, fmi1Real point, fmi1Real size, fmi1Boolean new_step)
{
    (void)new_step;
    return (fmi1Status)fmi2DoStep(inner(c), point, size, fmi2True);
}

EXPORT fmi1Status FMI1(fmiGetStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Status *value)
{
    fmi2Status found = fmi2OK;
    fmi2Status status = fmi2GetStatus(inner(c), (fmi2StatusKind)kind, &found);
    *value = (fmi1Status)found;
    return (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiGetRealStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Real *value)
{
    return (fmi1Status)fmi2GetRealStatus(inner(c), (fmi2StatusKind)kind, value);
}

EXPORT fmi1Status FMI1(fmiGetIntegerStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Integer *value)
{
    return (fmi1Status)fmi2GetIntegerStatus(inner(c), (fmi2StatusKind)kind, value);
}

EXPORT fmi1Status FMI1(fmiGetBooleanStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Boolean *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi1Discard; /* FMI 1.0 has no such kind of status */
}

EXPORT fmi1Status FMI1(fmiGetStringStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1String *value)
{
    return (fmi1Status)fmi2GetStringStatus(inner(c), (fmi2StatusKind)kind, value);
}
