#include "fourier.h"

#include <math.h>
#include <string.h>

static const double TWO_PI = 6.283185307179586476925286766559;

static size_t width(const Fourier *fourier) {
    return 1 + 2 * fourier->orders;
}

void fourier_clear(Fourier *fourier) {
    fourier->rows = 0;
    fourier->start = fourier->time = 0.0;
    memset(fourier->weights, 0, width(fourier) * sizeof(double));
    memset(fourier->sums, 0, fourier->n * width(fourier) * sizeof(double));
    memset(fourier->largest, 0, fourier->n * sizeof(double));
}

/* 1, sin, cos, sin 2, cos 2, … by the addition theorems. */
static void fill_basis(const Fourier *fourier, double t, double *basis) {
    const double angle = TWO_PI * fourier->frequency * (t - fourier->begin);
    const double s = sin(angle);
    const double c = cos(angle);
    basis[0] = 1.0;
    for (size_t k = 1; k <= fourier->orders; k++) {
        const double sn = k == 1 ? s : basis[2 * k - 3] * c + basis[2 * k - 2] * s;
        const double cn = k == 1 ? c : basis[2 * k - 2] * c - basis[2 * k - 3] * s;
        basis[2 * k - 1] = sn;
        basis[2 * k] = cn;
    }
}

static void begin(Fourier *fourier, const double *row) {
    fourier->start = row[0];
    for (size_t i = 0; i < fourier->n; i++) {
        fourier->first[i] = row[fourier->columns[i]];
        fourier->last[i] = 0.0;
    }
    fill_basis(fourier, row[0], fourier->basis + width(fourier));
}

/* Add the trapezoids between the last row and this one. */
static void integrate(Fourier *fourier, const double *row) {
    const size_t m = width(fourier);
    const double half = 0.5 * (row[0] - fourier->time);
    double *before = fourier->basis;
    double *now = fourier->basis + m;
    memcpy(before, now, m * sizeof(double));
    fill_basis(fourier, row[0], now);
    for (size_t k = 0; k < m; k++) {
        fourier->weights[k] += half * (before[k] + now[k]);
    }
    for (size_t i = 0; i < fourier->n; i++) {
        const double y = row[fourier->columns[i]] - fourier->first[i];
        double *sums = fourier->sums + i * m;
        for (size_t k = 0; k < m; k++) {
            sums[k] += half * (fourier->last[i] * before[k] + y * now[k]);
        }
    }
}

void fourier_add(Fourier *fourier, const double *row) {
    if (fourier->rows == 0) {
        begin(fourier, row);
    } else if (row[0] > fourier->time) {
        integrate(fourier, row);
    }
    for (size_t i = 0; i < fourier->n; i++) {
        const double y = row[fourier->columns[i]];
        fourier->last[i] = y - fourier->first[i];
        fourier->largest[i] = fmax(fourier->largest[i], fabs(y));
    }
    fourier->time = row[0];
    fourier->rows++;
}

void fourier_result(const Fourier *fourier, double *coefficients) {
    const size_t m = width(fourier);
    const double span = fourier->time - fourier->start;
    for (size_t i = 0; i < fourier->n; i++) {
        const double *sums = fourier->sums + i * m;
        const double mean = sums[0] / span;
        coefficients[i * m] = fourier->first[i] + mean;
        for (size_t k = 1; k < m; k++) {
            coefficients[i * m + k] = 2.0 * (sums[k] - mean * fourier->weights[k]) / span;
        }
    }
}
