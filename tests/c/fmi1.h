/* fmi1.h: what the FMI 1.0 wrappers for Model Exchange and Co-Simulation share.
 *
 * FMI 1.0 on top of the runtime's FMI 2.0 functions, for tests: no registry has FMUs of FMI 1.0. Each
 * exported function carries the model identifier, as FMI 1.0 wants; identifier.h defines it.
 */
#ifndef TESTS_FMI1_H
#define TESTS_FMI1_H

#include <stddef.h> /* before the next, which needs it and forgets it */

#include "fmi1Functions.h"
#include "fmi2Functions.h"
#include "identifier.h" /* MODEL_IDENTIFIER */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "core.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
#define PASTE(a, b) a##_##b
#define PASTE_EXPANDED(a, b) PASTE(a, b)
#define FMI1(name) PASTE_EXPANDED(MODEL_IDENTIFIER, name)

typedef struct {
    fmi2Component inner;
    fmi1CallbackFunctions environment;
    fmi2CallbackFunctions callbacks;
    fmi2Real time; /* of fmiSetTime before fmiInitialize */
    int initialised;
    fmi1String name; /* while it is being instantiated: the runtime knows none yet */
} Component;

static inline void forward_log(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                               fmi2String category, fmi2String message, ...)
{
    Component *component = environment;
    char text[1024];
    va_list arguments;
    va_start(arguments, message);
    vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    if (component->environment.logger != NULL) {
        name = component->name != NULL ? component->name : name;
        component->environment.logger(component, name, (fmi1Status)status, category, "%s", text);
    }
}

/* location: of the unpacked FMU; Model Exchange of FMI 1.0 is not told. */
static inline fmi1Component component_new(fmi2Type type, fmi1String name, fmi1String guid, fmi1String location,
                                          fmi1CallbackFunctions functions, fmi1Boolean logging)
{
    Component *component = calloc(1, sizeof *component);
    if (component == NULL) {
        return NULL;
    }
    component->environment = functions;
    component->name = name;
    fmi2CallbackFunctions callbacks = {forward_log, calloc, free, NULL, component};
    component->callbacks = callbacks;
    component->inner =
        fmi2Instantiate(name, type, guid, location, &component->callbacks, fmi2False, logging != fmi1False);
    if (component->inner == NULL) {
        free(component);
        return NULL;
    }
    component->name = NULL;
    return component;
}

static inline void component_free(fmi1Component c)
{
    Component *component = c;
    if (component != NULL) {
        fmi2FreeInstance(component->inner);
        free(component);
    }
}

static inline fmi2Component inner(fmi1Component c)
{
    return ((Component *)c)->inner;
}

/* Model Exchange of FMI 2.0 takes new discrete values in Event Mode only. */
void before_discrete(fmi1Component c);

#endif
