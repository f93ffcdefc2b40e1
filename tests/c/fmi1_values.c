/* fmi1_values.c: values of variables, the same for Model Exchange and Co-Simulation. */
#include "fmi1.h"

EXPORT const char *FMI1(fmiGetVersion)(void)
{
    return "1.0";
}

EXPORT fmi1Status FMI1(fmiSetDebugLogging)(fmi1Component c, fmi1Boolean on)
{
    return (fmi1Status)fmi2SetDebugLogging(inner(c), on != fmi1False, 0, NULL);
}

EXPORT fmi1Status FMI1(fmiGetReal)(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1Real value[])
{
    return (fmi1Status)fmi2GetReal(inner(c), vr, n, value);
}

EXPORT fmi1Status FMI1(fmiGetInteger)(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1Integer value[])
{
    return (fmi1Status)fmi2GetInteger(inner(c), vr, n, value);
}

EXPORT fmi1Status FMI1(fmiGetBoolean)(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1Boolean value[])
{
    fmi2Status status = fmi2OK;
    for (size_t i = 0; status <= fmi2Warning && i < n; i++) {
        fmi2Boolean flag = fmi2False;
        status = fmi2GetBoolean(inner(c), &vr[i], 1, &flag);
        value[i] = flag != fmi2False ? fmi1True : fmi1False;
    }
    return (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiGetString)(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1String value[])
{
    return (fmi1Status)fmi2GetString(inner(c), vr, n, value);
}

EXPORT fmi1Status FMI1(fmiSetReal)(fmi1Component c, const fmi1ValueReference vr[], size_t n, const fmi1Real value[])
{
    return (fmi1Status)fmi2SetReal(inner(c), vr, n, value);
}

EXPORT fmi1Status FMI1(fmiSetInteger)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                      const fmi1Integer value[])
{
    before_discrete(c);
    return (fmi1Status)fmi2SetInteger(inner(c), vr, n, value);
}

EXPORT fmi1Status FMI1(fmiSetBoolean)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                      const fmi1Boolean value[])
{
    fmi2Status status = fmi2OK;
    before_discrete(c);
    for (size_t i = 0; status <= fmi2Warning && i < n; i++) {
        fmi2Boolean flag = value[i] != fmi1False ? fmi2True : fmi2False;
        status = fmi2SetBoolean(inner(c), &vr[i], 1, &flag);
    }
    return (fmi1Status)status;
}

EXPORT fmi1Status FMI1(fmiSetString)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                     const fmi1String value[])
{
    return (fmi1Status)fmi2SetString(inner(c), vr, n, value);
}
