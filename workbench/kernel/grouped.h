/* grouped.h: slopes of a function of the states by moving several of them at once.
 *
 * States that move different values, as far as the file says, move together: A. Curtis, M. Powell, J. Reid, On the
 * estimation of sparse Jacobian matrices, J. Inst. Maths Applics 13 (1974). What the file says is not believed: one
 * more evaluation, all states moved by amounts of no simple ratio, must agree.
 */
#ifndef WORKBENCH_KERNEL_GROUPED_H
#define WORKBENCH_KERNEL_GROUPED_H

#include "solver.h"

/* A function whose slopes are wanted at x. */
typedef struct {
    size_t n, n_values;
    const double *x, *scale; /* [n] the states and their sizes */
    const double *here;      /* [n_values] the function at x */
    double *moved, *step;    /* [n] scratch: states elsewhere, and how far they are moved */
    double *there;           /* [n_values] scratch: the function elsewhere, less that at x */
    double *sums;            /* [3 n_values] scratch */
    void *owner;
    Evaluation (*evaluate)(void *owner, const double *x, double *values);
    double *(*slope)(void *owner, size_t state, size_t row); /* where a slope is kept */
} Sloped;

/* Move some states: fill `there` and, of the states that are moved, `step`. */
typedef Evaluation (*Move)(const Sloped *sloped, const size_t *members, size_t n, double side);

/* By forward differences, to the given side; from the other where the function cannot be evaluated there. */
Evaluation grouped_move(const Sloped *sloped, const size_t *members, size_t n, double side);

/* Keep the slopes that the groups may have; single: each state by itself, all slopes. */
Evaluation grouped_fill(const Sloped *sloped, const Groups *groups, bool single, Move move, double side);

/* Whether the function moves as the slopes say when all states do; EVALUATED: it does. `turn`: another one each time. */
Evaluation grouped_confirm(const Sloped *sloped, const Groups *groups, double turn);

#endif
