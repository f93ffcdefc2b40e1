/* ticking.c: clocks of FMI 3.0 in Model Exchange and Co-Simulation with event mode.
 *
 *   even      constant: every 0.1 s from 0.05 s on; held := u, evens := evens + 1
 *   counted   countdown: 0.02 s after every third tick of `even`; downs := downs + 1, down_at := time
 *   growing   changing: first after 0.1 s, each next interval twice the last one; grows := grows + 1, grown_at := time
 *   every2    output: ticks with every second tick of `even`
 *   x' = held, continuous: the exact integral of a staircase
 */
#include <stdint.h>
#include <stdbool.h>

typedef struct {
    double u, held, x, down_at, grown_at, growth, countdown;
    int evens, downs, grows;
    bool even, counted, growing, every2, asked_growth, known;
} Ticking;
#define FMI3_STUB_MODEL Ticking
#include "fmi3_stub.h"

enum { TIME, U, HELD, X, DER_X, DOWN_AT, GROWN_AT, EVENS = 20, DOWNS, GROWS, EVEN = 100, COUNTED, GROWING, EVERY2 };

static void reset(Ticking *model)
{
    model->growth = 0.1;
    model->down_at = model->grown_at = -1.0;
}

static double value_of(const Stub *stub, fmi3ValueReference vr)
{
    const Ticking *m = &stub->model;
    switch (vr) {
    case TIME: return stub->time;
    case U: return m->u;
    case HELD: return m->held;
    case X: return m->x;
    case DER_X: return m->held;
    case DOWN_AT: return m->down_at;
    case GROWN_AT: return m->grown_at;
    default: return NAN;
    }
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t n_values)
{
    (void)n_values;
    for (size_t i = 0; i < n; i++) {
        values[i] = value_of(instance, vr[i]);
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    Stub *stub = instance;
    (void)n_values;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == U) {
            stub->model.u = values[i];
        } else if (vr[i] == X) {
            stub->model.x = values[i];
        } else {
            return wrong(stub, "only u and x can be set");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                        size_t n_values)
{
    const Ticking *m = &((const Stub *)instance)->model;
    (void)n_values;
    for (size_t i = 0; i < n; i++) {
        values[i] = vr[i] == EVENS ? m->evens : vr[i] == DOWNS ? m->downs : m->grows;
    }
    return fmi3OK;
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
{
    Stub *stub = instance;
    Ticking *m = &stub->model;
    EXPECT(stub, EVENT, "fmi3SetClock");
    for (size_t i = 0; i < n; i++) {
        if (!values[i]) {
            return wrong(stub, "a clock can be made to tick, not to stop");
        }
        if (vr[i] == EVEN) {
            m->even = true;
            m->every2 = (m->evens + 1) % 2 == 0;
        } else if (vr[i] == COUNTED) {
            m->counted = true;
        } else if (vr[i] == GROWING) {
            m->growing = true;
        } else {
            return wrong(stub, "this is no input clock");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
{
    Stub *stub = instance;
    const Ticking *m = &stub->model;
    EXPECT(stub, EVENT, "fmi3GetClock");
    for (size_t i = 0; i < n; i++) {
        values[i] = vr[i] == EVERY2 ? m->every2 : vr[i] == EVEN ? m->even : vr[i] == COUNTED ? m->counted : m->growing;
    }
    return fmi3OK;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    Stub *stub = instance;
    Ticking *m = &stub->model;
    EXPECT(stub, INITIALISATION | EVENT, "fmi3GetIntervalDecimal");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == COUNTED) {
            intervals[i] = strcmp(stub->token, "ticking-backwards") == 0 ? -0.02 : 0.02;
            qualifiers[i] = m->countdown > 0.0 ? fmi3IntervalChanged
                            : m->known         ? fmi3IntervalUnchanged
                                               : fmi3IntervalNotYetKnown;
            m->known = m->known || m->countdown > 0.0;
            m->countdown = 0.0;
        } else if (vr[i] == GROWING) {
            intervals[i] = m->growth;
            qualifiers[i] = m->asked_growth ? fmi3IntervalUnchanged : fmi3IntervalChanged;
            m->asked_growth = true;
        } else {
            return wrong(stub, "the interval of this clock is in the description, or it has none");
        }
    }
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *timed, fmi3Float64 *next)
{
    Stub *stub = instance;
    Ticking *m = &stub->model;
    EXPECT(stub, EVENT, "fmi3UpdateDiscreteStates");
    if (m->even) {
        m->evens++;
        m->held = m->u;
        m->countdown = m->evens % 3 == 0 ? 1.0 : m->countdown;
    }
    if (m->counted) {
        m->downs++;
        m->down_at = stub->time;
        m->known = false;
    }
    if (m->growing) {
        m->grows++;
        m->grown_at = stub->time;
        m->growth *= 2.0;
        m->asked_growth = false;
    }
    m->even = m->counted = m->growing = m->every2 = false;
    *again = *terminate = *nominals = *states = *timed = false;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    (void)instance;
    *n = 1;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    (void)instance;
    *n = 0;
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    (void)n;
    x[0] = ((Stub *)instance)->model.x;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    (void)n;
    ((Stub *)instance)->model.x = x[0];
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t n)
{
    (void)n;
    dx[0] = ((Stub *)instance)->model.held;
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
{
    (void)instance, (void)n;
    nominals[0] = 1.0;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keeps, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Stub *stub = instance;
    (void)keeps;
    EXPECT(stub, STEP, "fmi3DoStep");
    stub->model.x += stub->model.held * step;
    stub->time = *reached = time + step;
    *event = *terminate = *early = false;
    return fmi3OK;
}
