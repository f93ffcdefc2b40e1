/* driver.c: calls every function of the runtime, also wrongly and without memory, under sanitizers.
 *
 * Ends with 0 when every check held; address and undefined-behaviour sanitizers report by themselves.
 */
#include "checked.h"
#include "fmi2Functions.h"
#include "fmi3Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GUID "{stub-of-the-runtime-tests}"
#define CHECK(condition) check((condition), #condition, __LINE__)

enum { H = 1, U = 11, Y = 12, GAIN = 13, E = 15, COUNT = 16, ABOVE = 18, ENABLE = 19, MODE = 20, LAST = 22 };

#ifdef WRAP_CALLOC
static void *allocate(size_t count, size_t size)
{
    return calloc(count, size);
}
#else
static void *allocate(size_t count, size_t size)
{
    return granted() ? calloc(count, size) : NULL;
}
#endif

static void message2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                 fmi2String message, ...)
{
    size_t *count = environment;
    *count += strlen(name) + strlen(category) + strlen(message) > (size_t)status ? 1U : 0U;
}

static void message3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment, (void)status, (void)category, (void)message;
}

static fmi2Component new2(fmi2Type type, fmi2CallbackFunctions *functions)
{
    return fmi2Instantiate("driver", type, GUID, "file:///", functions, fmi2False, fmi2True);
}

static void initialise2(fmi2Component c)
{
    CHECK(fmi2SetupExperiment(c, fmi2True, 1e-7, 0.0, fmi2False, 0.0) == fmi2OK);
    CHECK(fmi2EnterInitializationMode(c) == fmi2OK);
    CHECK(fmi2ExitInitializationMode(c) == fmi2OK);
}

static void values2(fmi2Component c)
{
    fmi2ValueReference real = U, whole = COUNT, truth = ABOVE, enable = ENABLE, output = Y;
    fmi2Real number = 0.75, derivative = 0.0, one = 1.0;
    fmi2Integer integer = 0;
    fmi2Boolean boolean = 1;
    fmi2String text = "";
    CHECK(fmi2SetReal(c, &real, 1, &number) == fmi2OK);
    CHECK(fmi2GetReal(c, &output, 1, &number) == fmi2OK);
    CHECK(fmi2GetInteger(c, &whole, 1, &integer) == fmi2OK);
    CHECK(fmi2GetBoolean(c, &truth, 1, &boolean) == fmi2OK && boolean == fmi2True);
    CHECK(fmi2SetBoolean(c, &enable, 1, &boolean) == fmi2OK);
    CHECK(fmi2SetInteger(c, NULL, 0, NULL) == fmi2OK);
    CHECK(fmi2SetString(c, NULL, 0, NULL) == fmi2OK);
    CHECK(fmi2GetString(c, NULL, 0, &text) == fmi2OK);
    CHECK(fmi2GetDirectionalDerivative(c, &output, 1, &real, 1, &one, &derivative) == fmi2OK && derivative == 2.0);
}

static void states2(fmi2Component c)
{
    fmi2FMUstate state = NULL, copy = NULL;
    size_t size = 0;
    CHECK(fmi2GetFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2GetFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK);
    fmi2Byte *bytes = malloc(size);
    if (bytes != NULL) {
        CHECK(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
        CHECK(fmi2DeSerializeFMUstate(c, bytes, size, &copy) == fmi2OK);
        CHECK(fmi2SetFMUstate(c, copy) == fmi2OK);
    }
    free(bytes);
    CHECK(fmi2FreeFMUstate(c, &copy) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK && state == NULL);
    CHECK(fmi2FreeFMUstate(c, &state) == fmi2OK);
    CHECK(fmi2FreeFMUstate(c, NULL) == fmi2OK);
}

static void co_simulation2(fmi2CallbackFunctions *functions)
{
    fmi2Component c = new2(fmi2CoSimulation, functions);
    fmi2ValueReference input = U, output = Y;
    fmi2Integer order = 1;
    fmi2Real slope = 0.5, derivative = 0.0;
    fmi2Status status = fmi2OK;
    fmi2Boolean ended = fmi2False;
    CHECK(c != NULL);
    initialise2(c);
    values2(c);
    for (int i = 0; i < 30; i++) {
        CHECK(fmi2SetRealInputDerivatives(c, &input, 1, &order, &slope) == fmi2OK);
        CHECK(fmi2DoStep(c, 0.05 * i, 0.05, fmi2True) == fmi2OK);
        CHECK(fmi2GetRealOutputDerivatives(c, &output, 1, &order, &derivative) == fmi2OK);
        states2(c);
    }
    CHECK(fmi2GetStatus(c, fmi2DoStepStatus, &status) == fmi2OK);
    CHECK(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &slope) == fmi2OK);
    CHECK(fmi2GetBooleanStatus(c, fmi2Terminated, &ended) == fmi2OK);
    CHECK(fmi2GetIntegerStatus(c, fmi2DoStepStatus, &order) == fmi2Discard);
    CHECK(fmi2GetStringStatus(c, fmi2PendingStatus, NULL) == fmi2Discard);
    CHECK(fmi2CancelStep(c) == fmi2Error);
    CHECK(fmi2DoStep(c, 1.5, 0.1, fmi2True) == fmi2Error);
    CHECK(fmi2Reset(c) == fmi2OK);
    initialise2(c);
    CHECK(fmi2DoStep(c, 0.0, 2.5, fmi2True) == fmi2OK);
    CHECK(fmi2Terminate(c) == fmi2OK);
    fmi2FreeInstance(c);
}

