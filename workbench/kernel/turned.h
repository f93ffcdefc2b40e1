/* turned.h: event indicators that an event turned back, or stopped, at their zeros: none may go on across.
 *
 * The twin of tests/oracle/turned.py, which says why and how.
 */
#ifndef WORKBENCH_KERNEL_TURNED_H
#define WORKBENCH_KERNEL_TURNED_H

#include <stdbool.h>
#include <stddef.h>

#include "solver.h"

typedef struct {
    const Problem *problem;
    double since;                /* when the event was that turned the indicators under watch [s] */
    double ahead;                /* how far ahead the rates were looked at [s] */
    bool watches, known;         /* some indicator is under watch; `way` is known */
    double *side; /* [nz] where each indicator stood when the solver began anew: 1, -1; 0 not known */
    double *bound;               /* [nz] where an indicator must not go, beyond zero; 0: it may go anywhere */
    double *way, *old, *z, *new_way; /* [nz] */
    double *dx, *old_dx, *x;     /* [n] */
} Turned;

size_t turned_doubles(size_t n, size_t nz);
void turned_bind(Turned *turned, const Problem *problem, double *memory);
/* Begin as if there had been no event. */
void turned_forget(Turned *turned);
/* Note the sides on which the indicators stand where the solver begins anew. False: the problem failed for good. */
bool turned_stand(Turned *turned, double t, const double *x);
/* Look at the rates just before an event at (t, x); `scale`: see Tolerance. False: the problem failed for good. */
bool turned_before(Turned *turned, double t, const double *x, const double *scale, double longest);
/* Look at the rates just after it, and note which indicators it turned; `restarted`: it changed the states. */
bool turned_after(Turned *turned, double t, const double *x, bool restarted);
/* At the end of a step; *through: an indicator under watch went on across. */
bool turned_check(Turned *turned, double t, const double *x, bool *through);

#endif
