/* lu.c: Gaussian elimination with partial pivoting.
 *
 * Source: G. H. Golub, C. F. Van Loan, Matrix Computations, section 3.4.
 * Meant for the tens of states of one component; no blocking, no sparsity.
 */
#include "lu.h"

#include <math.h>

static size_t largest_in_column(const double *a, size_t n, size_t column)
{
    size_t best = column;
    for (size_t row = column + 1; row < n; row++) {
        if (fabs(a[row * n + column]) > fabs(a[best * n + column])) {
            best = row;
        }
    }
    return best;
}

static void swap_rows(double *a, size_t n, size_t first, size_t second)
{
    for (size_t column = 0; column < n && first != second; column++) {
        double kept = a[first * n + column];
        a[first * n + column] = a[second * n + column];
        a[second * n + column] = kept;
    }
}

static void eliminate_below(double *a, size_t n, size_t pivot)
{
    const double *upper = a + pivot * n;
    for (size_t row = pivot + 1; row < n; row++) {
        double *target = a + row * n;
        double factor = target[pivot] / upper[pivot];
        target[pivot] = factor;
        for (size_t column = pivot + 1; factor != 0.0 && column < n; column++) {
            target[column] -= factor * upper[column];
        }
    }
}

bool lu_factor(double *a, size_t *pivots, size_t n)
{
    for (size_t step = 0; step < n; step++) {
        pivots[step] = largest_in_column(a, n, step);
        swap_rows(a, n, step, pivots[step]);
        double pivot = a[step * n + step];
        if (pivot == 0.0 || !isfinite(pivot)) {
            return false;
        }
        eliminate_below(a, n, step);
    }
    return true;
}

static void solve_lower(const double *a, const size_t *pivots, size_t n, double *b)
{
    for (size_t row = 0; row < n; row++) {
        double kept = b[row];
        b[row] = b[pivots[row]];
        b[pivots[row]] = kept;
    }
    for (size_t row = 1; row < n; row++) {
        for (size_t column = 0; column < row; column++) {
            b[row] -= a[row * n + column] * b[column];
        }
    }
}

static void solve_upper(const double *a, size_t n, double *b)
{
    for (size_t row = n; row-- > 0;) {
        for (size_t column = row + 1; column < n; column++) {
            b[row] -= a[row * n + column] * b[column];
        }
        b[row] /= a[row * n + row];
    }
}

void lu_solve(const double *a, const size_t *pivots, size_t n, double *b)
{
    solve_lower(a, pivots, n, b);
    solve_upper(a, n, b);
}