static void model_exchange2(fmi2CallbackFunctions *functions)
{
    fmi2Component c = new2(fmi2ModelExchange, functions);
    fmi2EventInfo info = {.newDiscreteStatesNeeded = fmi2True};
    fmi2Real x[7] = {0}, dx[7] = {0}, z[3] = {0};
    fmi2Boolean event = fmi2False, end = fmi2False;
    initialise2(c);
    values2(c);
    while (info.newDiscreteStatesNeeded) {
        CHECK(fmi2NewDiscreteStates(c, &info) == fmi2OK);
    }
    CHECK(fmi2EnterContinuousTimeMode(c) == fmi2OK);
    CHECK(fmi2SetTime(c, 0.01) == fmi2OK);
    CHECK(fmi2GetContinuousStates(c, x, 7) == fmi2OK);
    CHECK(fmi2SetContinuousStates(c, x, 7) == fmi2OK);
    x[0] = (double)NAN;
    CHECK(fmi2SetContinuousStates(c, x, 7) == fmi2Discard);
    CHECK(fmi2GetDerivatives(c, dx, 7) == fmi2OK);
    CHECK(fmi2GetEventIndicators(c, z, 3) == fmi2OK);
    CHECK(fmi2GetNominalsOfContinuousStates(c, dx, 7) == fmi2OK && dx[3] == 1.0);
    CHECK(fmi2CompletedIntegratorStep(c, fmi2True, &event, &end) == fmi2OK);
    CHECK(fmi2EnterEventMode(c) == fmi2OK);
    states2(c);
    CHECK(fmi2GetDerivatives(c, dx, 6) == fmi2Error);
    fmi2FreeInstance(c);
}

/* Every function called in every state, with null pointers: nothing may crash. */
static void wrong_calls2(fmi2Component c)
{
    fmi2String category = "logAll";
    fmi2SetDebugLogging(c, fmi2True, 1, &category);
    fmi2SetDebugLogging(c, fmi2False, 1, &category);
    fmi2SetDebugLogging(c, fmi2True, 1, NULL);
    fmi2GetReal(c, NULL, 1, NULL);
    fmi2GetInteger(c, NULL, 1, NULL);
    fmi2GetBoolean(c, NULL, 1, NULL);
    fmi2GetString(c, NULL, 1, NULL);
    fmi2SetReal(c, NULL, 1, NULL);
    fmi2SetInteger(c, NULL, 1, NULL);
    fmi2SetBoolean(c, NULL, 1, NULL);
    fmi2SetString(c, NULL, 1, NULL);
    fmi2GetFMUstate(c, NULL);
    fmi2SetFMUstate(c, NULL);
    fmi2SerializedFMUstateSize(c, NULL, NULL);
    fmi2SerializeFMUstate(c, NULL, NULL, 0);
    fmi2DeSerializeFMUstate(c, NULL, 0, NULL);
    fmi2GetDirectionalDerivative(c, NULL, 1, NULL, 1, NULL, NULL);
    fmi2NewDiscreteStates(c, NULL);
    fmi2CompletedIntegratorStep(c, fmi2True, NULL, NULL);
    fmi2SetContinuousStates(c, NULL, 7);
    fmi2GetDerivatives(c, NULL, 7);
    fmi2GetEventIndicators(c, NULL, 3);
    fmi2GetContinuousStates(c, NULL, 7);
    fmi2GetNominalsOfContinuousStates(c, NULL, 7);
    fmi2SetRealInputDerivatives(c, NULL, 1, NULL, NULL);
    fmi2GetRealOutputDerivatives(c, NULL, 1, NULL, NULL);
    fmi2DoStep(c, (double)NAN, 0.0, fmi2True);
    fmi2GetStatus(c, fmi2DoStepStatus, NULL);
    fmi2GetRealStatus(c, fmi2LastSuccessfulTime, NULL);
    fmi2GetBooleanStatus(c, fmi2Terminated, NULL);
    fmi2SetTime(c, (double)INFINITY);
    fmi2EnterEventMode(c);
    fmi2EnterContinuousTimeMode(c);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    fmi2SetupExperiment(c, fmi2True, -1.0, 0.0, fmi2True, -1.0);
}

