/* delay_driver.c: the whole runtime around a generated model with delays (tests/modelica/Delays.mo, Chain).
 *
 * Model Exchange with steps of 0.01 s and Co-Simulation, saved and serialised on the way, also with bytes that are
 * wrong and with each allocation failing once. Ends with 0 when every check held; the sanitizers report by themselves.
 */
#include "checked.h"
#include "fmi2Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What an allocation that fails leaves undone is not checked. */
#define CHECK(condition) check((condition) || allowed >= 0, #condition, __LINE__)

enum { STEPS = 200, HALFWAY = 130, FUZZED = 80, HEAD = 2048, EARLY = 3 };

static long accepted, refused; /* states with changed bytes */

static void message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                    fmi2String text, ...)
{
    (void)environment, (void)name, (void)status, (void)category, (void)text;
}

static const fmi2CallbackFunctions callbacks = {message, calloc, free, NULL, NULL};

static fmi2Component born(fmi2Type type)
{
    fmi2Component c = fmi2Instantiate("delays", type, GUID, "", &callbacks, fmi2False, fmi2False);
    if (c == NULL || fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) != fmi2OK
        || fmi2EnterInitializationMode(c) != fmi2OK || fmi2ExitInitializationMode(c) != fmi2OK) {
        fmi2FreeInstance(c);
        return NULL;
    }
    return c;
}

static double input(double t)
{
    return t < 0.45 ? 0.0 : 1.0 + sin(3.0 * t);
}

static int event(fmi2Component c, double *next)
{
    fmi2EventInfo info = {.newDiscreteStatesNeeded = fmi2True};
    while (info.newDiscreteStatesNeeded) {
        if (fmi2NewDiscreteStates(c, &info) != fmi2OK) {
            return 0;
        }
    }
    *next = info.nextEventTimeDefined ? info.nextEventTime : HUGE_VAL;
    return fmi2EnterContinuousTimeMode(c) == fmi2OK;
}

static int move(fmi2Component c, double t)
{
    const double u = input(t);
    const fmi2ValueReference input_reference = U;
    return fmi2SetTime(c, t) == fmi2OK && fmi2SetReal(c, &input_reference, 1, &u) == fmi2OK;
}

static double output(fmi2Component c)
{
    const fmi2ValueReference reference = Y;
    double y = -1.0;
    return fmi2GetReal(c, &reference, 1, &y) == fmi2OK ? y : NAN;
}

/* From grid point `first` to `last`; every event on the way. */
static int run(fmi2Component c, int first, int last, double *next)
{
    double t = 0.01 * first;
    for (int k = first + 1; k <= last; k++) {
        while (t < 0.01 * k) {
            fmi2Boolean wanted = fmi2False;
            fmi2Boolean end = fmi2False;
            t = fmin(0.01 * k, *next);
            if (!move(c, t) || fmi2CompletedIntegratorStep(c, fmi2True, &wanted, &end) != fmi2OK) {
                return 0;
            }
            if ((wanted || t >= *next) && (fmi2EnterEventMode(c) != fmi2OK || !event(c, next))) {
                return 0;
            }
        }
    }
    return 1;
}

/* Serialise, spoil, and read back into another instance; NULL: it went wrong. */
static fmi2Component copied(fmi2Component c)
{
    fmi2FMUstate saved = NULL;
    fmi2FMUstate again = NULL;
    size_t size = 0;
    fmi2Component other = born(fmi2ModelExchange);
    char *bytes = NULL;
    int good = other != NULL && fmi2GetFMUstate(c, &saved) == fmi2OK && fmi2GetFMUstate(c, &saved) == fmi2OK
        && fmi2SerializedFMUstateSize(c, saved, &size) == fmi2OK && (bytes = malloc(size)) != NULL
        && fmi2SerializeFMUstate(c, saved, bytes, size) == fmi2OK
        && fmi2DeSerializeFMUstate(other, bytes, size, &again) == fmi2OK && fmi2SetFMUstate(other, again) == fmi2OK;
    fmi2FreeFMUstate(c, &saved);
    fmi2FreeFMUstate(c, &again);
    free(bytes);
    if (!good) {
        fmi2FreeInstance(other);
        return NULL;
    }
    return other;
}

