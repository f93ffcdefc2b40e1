/* fourier.h: mean and harmonics of rows that come one by one.
 *
 * The same integrals as workbench/analysis/harmonics.py, to rounding: the trapezoidal rule over all rows, two
 * rows with one time included, so that jumps are integrated exactly. The first row's value is taken off first,
 * so that a large constant part leaves no rounding.
 */
#ifndef WORKBENCH_KERNEL_FOURIER_H
#define WORKBENCH_KERNEL_FOURIER_H

#include <stdbool.h>
#include <stddef.h>

typedef struct {
    double begin;     /* time at which the phase is zero [s] */
    double frequency; /* [Hz] */
    size_t orders;    /* number of harmonics, at least 1 */
    size_t n;         /* number of signals */
    const size_t *columns; /* [n] in the row: time is column 0 */
    /* What the caller knows of the basis: its values [n_known][1 + 2 orders] at rising times [n_known]. */
    const double *known, *known_times;
    size_t n_known;
    /* Memory of the caller, set up by `fourier_clear`. */
    double *basis;    /* [1 + 2 orders]: 1, sin, cos, sin 2, ... where it is not known */
    double *weights;  /* [1 + 2 orders] ∫ basis, the last row's part left out */
    double *sums;     /* [n][1 + 2 orders] ∫ (y - y_first) · basis, likewise */
    double *first;    /* [n] */
    double *last;     /* [n] the last row's values, less the first */
    double *largest;  /* [n] largest magnitude so far */
    double start, time; /* [s] of the first and the last row */
    double gap;         /* [s] between the last row and the one before it */
    double longest;     /* [s] largest gap */
    size_t rows;
    size_t next;      /* known time that is looked at */
    const double *at; /* [1 + 2 orders] basis at the last row */
} Fourier;

void fourier_clear(Fourier *fourier);
void fourier_add(Fourier *fourier, const double *row);
/* Coefficients [n][1 + 2 orders]: mean, then in-phase and quadrature part of each harmonic. */
void fourier_result(const Fourier *fourier, double *coefficients);

#endif
