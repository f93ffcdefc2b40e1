/* fmi2_stub.h: what FMUs of FMI 2.0 for tests have in common, so that each file holds its own behaviour alone.
 *
 * Included by libraries of one source file each: it defines functions. FMI2_STUB_OWN_MODES: the file keeps track of the
 * modes of Model Exchange itself; FMI2_STUB_OWN_LIFE: of the others, too.
 */

#ifndef FMI2_STUB_H
#define FMI2_STUB_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

/* Number of the behaviour that a GUID "{kind-name}" asks for; count: none. */
static int chosen(const char *guid, const char *kind, const char *const names[], int count)
{
    char wanted[64];
    for (int i = 0; i < count; i++) {
        snprintf(wanted, sizeof wanted, "{%s-%s}", kind, names[i]);
        if (guid != NULL && strcmp(guid, wanted) == 0) {
            return i;
        }
    }
    return count;
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c;
    (void)on;
    (void)n;
    (void)categories;
    return fmi2OK;
}

#define NOTHING_TO_DO(name)                                                                                            \
    fmi2Status name(fmi2Component c)                                                                                   \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        return fmi2OK;                                                                                                 \
    }
#ifndef FMI2_STUB_OWN_LIFE
NOTHING_TO_DO(fmi2EnterInitializationMode)
NOTHING_TO_DO(fmi2Terminate)
#endif
#ifndef FMI2_STUB_OWN_MODES
NOTHING_TO_DO(fmi2EnterEventMode)
NOTHING_TO_DO(fmi2EnterContinuousTimeMode)
#endif

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    (void)c;
    (void)z;
    (void)n;
    return fmi2OK;
}

#endif
