/* fourier.h: mean and harmonics of rows that come one by one.
 *
 * The same integrals as workbench/response/periodic/fourier.py, to rounding: the trapezoidal rule over an even grid, and
 * what the jumps between two rows with one time add to it (see there); or over all rows. The first row's value is
 * taken off first, so that a large constant part leaves no rounding.
 */
#ifndef WORKBENCH_KERNEL_FOURIER_H
#define WORKBENCH_KERNEL_FOURIER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    double begin;     /* time at which the phase is zero [s] */
    double frequency; /* [Hz] */
    size_t orders;    /* number of harmonics, at least 1 */
    size_t n;         /* number of signals */
    const size_t *columns; /* [n] in the row: time is column 0 */
    /* What the caller knows of the basis: its values [n_known][1 + 2 orders] at rising times [n_known]; NULL: nothing. */
    const double *known, *known_times;
    size_t n_known;
    int32_t grid; /* the first row and the known times are an even grid; rows between them only tell of jumps */
    /* Memory of the caller, set up by `fourier_clear`. */
    double *basis;    /* [1 + 2 orders]: 1, sin, cos, sin 2, ... where it is not known */
    double *between;  /* [1 + 2 orders] the same at a jump between the nodes */
    double *weights;  /* [1 + 2 orders] ∫ basis, the last node's part left out */
    double *sums;     /* [n][1 + 2 orders] ∫ (y - y_first) · basis, likewise */
    double *first;    /* [n] */
    double *node;     /* [n] the values at the last node, less the first; every row is a node where there is no grid */
    double *last;     /* [n] the last row's values, likewise */
    double *largest;  /* [n] largest magnitude so far */
    double *jumped;   /* [n] sum of the jumps between rows with one time, which the sums know */
    double *nodes;    /* [n][8] values at the first four nodes behind the first, and at the last four, less these jumps */
    double *rough;    /* [n] sum of the magnitudes of the nodes' fourth differences */
    size_t n_nodes;   /* behind the first */
    double start, reached, time; /* [s] of the first row, the last node and the last row */
    double gap;         /* [s] between the last node and the one before it */
    double longest;     /* [s] largest distance of two rows */
    size_t rows;
    size_t next;      /* known time that is looked at */
    const double *at; /* [1 + 2 orders] basis at the last node */
} Fourier;

void fourier_clear(Fourier *fourier);
void fourier_add(Fourier *fourier, const double *row);
/* Coefficients [n][1 + 2 orders]: mean, then in-phase and quadrature part of each harmonic. */
void fourier_result(const Fourier *fourier, double *coefficients);

/* What edges between two nodes of a grid may put into a coefficient [n]: no more where the signal is monotone between
 * them; 0 where there is no grid. */
void fourier_rough(const Fourier *fourier, double *errors);

#endif
