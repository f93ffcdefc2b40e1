/* implicit.c: Radau IIA, three stages, order 5, L-stable, with its collocation polynomial as dense output.
 *
 * Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.8. Each step
 * solves the collocation system by simplified Newton iterations in the transformed variables
 * W = T^-1 Z, where it falls into one real and one complex system of n equations; the complex one is
 * solved as 2n real equations. The Jacobian is exact: one directional derivative a column.
 */
#include "solver.h"

#include "lu.h"

#include <float.h>
#include <math.h>

#define STAGES 3
#define MOST_ITERATIONS 7
#define SQRT6 2.449489742783178098

static const double node[STAGES] = {(4.0 - SQRT6) / 10.0, (4.0 + SQRT6) / 10.0, 1.0};
static const double error_weight[STAGES] = {(-13.0 - 7.0 * SQRT6) / 3.0, (-13.0 + 7.0 * SQRT6) / 3.0, -1.0 / 3.0};

/* Eigenvalues of the inverse of the method's matrix. */
static const double real_eigenvalue = 3.637834252744496;
static const double complex_eigenvalue_re = 2.681082873627752;
static const double complex_eigenvalue_im = -3.050430199247411;

static const double to_z[STAGES][STAGES] = {
    {0.09443876248897524, -0.14125529502095421, 0.03002919410514742},
    {0.25021312296533332, 0.20412935229379994, -0.38294211275726192},
    {1.0, 1.0, 0.0},
};
static const double to_w[STAGES][STAGES] = {
    {4.17871859155190428, 0.32768282076106237, 0.52337644549944951},
    {-4.17871859155190428, -0.32768282076106237, 0.47662355450055044},
    {0.50287263494578682, -2.57192694985560522, 0.59603920482822492},
};
/* Collocation polynomial: coefficients of theta, theta^2, theta^3 from the stages. */
static const double dense_weight[STAGES][STAGES] = {
    {(13.0 + 7.0 * SQRT6) / 3.0, (-23.0 - 22.0 * SQRT6) / 3.0, 10.0 / 3.0 + 5.0 * SQRT6},
    {(13.0 - 7.0 * SQRT6) / 3.0, (-23.0 + 22.0 * SQRT6) / 3.0, 10.0 / 3.0 - 5.0 * SQRT6},
    {1.0 / 3.0, -8.0 / 3.0, 10.0 / 3.0},
};

typedef struct {
    double *work;
    size_t *pivots;
    double *jacobian;        /* n by n */
    double *real_matrix;     /* n by n, decomposed */
    double *complex_matrix;  /* 2n by 2n, decomposed */
    size_t *real_pivots, *complex_pivots;
    double *z[STAGES], *w[STAGES], *f[STAGES];
    double *dense[STAGES];
    double *side;            /* right-hand side, 3n: real part, then the complex one */
    double *state;           /* n */
    double factored_h;       /* step size of the decompositions, 0: none */
    double last_h;           /* size of the step `dense` belongs to, 0: none */
    bool jacobian_current;   /* of this very (t, x) */
    bool jacobian_known;
    bool slow;               /* Newton converged slowly with it */
} Data;

static void destroy(const Memory *memory, void *pointer)
{
    Data *data = pointer;
    if (data != NULL) {
        memory_delete(memory, data->work);
        memory_delete(memory, data->pivots);
        memory_delete(memory, data);
    }
}

static void bind_vectors(Data *d, size_t n)
{
    d->jacobian = d->work;
    d->real_matrix = d->jacobian + n * n;
    d->complex_matrix = d->real_matrix + n * n;
    double *next = d->complex_matrix + 4 * n * n;
    for (size_t i = 0; i < STAGES; i++) {
        d->z[i] = next + (4 * i + 0) * n;
        d->w[i] = next + (4 * i + 1) * n;
        d->f[i] = next + (4 * i + 2) * n;
        d->dense[i] = next + (4 * i + 3) * n;
    }
    d->side = next + 4 * STAGES * n;
    d->state = d->side + STAGES * n;
    d->real_pivots = d->pivots;
    d->complex_pivots = d->pivots + n;
}

static void *create(const Memory *memory, size_t n)
{
    Data *data = memory_new(memory, 1, sizeof *data);
    if (data == NULL) {
        return NULL;
    }
    data->work = memory_new(memory, 6 * n * n + (5 * STAGES + 1) * n, sizeof(double));
    data->pivots = memory_new(memory, 3 * n, sizeof(size_t));
    if (data->work == NULL || data->pivots == NULL) {
        destroy(memory, data);
        return NULL;
    }
    bind_vectors(data, n);
    return data;
}

static void begin(Solver *s)
{
    Data *d = s->data;
    d->factored_h = 0.0;
    d->last_h = 0.0;
    d->jacobian_current = false;
    d->jacobian_known = false;
    d->slow = false;
}