/* Bytes that are cut, or whose header says another size, are refused. */
static void spoilt(fmi2Component c)
{
    fmi2FMUstate saved = NULL;
    fmi2FMUstate again = NULL;
    size_t size = 0;
    CHECK(fmi2GetFMUstate(c, &saved) == fmi2OK && fmi2SerializedFMUstateSize(c, saved, &size) == fmi2OK);
    char *bytes = malloc(size);
    if (bytes != NULL && fmi2SerializeFMUstate(c, saved, bytes, size) == fmi2OK) {
        CHECK(fmi2DeSerializeFMUstate(c, bytes, size / 2, &again) == fmi2Error && again == NULL);
    }
    fmi2FreeFMUstate(c, &saved);
    free(bytes);
}

/* What may be done with an instance that was told a state: nothing of it may read or write what is not its own. From
 * an early state the first of these times is a delay after the first samples. */
static void use(fmi2Component c, int from, int co_simulation)
{
    static const double ahead[] = {0.271, 0.4, 0.8};
    const fmi2ValueReference input_reference = U;
    const double u = 0.5;
    fmi2EventInfo info = {.newDiscreteStatesNeeded = fmi2True};
    fmi2Boolean wanted, end;
    (void)output(c);
    if (co_simulation) {
        (void)fmi2SetReal(c, &input_reference, 1, &u);
        (void)fmi2DoStep(c, 0.01 * from, 0.01, fmi2True);
    }
    for (int k = 0; k < 3 && !co_simulation; k++) {
        (void)move(c, 0.01 * from + ahead[k]);
        (void)fmi2CompletedIntegratorStep(c, fmi2True, &wanted, &end);
        (void)output(c);
        (void)fmi2EnterEventMode(c);
        for (int i = 0; i < 4; i++) {
            (void)fmi2NewDiscreteStates(c, &info);
        }
        (void)fmi2EnterContinuousTimeMode(c);
    }
    (void)output(c);
}

/* An instance whose serialised state has these bytes: an error, or a state to go on from. */
static void told(fmi2Component c, const char *bytes, size_t size, int from, int co_simulation)
{
    fmi2FMUstate state = NULL;
    if (fmi2DeSerializeFMUstate(c, bytes, size, &state) == fmi2OK && fmi2SetFMUstate(c, state) == fmi2OK) {
        use(c, from, co_simulation);
        accepted++;
    } else {
        refused++;
    }
    fmi2FreeFMUstate(c, &state);
    (void)fmi2Reset(c);
}

/* Each number of a serialised state, and each byte, changed in turn; the size stays right. Of the samples, which are
 * many, only some where each try is a step of Co-Simulation. */
static void fuzzed(fmi2Component c, int from, int co_simulation)
{
    static const double numbers[] = {0.0, -1.0, 0.5, 1.0, 2.0, 3.0, 5.5, 1e9, -1e300, 1e300, NAN, HUGE_VAL, -HUGE_VAL};
    static const unsigned char masks[] = {0x01, 0x02, 0x80, 0xff};
    fmi2FMUstate saved = NULL;
    size_t size = 0;
    CHECK(fmi2GetFMUstate(c, &saved) == fmi2OK && fmi2SerializedFMUstateSize(c, saved, &size) == fmi2OK);
    char *right = malloc(size);
    char *wrong = malloc(size);
    CHECK(right != NULL && wrong != NULL && fmi2SerializeFMUstate(c, saved, right, size) == fmi2OK);
    fmi2FreeFMUstate(c, &saved);
    for (size_t at = 0; at < size; at += co_simulation && at > HEAD ? 61 : 1) {
        for (size_t i = 0; i < sizeof masks; i++) {
            memcpy(wrong, right, size);
            wrong[at] = (char)(wrong[at] ^ masks[i]);
            told(c, wrong, size, from, co_simulation);
        }
        /* Doubles stand at multiples of 4 where an int and flags stand between them. */
        for (size_t i = 0; at % 2 == 0 && at + sizeof(double) <= size && i < sizeof numbers / sizeof *numbers; i++) {
            memcpy(wrong, right, size);
            memcpy(wrong + at, &numbers[i], sizeof(double));
            told(c, wrong, size, from, co_simulation);
        }
    }
    told(c, right, size, from, co_simulation);
    free(right);
    free(wrong);
}

