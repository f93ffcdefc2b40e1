/* explicit.c: Dormand-Prince 5(4) with dense output of order 4.
 *
 * Source: J. R. Dormand, P. J. Prince, J. Comp. Appl. Math. 6 (1980) 19-26; dense output: E. Hairer,
 * S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.6.
 * Not for stiff models: there the step is limited by stability.
 */
#include "solver.h"

#define STAGES 7
#define DENSE 5

typedef struct {
    double *work;
    double *k[STAGES];
    double *dense[DENSE];
} Data;

static const double node[STAGES] = {0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0};

static const double coefficient[STAGES][STAGES - 1] = {
    {0.0},
    {1.0 / 5.0},
    {3.0 / 40.0, 9.0 / 40.0},
    {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
    {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
    {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
    {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0},
};

static const double error_weight[STAGES] = {71.0 / 57600.0,      0.0,          -71.0 / 16695.0, 71.0 / 1920.0,
                                            -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0};

static const double dense_weight[STAGES] = {
    -12715105075.0 / 11282082432.0, 0.0, 87487479700.0 / 32700410799.0, -10690763975.0 / 1880347072.0,
    701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0, 69997945.0 / 29380423.0};

static void destroy(const Memory *memory, void *pointer)
{
    Data *data = pointer;
    if (data != NULL) {
        memory_delete(memory, data->work);
        memory_delete(memory, data);
    }
}

static void *create(const Memory *memory, size_t n)
{
    Data *data = memory_new(memory, 1, sizeof *data);
    if (data == NULL) {
        return NULL;
    }
    data->work = memory_new(memory, (STAGES + DENSE) * n, sizeof(double));
    if (data->work == NULL) {
        destroy(memory, data);
        return NULL;
    }
    for (size_t i = 0; i < STAGES; i++) {
        data->k[i] = data->work + i * n;
    }
    for (size_t i = 0; i < DENSE; i++) {
        data->dense[i] = data->work + (STAGES + i) * n;
    }
    return data;
}

static void begin(Solver *s)
{
    (void)s;
}

static double weighted_sum(const Data *data, const double *weights, size_t stages, size_t i)
{
    double sum = 0.0;
    for (size_t j = 0; j < stages; j++) {
        sum += weights[j] * data->k[j][i];
    }
    return sum;
}

static bool evaluate_stage(Solver *s, Data *data, size_t stage, double h)
{
    for (size_t i = 0; i < s->n; i++) {
        s->x_new[i] = s->x[i] + h * weighted_sum(data, coefficient[stage], stage, i);
    }
    return solver_evaluate(s, s->t + node[stage] * h, s->x_new, data->k[stage]);
}

static void prepare_dense(const Solver *s, Data *data, double h)
{
    for (size_t i = 0; i < s->n; i++) {
        double change = s->x_new[i] - s->x[i];
        double bend = h * data->k[0][i] - change;
        data->dense[0][i] = s->x[i];
        data->dense[1][i] = change;
        data->dense[2][i] = bend;
        data->dense[3][i] = change - h * data->k[STAGES - 1][i] - bend;
        data->dense[4][i] = h * weighted_sum(data, dense_weight, STAGES, i);
    }
}

static bool attempt(Solver *s, double h)
{
    Data *data = s->data;
    memcpy(data->k[0], s->dx, s->n * sizeof(double));
    for (size_t stage = 1; stage < STAGES; stage++) { /* the last one is the new state's derivative */
        if (!evaluate_stage(s, data, stage, h)) {
            return false;
        }
    }
    for (size_t i = 0; i < s->n; i++) {
        s->error[i] = h * weighted_sum(data, error_weight, STAGES, i);
    }
    prepare_dense(s, data, h);
    return true;
}

static bool accept(Solver *s)
{
    const Data *data = s->data;
    memcpy(s->dx, data->k[STAGES - 1], s->n * sizeof(double));
    return true;
}

static void interpolate(const Solver *s, double theta, double *x)
{
    const Data *data = s->data;
    double *const *d = data->dense;
    double rest = 1.0 - theta;
    for (size_t i = 0; i < s->n; i++) {
        double inner = d[2][i] + theta * (d[3][i] + rest * d[4][i]);
        x[i] = d[0][i] + theta * (d[1][i] + rest * inner);
    }
}

const Method method_explicit = {
    .name = "Dormand-Prince 5(4)",
    .error_exponent = 0.17,
    .memory_exponent = 0.04,
    .hold_below = 1.0,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .attempt = attempt,
    .accept = accept,
    .interpolate = interpolate,
};