static void wrong2(fmi2CallbackFunctions *functions)
{
    wrong_calls2(NULL);
    for (int step = 0; step < 8; step++) {
        fmi2Component c = new2(step % 2 ? fmi2CoSimulation : fmi2ModelExchange, functions);
        if (step >= 2) {
            CHECK(fmi2EnterInitializationMode(c) == fmi2OK);
        }
        if (step >= 4) {
            CHECK(fmi2ExitInitializationMode(c) == fmi2OK);
        }
        if (step >= 6) {
            CHECK(fmi2Terminate(c) == fmi2OK);
        }
        wrong_calls2(c);
        CHECK(fmi2Reset(c) == fmi2OK);
        fmi2FreeInstance(c);
    }
}

static void out_of_memory2(fmi2CallbackFunctions *functions)
{
    fmi2Component c = NULL;
    for (long n = 0; c == NULL && n < 100; n++) {
        allowed = n;
        c = new2(fmi2CoSimulation, functions);
    }
    CHECK(c != NULL);
    fmi2FMUstate state = NULL;
    allowed = 0;
    CHECK(c == NULL || fmi2GetFMUstate(c, &state) == fmi2Error);
    CHECK(state == NULL);
    allowed = -1;
    fmi2FreeInstance(c);
}

/* ---- FMI 3.0 ---- */

static void update3(fmi3InstanceEnvironment environment, fmi3Float64 time, fmi3Boolean set, fmi3Boolean get,
                    fmi3Boolean finished, fmi3Boolean may_return, fmi3Boolean *wanted, fmi3Float64 *at)
{
    fmi3Instance *instance = environment;
    fmi3ValueReference output = Y;
    fmi3Float64 value = 0.0;
    (void)set, (void)get, (void)finished, (void)may_return;
    CHECK(fmi3GetFloat64(*instance, &output, 1, &value, 1) == fmi3OK);
    *wanted = time > 0.2 && time < 0.3;
    *at = time;
}

static void initialise3(fmi3Instance c)
{
    CHECK(fmi3EnterInitializationMode(c, fmi3True, 1e-7, 0.0, fmi3False, 0.0) == fmi3OK);
    CHECK(fmi3ExitInitializationMode(c) == fmi3OK);
}

static void iterate3(fmi3Instance c)
{
    fmi3Boolean again = fmi3True, end, nominals, states, defined;
    fmi3Float64 time;
    while (again) {
        CHECK(fmi3UpdateDiscreteStates(c, &again, &end, &nominals, &states, &defined, &time) == fmi3OK);
    }
}

static void values3(fmi3Instance c)
{
    fmi3ValueReference input = U, output = Y, count = COUNT, above = ABOVE, mode = MODE, gain = GAIN;
    fmi3Float64 number = 0.75, one = 1.0, result = 0.0;
    fmi3Int32 whole = 0;
    fmi3Int64 literal = 2;
    fmi3Boolean truth = fmi3False;
    CHECK(fmi3SetFloat64(c, &input, 1, &number, 1) == fmi3OK);
    CHECK(fmi3SetFloat64(c, &gain, 1, &one, 1) == fmi3OK);
    CHECK(fmi3GetFloat64(c, &output, 1, &result, 1) == fmi3OK);
    CHECK(fmi3GetInt32(c, &count, 1, &whole, 1) == fmi3OK);
    CHECK(fmi3SetInt64(c, &mode, 1, &literal, 1) == fmi3OK);
    CHECK(fmi3GetInt64(c, &mode, 1, &literal, 1) == fmi3OK && literal == 2);
    CHECK(fmi3GetBoolean(c, &above, 1, &truth, 1) == fmi3OK);
    CHECK(fmi3SetInt32(c, NULL, 0, NULL, 0) == fmi3OK);
    CHECK(fmi3SetBoolean(c, NULL, 0, NULL, 0) == fmi3OK);
    CHECK(fmi3GetDirectionalDerivative(c, &output, 1, &input, 1, &one, 1, &result, 1) == fmi3OK && result == 1.0);
}