/* Jacobian at (t, x), column by column, relations frozen. */
static bool evaluate_jacobian(Solver *s, Data *d)
{
    const double seed = 1.0;
    if (!solver_evaluate(s, s->t, s->x, s->dx)) {
        return false;
    }
    for (size_t j = 0; j < s->n; j++) {
        if (!core_directional(s->core, model_info.derivatives, s->n, &model_info.states[j], 1, &seed, d->state)) {
            return false;
        }
        for (size_t i = 0; i < s->n; i++) {
            d->jacobian[i * s->n + j] = d->state[i];
        }
    }
    d->jacobian_current = true;
    d->jacobian_known = true;
    d->slow = false;
    d->factored_h = 0.0;
    return true;
}

static void fill_real(const Data *d, size_t n, double shift)
{
    for (size_t i = 0; i < n * n; i++) {
        d->real_matrix[i] = -d->jacobian[i];
    }
    for (size_t i = 0; i < n; i++) {
        d->real_matrix[i * n + i] += shift;
    }
}

/* (re + i im) I - J as [[re I - J, -im I], [im I, re I - J]]. */
static void fill_complex(const Data *d, size_t n, double re, double im)
{
    size_t m = 2 * n;
    memset(d->complex_matrix, 0, m * m * sizeof(double));
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            d->complex_matrix[i * m + j] = -d->jacobian[i * n + j];
            d->complex_matrix[(n + i) * m + n + j] = -d->jacobian[i * n + j];
        }
        d->complex_matrix[i * m + i] += re;
        d->complex_matrix[(n + i) * m + n + i] += re;
        d->complex_matrix[i * m + n + i] = -im;
        d->complex_matrix[(n + i) * m + i] = im;
    }
}

static bool decompose(Data *d, size_t n, double h)
{
    fill_real(d, n, real_eigenvalue / h);
    fill_complex(d, n, complex_eigenvalue_re / h, complex_eigenvalue_im / h);
    d->factored_h = 0.0;
    if (!lu_factor(d->real_matrix, d->real_pivots, n) || !lu_factor(d->complex_matrix, d->complex_pivots, 2 * n)) {
        return false;
    }
    d->factored_h = h;
    return true;
}

/* First guess of the stages: the last step's polynomial carried on, else the present slope. */
static void guess_stages(const Solver *s, Data *d, double h)
{
    for (size_t k = 0; k < STAGES; k++) {
        double theta = d->last_h > 0.0 ? 1.0 + node[k] * h / d->last_h : 0.0;
        for (size_t i = 0; i < s->n; i++) {
            double carried = theta * (d->dense[0][i] + theta * (d->dense[1][i] + theta * d->dense[2][i]));
            double end = d->dense[0][i] + d->dense[1][i] + d->dense[2][i];
            d->z[k][i] = d->last_h > 0.0 ? carried - end : node[k] * h * s->dx[i];
        }
    }
}

static void transform(double *const *to, double *const *from, const double matrix[STAGES][STAGES], size_t n)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < STAGES; k++) {
            to[k][i] = matrix[k][0] * from[0][i] + matrix[k][1] * from[1][i] + matrix[k][2] * from[2][i];
        }
    }
}

static bool evaluate_stages(Solver *s, Data *d, double h)
{
    for (size_t k = 0; k < STAGES; k++) {
        for (size_t i = 0; i < s->n; i++) {
            d->state[i] = s->x[i] + d->z[k][i];
        }
        if (!solver_evaluate(s, s->t + node[k] * h, d->state, d->f[k])) {
            return false;
        }
    }
    return true;
}

static void newton_side(const Data *d, size_t n, double h)
{
    for (size_t i = 0; i < n; i++) {
        double g[STAGES];
        for (size_t k = 0; k < STAGES; k++) {
            g[k] = to_w[k][0] * d->f[0][i] + to_w[k][1] * d->f[1][i] + to_w[k][2] * d->f[2][i];
        }
        double re = complex_eigenvalue_re / h;
        double im = complex_eigenvalue_im / h;
        d->side[i] = g[0] - real_eigenvalue / h * d->w[0][i];
        d->side[n + i] = g[1] - (re * d->w[1][i] - im * d->w[2][i]);
        d->side[2 * n + i] = g[2] - (im * d->w[1][i] + re * d->w[2][i]);
    }
}

/* One Newton correction; returns its weighted size, infinite when it went wrong. */
static double correct(Solver *s, Data *d, double h)
{
    size_t n = s->n;
    double largest = 0.0;
    newton_side(d, n, h);
    lu_solve(d->real_matrix, d->real_pivots, n, d->side);
    lu_solve(d->complex_matrix, d->complex_pivots, 2 * n, d->side + n);
    for (size_t k = 0; k < STAGES; k++) {
        largest = fmax(largest, solver_norm(s, d->side + k * n));
        for (size_t i = 0; i < n; i++) {
            d->w[k][i] += d->side[k * n + i];
        }
    }
    transform(d->z, d->w, to_z, n);
    return largest;
}