static void exchange(void)
{
    double next = HUGE_VAL;
    fmi2Component c = born(fmi2ModelExchange);
    if (c != NULL && event(c, &next) && run(c, 0, HALFWAY, &next)) {
        double copied_next = next;
        fmi2Component other = copied(c);
        CHECK(other != NULL);
        if (other != NULL && run(c, HALFWAY, STEPS, &next) && run(other, HALFWAY, STEPS, &copied_next)) {
            const double y = output(c);
            CHECK(fabs(y - input(0.01 * STEPS - 0.3)) < 1e-5);
            CHECK(y <= output(other) && y >= output(other));
        } else {
            CHECK(0);
        }
        fmi2FreeInstance(other);
        CHECK(fmi2SetTime(c, 1.99) == fmi2OK); /* back without a saved state */
        fmi2Boolean wanted, end;
        CHECK(fmi2CompletedIntegratorStep(c, fmi2True, &wanted, &end) == fmi2OK);
        if (allowed < 0) {
            spoilt(c);
        }
    } else {
        CHECK(0);
    }
    if (c != NULL) {
        (void)fmi2Reset(c);
    }
    fmi2FreeInstance(c);
}

static void slave(void)
{
    const fmi2ValueReference input_reference = U;
    fmi2Component c = born(fmi2CoSimulation);
    int good = c != NULL;
    for (int k = 0; good && k < STEPS; k++) {
        const double u = k < 45 ? 0.0 : 1.0;
        good = fmi2SetReal(c, &input_reference, 1, &u) == fmi2OK && fmi2DoStep(c, 0.01 * k, 0.01, fmi2True) == fmi2OK;
        const double y = good ? output(c) : NAN;
        CHECK(k == 74 || y == (k < 74 ? 0.0 : 1.0)); /* at 0.75 s, the end of step 74 */
    }
    CHECK(good);
    fmi2FreeInstance(c);
}

/* A past that has just begun, and one with jumps some of which have come out, in both kinds. */
static void fuzz(void)
{
    static const int from[] = {EARLY, HALFWAY};
    const fmi2ValueReference input_reference = U;
    fmi2Component c = NULL;
    for (int i = 0; i < 2; i++) {
        double next = HUGE_VAL;
        c = born(fmi2ModelExchange);
        CHECK(c != NULL && event(c, &next) && run(c, 0, from[i], &next));
        fuzzed(c, from[i], 0);
        fmi2FreeInstance(c);
    }
    c = born(fmi2CoSimulation);
    for (int k = 0; k < FUZZED; k++) {
        const double u = k < 45 ? 0.0 : k < 70 ? 1.0 : 2.0;
        CHECK(fmi2SetReal(c, &input_reference, 1, &u) == fmi2OK && fmi2DoStep(c, 0.01 * k, 0.01, fmi2True) == fmi2OK);
    }
    fuzzed(c, FUZZED, 1);
    fmi2FreeInstance(c);
    CHECK(accepted > 0 && refused > 0);
    printf("%ld states with changed bytes were taken, %ld refused\n", accepted, refused);
}

int main(int argc, char **argv)
{
    (void)argv;
    if (argc > 1) {
        fuzz();
        return failures != 0;
    }
    exchange();
    slave();
#ifdef WRAP_CALLOC
    for (long k = 0; k < 60; k++) {
        allowed = k;
        exchange();
        allowed = k;
        slave();
    }
#endif
    return failures != 0;
}