static void states3(fmi3Instance c)
{
    fmi3FMUState state = NULL, copy = NULL;
    size_t size = 0;
    CHECK(fmi3GetFMUState(c, &state) == fmi3OK);
    CHECK(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK);
    fmi3Byte *bytes = malloc(size);
    if (bytes != NULL) {
        CHECK(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK);
        CHECK(fmi3DeserializeFMUState(c, bytes, size, &copy) == fmi3OK);
        CHECK(fmi3SetFMUState(c, copy) == fmi3OK);
    }
    free(bytes);
    CHECK(fmi3FreeFMUState(c, &copy) == fmi3OK);
    CHECK(fmi3FreeFMUState(c, &state) == fmi3OK);
}

static void co_simulation3(bool event_mode, bool early)
{
    fmi3Instance c = NULL;
    fmi3ValueReference required = Y;
    c = fmi3InstantiateCoSimulation("driver", GUID, NULL, false, true, event_mode, early, &required, 1, &c, message3,
                                    update3);
    double point = 0.0;
    initialise3(c);
    values3(c);
    if (event_mode) {
        iterate3(c);
        CHECK(fmi3EvaluateDiscreteStates(c) == fmi3OK);
        CHECK(fmi3EnterStepMode(c) == fmi3OK);
    }
    for (int i = 0; i < 200 && point < 1.5; i++) {
        fmi3Boolean event, end, returned;
        CHECK(fmi3DoStep(c, point, 0.25, fmi3True, &event, &end, &returned, &point) == fmi3OK);
        states3(c);
        if (event) {
            CHECK(fmi3EnterEventMode(c) == fmi3OK);
            iterate3(c);
            CHECK(fmi3EnterStepMode(c) == fmi3OK);
        }
    }
    fmi3Int32 order = 1;
    fmi3Float64 derivative = 0.0;
    CHECK(fmi3GetOutputDerivatives(c, &required, 1, &order, &derivative, 1) == fmi3OK);
    CHECK(fmi3Terminate(c) == fmi3OK);
    fmi3FreeInstance(c);
}

static void model_exchange3(void)
{
    fmi3Instance c = fmi3InstantiateModelExchange("driver", GUID, NULL, false, true, NULL, message3);
    fmi3Float64 x[7] = {0}, dx[7] = {0}, z[3] = {0};
    fmi3Boolean event, end;
    size_t n = 0;
    initialise3(c);
    values3(c);
    iterate3(c);
    CHECK(fmi3EnterContinuousTimeMode(c) == fmi3OK);
    CHECK(fmi3SetTime(c, 0.01) == fmi3OK);
    CHECK(fmi3GetNumberOfContinuousStates(c, &n) == fmi3OK && n == 7);
    CHECK(fmi3GetNumberOfEventIndicators(c, &n) == fmi3OK && n == 3);
    CHECK(fmi3GetContinuousStates(c, x, 7) == fmi3OK);
    CHECK(fmi3SetContinuousStates(c, x, 7) == fmi3OK);
    CHECK(fmi3GetContinuousStateDerivatives(c, dx, 7) == fmi3OK);
    CHECK(fmi3GetEventIndicators(c, z, 3) == fmi3OK);
    CHECK(fmi3GetNominalsOfContinuousStates(c, dx, 7) == fmi3OK);
    CHECK(fmi3CompletedIntegratorStep(c, fmi3True, &event, &end) == fmi3OK);
    CHECK(fmi3EnterEventMode(c) == fmi3OK);
    states3(c);
    fmi3FreeInstance(c);
}

#define BOTH(Type)                                                                                                    \
    fmi3Get##Type(c, NULL, 1, NULL, 1);                                                                               \
    fmi3Set##Type(c, NULL, 1, NULL, 1)

