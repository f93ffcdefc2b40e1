/* banded.c: Gaussian elimination with partial pivoting in a band.
 *
 * Source: G. Golub, C. Van Loan, Matrix Computations, 4th ed., section 4.3.5; the storage is LAPACK's for dgbtrf.
 */
#include "banded.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static size_t smaller(size_t a, size_t b) { return a < b ? a : b; }

Banded *banded_new(size_t n, size_t below, size_t above)
{
    const size_t height = 2 * below + above + 1;
    Banded *m = calloc(1, sizeof *m + n * height * sizeof(double));
    if (m != NULL) {
        m->n = n;
        m->below = below;
        m->above = above;
        m->height = height;
    }
    return m;
}

void banded_zero(Banded *m) { memset(m->values, 0, m->n * m->height * sizeof(double)); }

void banded_copy(Banded *to, const Banded *from)
{
    memcpy(to->values, from->values, from->n * from->height * sizeof(double));
}

void banded_scale_add_identity(Banded *m, double c)
{
    for (size_t i = 0; i < m->n * m->height; i++) {
        m->values[i] *= c;
    }
    for (size_t j = 0; j < m->n; j++) {
        *banded_at(m, j, j) += 1.0;
    }
}

/* The largest entry of a column, on or below the diagonal. */
static size_t pivot_of(Banded *m, size_t j, size_t last)
{
    size_t best = j;
    for (size_t i = j + 1; i <= last; i++) {
        if (fabs(*banded_at(m, i, j)) > fabs(*banded_at(m, best, j))) {
            best = i;
        }
    }
    return best;
}

static void swap_rows(Banded *m, size_t a, size_t b, size_t from, size_t to)
{
    for (size_t column = from; column <= to; column++) {
        double *x = banded_at(m, a, column), *y = banded_at(m, b, column);
        const double kept = *x;
        *x = *y;
        *y = kept;
    }
}

bool banded_factor(Banded *m, size_t *pivots)
{
    size_t reach = 0; /* the last column that a pivot row so far has */
    for (size_t j = 0; j < m->n; j++) {
        const size_t last = smaller(m->n - 1, j + m->below), pivot = pivot_of(m, j, last);
        pivots[j] = pivot;
        if (*banded_at(m, pivot, j) == 0.0 || !isfinite(*banded_at(m, pivot, j))) {
            return false;
        }
        reach = smaller(m->n - 1, reach > pivot + m->above ? reach : pivot + m->above);
        if (pivot != j) {
            swap_rows(m, j, pivot, j, reach);
        }
        double *column = banded_at(m, j, j);
        for (size_t i = 1; i <= last - j; i++) {
            column[i] /= column[0];
        }
        for (size_t k = j + 1; k <= reach; k++) {
            double *other = banded_at(m, j, k);
            for (size_t i = 1; i <= last - j; i++) {
                other[i] -= column[i] * other[0];
            }
        }
    }
    return true;
}

void banded_solve(const Banded *m, const size_t *pivots, double *x)
{
    const size_t up = m->below + m->above;
    for (size_t j = 0; j < m->n; j++) {
        const double *column = &m->values[j * m->height + up];
        const double kept = x[pivots[j]];
        x[pivots[j]] = x[j];
        x[j] = kept;
        for (size_t i = 1; i <= smaller(m->n - 1, j + m->below) - j; i++) {
            x[j + i] -= column[i] * kept;
        }
    }
    for (size_t j = m->n; j-- > 0;) {
        const double *column = &m->values[j * m->height + up];
        x[j] /= column[0];
        for (size_t i = 1; i <= smaller(j, up); i++) {
            x[j - i] -= column[-(ptrdiff_t)i] * x[j];
        }
    }
}
