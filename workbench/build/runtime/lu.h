/* lu.h: dense linear systems, LU decomposition with partial pivoting. */
#ifndef WORKBENCH_LU_H
#define WORKBENCH_LU_H

#include <stdbool.h>
#include <stddef.h>

/* Replaces `a` (n by n, rows one after the other) by its factors; false when a pivot is 0 or not finite. */
bool lu_factor(double *a, size_t *pivots, size_t n);

/* Replaces the right-hand side `b` by the solution of the factored system. */
void lu_solve(const double *a, const size_t *pivots, size_t n, double *b);

#endif
