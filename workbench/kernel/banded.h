/* banded.h: square matrices whose entries lie in a band around the diagonal, and systems of equations with them. */
#ifndef WORKBENCH_KERNEL_BANDED_H
#define WORKBENCH_KERNEL_BANDED_H

#include <stdbool.h>
#include <stddef.h>

/* Column by column; `below` further diagonals above the band are room for what pivoting fills. */
typedef struct {
    size_t n, below, above;
    size_t height; /* of a column: 2 below + above + 1 */
    double values[];
} Banded;

/* Zeros; NULL: memory is short. */
Banded *banded_new(size_t n, size_t below, size_t above);

static inline double *banded_at(Banded *m, size_t row, size_t column)
{
    return &m->values[column * m->height + m->below + m->above + row - column];
}

void banded_zero(Banded *m);
/* Both of the same shape. */
void banded_copy(Banded *to, const Banded *from);
/* m <- c m + 1 */
void banded_scale_add_identity(Banded *m, double c);
/* m <- L U with partial pivoting; pivots: [n] rows. False: singular. */
bool banded_factor(Banded *m, size_t *pivots);
/* x <- solution of m x = b with b in x, by the factors. */
void banded_solve(const Banded *m, const size_t *pivots, double *x);

#endif
