/* gear_banded.h: a banded Newton matrix for CVODE, whose own is dense.
 *
 * SUNDIALS' objects are a content and a table of operations. Its banded ones are not among the libraries that FMPy
 * ships, so these are ours, made of `banded.h`. Where in its table an object keeps an operation is looked up in a dense
 * one, by the addresses of its functions: the order may differ between versions.
 */
#ifndef WORKBENCH_KERNEL_GEAR_BANDED_H
#define WORKBENCH_KERNEL_GEAR_BANDED_H

#include "banded.h"
#include "cvode.h"
#include "solver.h"

typedef struct BandedNewton BandedNewton;

/* NULL: memory is short, or SUNDIALS' objects are not what they are taken for. */
BandedNewton *gear_banded_new(const Sundials *c, Pointer context, const Sparsity *sparsity, size_t n);
/* CVODE's objects; NULL: memory is short. The matrix is destroyed as any of CVODE's; both before `gear_banded_free`. */
Pointer gear_banded_matrix(BandedNewton *newton);
Pointer gear_banded_solver(BandedNewton *newton);
void gear_banded_free_solver(const BandedNewton *newton, Pointer solver);
void gear_banded_free(BandedNewton *newton);

/* What CVODE's matrix is made of. */
Banded *banded_of(Pointer matrix);

#endif