static void wrong_calls3(fmi3Instance c)
{
    BOTH(Float32); BOTH(Float64); BOTH(Int8); BOTH(UInt8); BOTH(Int16); BOTH(UInt16); BOTH(Int32); BOTH(UInt32);
    BOTH(Int64); BOTH(UInt64); BOTH(Boolean); BOTH(String);
    fmi3GetBinary(c, NULL, 1, NULL, NULL, 1);
    fmi3SetBinary(c, NULL, 1, NULL, NULL, 1);
    fmi3GetClock(c, NULL, 1, NULL);
    fmi3SetClock(c, NULL, 1, NULL);
    fmi3GetIntervalDecimal(c, NULL, 1, NULL, NULL);
    fmi3GetIntervalFraction(c, NULL, 1, NULL, NULL, NULL);
    fmi3GetShiftDecimal(c, NULL, 1, NULL);
    fmi3GetShiftFraction(c, NULL, 1, NULL, NULL);
    fmi3SetIntervalDecimal(c, NULL, 1, NULL);
    fmi3SetIntervalFraction(c, NULL, 1, NULL, NULL);
    fmi3SetShiftDecimal(c, NULL, 1, NULL);
    fmi3SetShiftFraction(c, NULL, 1, NULL, NULL);
    fmi3ActivateModelPartition(c, 0, 0.0);
    fmi3EnterConfigurationMode(c);
    fmi3ExitConfigurationMode(c);
    fmi3GetAdjointDerivative(c, NULL, 1, NULL, 1, NULL, 1, NULL, 1);
    fmi3GetDirectionalDerivative(c, NULL, 1, NULL, 1, NULL, 1, NULL, 1);
    fmi3GetNumberOfVariableDependencies(c, 0, NULL);
    fmi3GetVariableDependencies(c, 0, NULL, NULL, NULL, NULL, 0);
    fmi3GetOutputDerivatives(c, NULL, 1, NULL, NULL, 1);
    fmi3DoStep(c, 0.0, 1.0, fmi3True, NULL, NULL, NULL, NULL);
    fmi3UpdateDiscreteStates(c, NULL, NULL, NULL, NULL, NULL, NULL);
    fmi3CompletedIntegratorStep(c, fmi3True, NULL, NULL);
    fmi3GetNumberOfContinuousStates(c, NULL);
    fmi3GetNumberOfEventIndicators(c, NULL);
    fmi3GetFMUState(c, NULL);
    fmi3SetFMUState(c, NULL);
    fmi3FreeFMUState(c, NULL);
    fmi3SerializedFMUStateSize(c, NULL, NULL);
    fmi3SerializeFMUState(c, NULL, NULL, 0);
    fmi3DeserializeFMUState(c, NULL, 0, NULL);
    fmi3SetDebugLogging(c, fmi3True, 1, NULL);
    fmi3EnterEventMode(c);
    fmi3EnterStepMode(c);
    fmi3EvaluateDiscreteStates(c);
    fmi3EnterInitializationMode(c, fmi3True, 2.0, 0.0, fmi3False, 0.0);
}

static void wrong3(void)
{
    wrong_calls3(NULL);
    for (int step = 0; step < 4; step++) {
        fmi3Instance c = fmi3InstantiateCoSimulation("driver", GUID, NULL, false, true, false, false, NULL, 0, NULL, message3, NULL);
        if (step >= 1) {
            CHECK(fmi3EnterInitializationMode(c, fmi3False, 0.0, 0.0, fmi3False, 0.0) == fmi3OK);
        }
        if (step >= 2) {
            CHECK(fmi3ExitInitializationMode(c) == fmi3OK);
        }
        wrong_calls3(c);
        CHECK(fmi3Reset(c) == fmi3OK);
        fmi3FreeInstance(c);
    }
    fmi3ValueReference discrete = COUNT;
    CHECK(fmi3InstantiateCoSimulation("x", GUID, NULL, false, true, false, false, &discrete, 1, NULL, message3, NULL) == NULL);
    CHECK(fmi3InstantiateScheduledExecution("x", GUID, NULL, false, true, NULL, message3, NULL, NULL, NULL) == NULL);
    CHECK(fmi3InstantiateModelExchange(" ", GUID, NULL, false, true, NULL, NULL) == NULL);
    CHECK(fmi3InstantiateModelExchange("x", NULL, NULL, false, true, NULL, message3) == NULL);
}

int main(void)
{
    size_t messages = 0;
    fmi2CallbackFunctions functions = {message2, allocate, free, NULL, &messages};
    fmi2CallbackFunctions silent = {NULL, NULL, NULL, NULL, NULL};
    co_simulation2(&functions);
    co_simulation2(&silent);
    model_exchange2(&functions);
    wrong2(&functions);
    wrong2(&silent);
    out_of_memory2(&functions);
    CHECK(fmi2Instantiate("x", fmi2CoSimulation, GUID, NULL, NULL, fmi2False, fmi2False) == NULL);
    co_simulation3(false, false);
    co_simulation3(false, true);
    co_simulation3(true, false);
    co_simulation3(true, true);
    model_exchange3();
    wrong3();
    CHECK(messages > 100);
    CHECK(strcmp(fmi2GetVersion(), "2.0") == 0 && strcmp(fmi3GetVersion(), "3.0") == 0);
    CHECK(strcmp(fmi2GetTypesPlatform(), "default") == 0);
    return failures == 0 ? 0 : 1;
}
