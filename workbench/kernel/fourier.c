#include "fourier.h"

#include <math.h>
#include <string.h>

static const double TWO_PI = 6.283185307179586476925286766559;

static size_t width(const Fourier *fourier) {
    return 1 + 2 * fourier->orders;
}

void fourier_clear(Fourier *fourier) {
    fourier->rows = fourier->next = 0;
    fourier->at = fourier->basis;
    fourier->start = fourier->time = fourier->gap = fourier->longest = 0.0;
    memset(fourier->weights, 0, width(fourier) * sizeof(double));
    memset(fourier->sums, 0, fourier->n * width(fourier) * sizeof(double));
    memset(fourier->largest, 0, fourier->n * sizeof(double));
}

/* 1, sin, cos, sin 2, cos 2, … by the addition theorems; each order from two of about half of it. */
static void fill_basis(const Fourier *fourier, double t) {
    const double angle = TWO_PI * fourier->frequency * (t - fourier->begin);
    double *basis = fourier->basis;
    basis[0] = 1.0;
    basis[1] = sin(angle);
    basis[2] = cos(angle);
    for (size_t k = 2; k <= fourier->orders; k++) {
        const double *low = basis + 2 * (k / 2) - 1;
        const double *high = basis + 2 * (k - k / 2) - 1;
        const double s = low[0] * high[1] + low[1] * high[0];
        const double c = low[1] * high[1] - low[0] * high[0];
        basis[2 * k - 1] = s;
        basis[2 * k] = c;
    }
}

/* Most rows are at the caller's points. */
static void find_basis(Fourier *fourier, double t) {
    while (fourier->next < fourier->n_known && fourier->known_times[fourier->next] < t) {
        fourier->next++;
    }
    if (fourier->next < fourier->n_known && fourier->known_times[fourier->next] == t) {
        fourier->at = fourier->known + fourier->next * width(fourier);
    } else {
        fill_basis(fourier, t);
        fourier->at = fourier->basis;
    }
}

static void begin(Fourier *fourier, const double *row) {
    fourier->start = row[0];
    for (size_t i = 0; i < fourier->n; i++) {
        fourier->first[i] = row[fourier->columns[i]];
    }
    find_basis(fourier, row[0]);
}

static inline void add_scaled(double *restrict sums, double factor, const double *restrict basis, size_t m) {
    for (size_t k = 0; k < m; k++) {
        sums[k] += factor * basis[k];
    }
}

/* The last row's weight is known once the row behind it is: half the gaps on both sides. */
static void integrate(Fourier *fourier, double gap) {
    const size_t m = width(fourier);
    const double weight = 0.5 * (fourier->gap + gap);
    add_scaled(fourier->weights, weight, fourier->at, m);
    for (size_t i = 0; i < fourier->n; i++) {
        add_scaled(fourier->sums + i * m, weight * fourier->last[i], fourier->at, m);
    }
}

void fourier_add(Fourier *fourier, const double *row) {
    if (fourier->rows == 0) {
        begin(fourier, row);
    } else {
        const double gap = row[0] - fourier->time;
        integrate(fourier, gap);
        fourier->gap = gap;
        fourier->longest = fmax(fourier->longest, gap);
        if (gap > 0.0) {
            find_basis(fourier, row[0]);
        }
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
    const double weight = 0.5 * fourier->gap;
    for (size_t i = 0; i < fourier->n; i++) {
        const double *sums = fourier->sums + i * m;
        const double y = weight * fourier->last[i];
        const double mean = (sums[0] + y) / span;
        coefficients[i * m] = fourier->first[i] + mean;
        for (size_t k = 1; k < m; k++) {
            const double all = fourier->weights[k] + weight * fourier->at[k];
            coefficients[i * m + k] = 2.0 * (sums[k] + y * fourier->at[k] - mean * all) / span;
        }
    }
}
