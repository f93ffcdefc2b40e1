/* gear_newton.h: CVODE's Newton matrix, banded or dense, and the solver of its equations.
 *
 * SUNDIALS' objects are a content and a table of operations. Its banded ones are not among the libraries that FMPy
 * ships, and its solver takes twice the time, so these are ours, made of `banded.h`. Where in its table an object keeps an operation is looked up in a dense
 * one, by the addresses of its functions: the order may differ between versions.
 */
#ifndef WORKBENCH_KERNEL_GEAR_NEWTON_H
#define WORKBENCH_KERNEL_GEAR_NEWTON_H

#include "banded.h"
#include "cvode.h"
#include "solver.h"

typedef struct GearNewton GearNewton;

/* The sparsity of a banded matrix, or NULL: a dense one, which is CVODE's own.
 * NULL: memory is short, or SUNDIALS' objects are not what they are taken for. */
GearNewton *gear_newton_new(const Sundials *c, Pointer context, const Sparsity *sparsity, size_t n);
/* CVODE's objects; NULL: memory is short. The matrix is destroyed as any of CVODE's; both before `gear_newton_free`. */
Pointer gear_newton_matrix(GearNewton *newton);
Pointer gear_newton_solver(GearNewton *newton);
void gear_newton_free_solver(const GearNewton *newton, Pointer solver);
void gear_newton_free(GearNewton *newton);

/* What CVODE's banded matrix is made of. */
Banded *banded_of(Pointer matrix);

#endif
