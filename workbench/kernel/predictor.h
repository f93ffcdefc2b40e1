/* predictor.h: the one-step predictor of a linear model in innovations form, and what its parameters do to it:
 *     e(k) = y(k) − C x(k) − D u(k) − offset,   x(k+1) = A x(k) + B u(k) + K e(k).
 * All matrices are by rows; the caller owns all memory.
 */
#ifndef WORKBENCH_KERNEL_PREDICTOR_H
#define WORKBENCH_KERNEL_PREDICTOR_H

#include <stddef.h>

/* A model with n states, m inputs and p outputs. */
typedef struct {
    size_t n, m, p;
    const double *a, *b, *c, *d, *k, *offset;
} Predictor;

#endif
