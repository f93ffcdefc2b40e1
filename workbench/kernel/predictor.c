#include "predictor.h"

#include <string.h>

#include "kernel.h"

/* sum += matrix · vector. */
static void add_product(const double *matrix, const double *vector, size_t rows, size_t columns, double *sum) {
    for (size_t i = 0; i < rows; i++) {
        double part = 0.0;
        for (size_t j = 0; j < columns; j++) {
            part += matrix[i * columns + j] * vector[j];
        }
        sum[i] += part;
    }
}

void kernel_predict(const Predictor *model, size_t samples, const double *u, const double *y, double *state,
                    double *states, double *errors) {
    const size_t n = model->n;
    const size_t m = model->m;
    const size_t p = model->p;
    for (size_t k = 0; k < samples; k++) {
        double *x = states + k * n;
        double *e = errors + k * p;
        memcpy(x, state, n * sizeof *x);
        memcpy(e, model->offset, p * sizeof *e);
        add_product(model->c, x, p, n, e);
        add_product(model->d, u + k * m, p, m, e);
        for (size_t r = 0; r < p; r++) {
            e[r] = y[k * p + r] - e[r];
        }
        memset(state, 0, n * sizeof *state);
        add_product(model->a, x, n, n, state);
        add_product(model->b, u + k * m, n, m, state);
        add_product(model->k, e, n, p, state);
    }
}

void kernel_sensitivities(const double *f, const double *c, size_t n, size_t p, size_t count, size_t samples,
                          const double *signals, double *rows, double *out) {
    const size_t size = p * count * n;
    for (size_t k = 0; k < samples; k++) {
        const double *now = out + k * size;
        memcpy(out + k * size, rows, size * sizeof *rows);
        for (size_t r = 0; r < p; r++) {
            for (size_t s = 0; s < count; s++) {
                const double *from = now + (r * count + s) * n;
                double *to = rows + (r * count + s) * n;
                const double drive = signals[k * count + s];
                for (size_t j = 0; j < n; j++) {
                    to[j] = drive * c[r * n + j];
                }
                for (size_t i = 0; i < n; i++) {
                    const double weight = from[i];
                    for (size_t j = 0; j < n; j++) {
                        to[j] += weight * f[i * n + j];
                    }
                }
            }
        }
    }
}
