/* sized.c: an FMU of FMI 3.0 whose sizes are structural, with all that is rarely met beside.
 *
 *   x[i]' = -a[i] x[i] + u[i],  sum = gain * (x[1] + … + x[n]),  y = x,  i = 1 … n;  gain 1 where mode is eco, 3 where sport
 * Derivatives are exact, forward and adjoint; under the token "sized-lies" the adjoint ones are wrong. Co-simulation is
 * exact for a held input; under the token "sized-asks" it is made of 50 such steps, at whose middle the FMU asks for
 * its inputs. `label` is a string, `blob` binary.
 */
#include <stdbool.h>
#include <stdint.h>

enum { MOST = 8 };
typedef struct {
    uint64_t n;
    double a[MOST], x[MOST], u[MOST];
    int64_t mode;
    char label[64];
} Sized;
#define FMI3_STUB_MODEL Sized
#include "fmi3_stub.h"

enum { TIME, N, A, X, DER_X, U, SUM, MODE, LABEL, Y, BLOB };

static void resize(Sized *m, uint64_t n)
{
    m->n = n;
    for (int i = 0; i < MOST; i++) {
        m->a[i] = i + 1.0;
        m->x[i] = m->u[i] = 0.0;
    }
}

static void reset(Sized *m)
{
    resize(m, 2);
    m->mode = 1;
    strcpy(m->label, "as built");
}

static double gain(const Sized *m)
{
    return m->mode == 1 ? 1.0 : 3.0;
}

/* Number of values of a variable. */
static size_t count(const Sized *m, fmi3ValueReference vr)
{
    return vr == TIME || vr == SUM ? 1 : m->n;
}

static double value_of(const Stub *stub, fmi3ValueReference vr, size_t i)
{
    const Sized *m = &stub->model;
    double sum = 0.0;
    switch (vr) {
    case TIME: return stub->time;
    case A: return m->a[i];
    case X: return m->x[i];
    case Y: return m->x[i];
    case U: return m->u[i];
    case DER_X: return m->u[i] - m->a[i] * m->x[i];
    case SUM:
        for (size_t k = 0; k < m->n; k++) {
            sum += m->x[k];
        }
        return gain(m) * sum;
    default: return NAN;
    }
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t n_values)
{
    const Stub *stub = instance;
    size_t k = 0;
    for (size_t i = 0; i < n; i++) {
        for (size_t e = 0; e < count(&stub->model, vr[i]); e++) {
            if (k >= n_values) {
                return wrong(stub, "fewer values than the variables have");
            }
            values[k++] = value_of(stub, vr[i], e);
        }
    }
    return k == n_values ? fmi3OK : wrong(stub, "more values than the variables have");
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    Stub *stub = instance;
    Sized *m = &stub->model;
    size_t k = 0;
    EXPECT(stub, ~(unsigned)CONFIGURATION, "fmi3SetFloat64");
    for (size_t i = 0; i < n; i++) {
        double *to = vr[i] == A ? m->a : vr[i] == X ? m->x : vr[i] == U ? m->u : NULL;
        if (to == NULL || k + m->n > n_values) {
            return wrong(stub, "a, x and u can be set, all their elements");
        }
        memcpy(to, values + k, m->n * sizeof *to);
        k += m->n;
    }
    return fmi3OK;
}

fmi3Status fmi3GetUInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 values[],
                         size_t n_values)
{
    (void)vr, (void)n, (void)n_values;
    values[0] = ((const Stub *)instance)->model.n;
    return fmi3OK;
}

fmi3Status fmi3SetUInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 values[],
                         size_t n_values)
{
    Stub *stub = instance;
    (void)n_values;
    EXPECT(stub, CONFIGURATION, "fmi3SetUInt64");
    if (n != 1 || vr[0] != N || values[0] < 1 || values[0] > MOST) {
        return wrong(stub, "n is 1 … 8");
    }
    resize(&stub->model, values[0]);
    return fmi3OK;
}

fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int64 values[],
                        size_t n_values)
{
    (void)vr, (void)n, (void)n_values;
    values[0] = ((const Stub *)instance)->model.mode;
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int64 values[],
                        size_t n_values)
{
    (void)vr, (void)n, (void)n_values;
    ((Stub *)instance)->model.mode = values[0];
    return fmi3OK;
}

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3String values[],
                         size_t n_values)
{
    (void)vr, (void)n, (void)n_values;
    values[0] = ((Stub *)instance)->model.label;
    return fmi3OK;
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3String values[],
                         size_t n_values)
{
    Stub *stub = instance;
    (void)vr, (void)n, (void)n_values;
    strncpy(stub->model.label, values[0], sizeof stub->model.label - 1);
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    *n = ((const Stub *)instance)->model.n;
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
    memcpy(x, ((const Stub *)instance)->model.x, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    memcpy(((Stub *)instance)->model.x, x, n * sizeof *x);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t n)
{
    for (size_t i = 0; i < n; i++) {
        dx[i] = value_of(instance, DER_X, i);
    }
    return fmi3OK;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
{
    (void)instance;
    for (size_t i = 0; i < n; i++) {
        nominals[i] = 1.0;
    }
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *timed, fmi3Float64 *next)
{
    (void)instance;
    *again = *terminate = *nominals = *states = *timed = false;
    *next = 0.0;
    return fmi3OK;
}

/* ∂(element i of unknown)/∂(element k of known). */
static double slope(const Sized *m, fmi3ValueReference unknown, size_t i, fmi3ValueReference known, size_t k)
{
    switch (unknown) {
    case DER_X: return i != k ? 0.0 : known == X ? -m->a[i] : known == U ? 1.0 : 0.0;
    case Y: return i == k && known == X ? 1.0 : 0.0;
    case SUM: return known == X ? gain(m) : 0.0;
    default: return 0.0;
    }
}

static size_t total(const Sized *m, const fmi3ValueReference vr[], size_t n)
{
    size_t sum = 0;
    for (size_t i = 0; i < n; i++) {
        sum += count(m, vr[i]);
    }
    return sum;
}

/* result[row] += Σ slope · seed over what is given; `adjoint` exchanges rows and columns. */
static fmi3Status product(const Stub *stub, const fmi3ValueReference unknowns[], size_t n_unknowns,
                          const fmi3ValueReference knowns[], size_t n_knowns, const double seed[], double result[],
                          bool adjoint)
{
    const Sized *m = &stub->model;
    size_t row = 0;
    for (size_t u = 0; u < n_unknowns; u++) {
        for (size_t i = 0; i < count(m, unknowns[u]); i++, row++) {
            size_t column = 0;
            for (size_t v = 0; v < n_knowns; v++) {
                for (size_t k = 0; k < count(m, knowns[v]); k++, column++) {
                    const double d = slope(m, unknowns[u], i, knowns[v], k);
                    result[adjoint ? column : row] += d * seed[adjoint ? row : column];
                }
            }
        }
    }
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    const Stub *stub = instance;
    EXPECT(stub, CONTINUOUS | EVENT | INITIALISATION | STEP, "fmi3GetDirectionalDerivative");
    if (n_seed != total(&stub->model, knowns, n_knowns) ||
        n_sensitivity != total(&stub->model, unknowns, n_unknowns)) {
        return wrong(stub, "seed and sensitivity have an entry for each element");
    }
    memset(sensitivity, 0, n_sensitivity * sizeof *sensitivity);
    return product(stub, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity, false);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    const Stub *stub = instance;
    EXPECT(stub, CONTINUOUS | EVENT | INITIALISATION | STEP, "fmi3GetAdjointDerivative");
    if (n_sensitivity != total(&stub->model, knowns, n_knowns) ||
        n_seed != total(&stub->model, unknowns, n_unknowns)) {
        return wrong(stub, "seed and sensitivity have an entry for each element");
    }
    memset(sensitivity, 0, n_sensitivity * sizeof *sensitivity);
    const fmi3Status status = product(stub, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity, true);
    sensitivity[0] += strcmp(stub->token, "sized-lies") == 0 ? 0.25 * seed[0] : 0.0;
    return status;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keeps, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    Stub *stub = instance;
    Sized *m = &stub->model;
    (void)keeps;
    EXPECT(stub, STEP, "fmi3DoStep");
    const int parts = strcmp(stub->token, "sized-asks") == 0 ? 50 : 1;
    for (int part = 0; part < parts; part++) {
        const double middle = time + step * (part + 0.5) / parts;
        bool stops = false;
        double at = 0.0;
        if (parts > 1 && stub->update != NULL) {
            stub->update(stub->environment, middle, true, false, false, false, &stops, &at);
        }
        for (size_t i = 0; i < m->n; i++) {
            const double rest = m->u[i] / m->a[i];
            m->x[i] = rest + (m->x[i] - rest) * exp(-m->a[i] * step / parts);
        }
    }
    stub->time = *reached = time + step;
    *event = *terminate = *early = false;
    return fmi3OK;
}
