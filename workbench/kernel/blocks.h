/* blocks.h: limits, hysteresis, tables and other nonlinear blocks as components, called through FMI 2.0's signatures.
 *
 * What a block does in continuous time depends on its mode (which piece of a characteristic, which way a limit is
 * met). It stays as it is there; indicators tell when it no longer fits, and the event chooses it anew, so that every
 * kink is met exactly. The modes of an indicator: not above 0 inside. The one place where blocks are computed:
 * Python calls the same functions. Their parameters are declared in workbench/system/block_table/.
 */
#ifndef WORKBENCH_KERNEL_BLOCKS_H
#define WORKBENCH_KERNEL_BLOCKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "lti.h"

enum { BLOCK_MODES = 2, BLOCK_GRIDS = 3 };

/* In the order of NUMBERS in workbench/kernel/native_blocks.py. */
typedef enum {
    BLOCK_SATURATION,
    BLOCK_DEAD_BAND,
    BLOCK_RELAY,
    BLOCK_QUANTISER,
    BLOCK_FRICTION,
    BLOCK_LOOKUP,
    BLOCK_LOOKUP_2D,
    BLOCK_PRODUCT,
    BLOCK_EXTREME,
    BLOCK_SWITCH,
    BLOCK_INTEGRATOR,
    BLOCK_RATE_LIMITER,
    BLOCK_BACKLASH,
    BLOCK_PID,
    BLOCK_DELAY,
    N_BLOCKS
} BlockNumber;

struct History;

/* The caller owns what it points to, but the history. */
typedef struct {
    const double *p;                  /* parameters, see each kind */
    const double *grids[BLOCK_GRIDS]; /* of tables: x; y, or x2 and then z [n_x][n_x2] */
    size_t sizes[BLOCK_GRIDS];
    double *memory; /* [nu + nx + 1] inputs, states, the output; the index is the value reference */
    size_t nu, nx, nz;
    double mode[BLOCK_MODES];
    double time;            /* [s] */
    double longest;         /* the next step of a solver must not be longer [s] */
    struct History *history; /* of a delay's input; NULL: none */
    int32_t kind;           /* BlockNumber */
    int32_t event_mode;
} Element;

static inline double *element_states(const Element *e)
{
    return e->memory + e->nu;
}

#endif