static bool will_diverge(double rate, double size, double goal, int left)
{
    return rate >= 1.0 || pow(rate, (double)left) / (1.0 - rate) * size > goal;
}

/* A correction far below its goal ends the iterations, the first one too: at rest all are rounding, and their rate is
 * near 1, which would pass for divergence.
 */
static bool newton(Solver *s, Data *d, double h)
{
    double rounding = 10.0 * DBL_EPSILON / s->tolerance;
    double goal = fmax(rounding, fmin(0.01, sqrt(s->tolerance)));
    double negligible = fmax(rounding, 1e-3 * goal);
    double previous = 0.0;
    transform(d->w, d->z, to_w, s->n);
    for (int i = 0; i < MOST_ITERATIONS; i++) {
        if (!evaluate_stages(s, d, h)) {
            return false;
        }
        double size = correct(s, d, h);
        double rate = i > 0 && previous > 0.0 ? size / previous : 0.0;
        bool small = size <= negligible;
        if (!isfinite(size) || (!small && i > 0 && will_diverge(rate, size, goal, MOST_ITERATIONS - i))) {
            return false;
        }
        if (small || (i > 0 && rate / (1.0 - rate) * size < goal)) {
            d->slow = i > 2 && rate > 1e-3;
            return true;
        }
        previous = size;
    }
    return false;
}

static bool solve_stages(Solver *s, Data *d, double h)
{
    for (;;) {
        if ((!d->jacobian_known || (d->slow && !d->jacobian_current)) && !evaluate_jacobian(s, d)) {
            return false;
        }
        if (d->factored_h != h && !decompose(d, s->n, h)) {
            return false;
        }
        guess_stages(s, d, h);
        if (newton(s, d, h)) {
            return true;
        }
        if (d->jacobian_current) {
            return false;
        }
        d->jacobian_known = false; /* an old one: try once more with the present one */
    }
}

static void raw_error(const Solver *s, const Data *d, double h, const double *slope)
{
    for (size_t i = 0; i < s->n; i++) {
        double sum = error_weight[0] * d->z[0][i] + error_weight[1] * d->z[1][i] + error_weight[2] * d->z[2][i];
        s->error[i] = slope[i] + sum / h;
    }
    lu_solve(d->real_matrix, d->real_pivots, s->n, s->error);
}

/* The plain estimate is too large in very stiff components: filtered once more where it fails. */
static bool estimate_error(Solver *s, Data *d, double h)
{
    raw_error(s, d, h, s->dx);
    if (solver_norm(s, s->error) <= 1.0) {
        return true;
    }
    for (size_t i = 0; i < s->n; i++) {
        d->state[i] = s->x[i] + s->error[i];
    }
    if (!solver_evaluate(s, s->t, d->state, d->side)) {
        return false;
    }
    raw_error(s, d, h, d->side);
    return true;
}

static bool attempt(Solver *s, double h)
{
    Data *d = s->data;
    if (!solve_stages(s, d, h)) {
        return false;
    }
    for (size_t i = 0; i < s->n; i++) {
        s->x_new[i] = s->x[i] + d->z[STAGES - 1][i];
    }
    return estimate_error(s, d, h);
}

static void interpolate(const Solver *s, double theta, double *x)
{
    const Data *d = s->data;
    for (size_t i = 0; i < s->n; i++) {
        double sum = 0.0;
        for (size_t k = STAGES; k-- > 0;) {
            double c = dense_weight[0][k] * d->z[0][i] + dense_weight[1][k] * d->z[1][i]
                + dense_weight[2][k] * d->z[2][i];
            sum = theta * (c + sum);
        }
        x[i] = s->x[i] + sum;
    }
}

static bool accept(Solver *s)
{
    Data *d = s->data;
    for (size_t i = 0; i < s->n; i++) {
        for (size_t k = 0; k < STAGES; k++) {
            d->dense[k][i] = dense_weight[0][k] * d->z[0][i] + dense_weight[1][k] * d->z[1][i]
                + dense_weight[2][k] * d->z[2][i];
        }
    }
    d->last_h = s->h;
    d->jacobian_current = false;
    return solver_evaluate(s, s->t, s->x, s->dx);
}

const Method method_implicit = {
    .name = "Radau IIA of order 5",
    .error_exponent = 0.25,
    .memory_exponent = 0.0,
    .hold_below = 1.2,
    .create = create,
    .destroy = destroy,
    .begin = begin,
    .attempt = attempt,
    .accept = accept,
    .interpolate = interpolate,
};
