/* block_kind.h: what a kind of block is: one table of functions for each. */
#ifndef WORKBENCH_KERNEL_BLOCK_KIND_H
#define WORKBENCH_KERNEL_BLOCK_KIND_H

#include "blocks.h"

/* Functions get the mode that holds: in event mode the one that is chosen there. NULL: there is nothing to do. */
typedef struct {
    /* Change `mode` to the one that belongs to inputs and states. */
    void (*choose)(const Element *e, double *mode);
    double (*output)(const Element *e, const double *mode);
    void (*rates)(const Element *e, const double *mode, double *dx);
    void (*indicators)(const Element *e, double *z);
    /* ∂(dx, y)[row] / ∂(u, x)[column]; the row of y is nx. */
    double (*slope)(const Element *e, const double *mode, size_t row, size_t column);
    /* At an event, its mode chosen: states that jump. True: they did. */
    bool (*jump)(Element *e);
    /* Whether it has a value at these inputs; NULL: it has one at all. */
    bool (*defined)(const Element *e);
    /* A delay: note the input that now stands (after a step, or at an event); false: no memory. */
    bool (*note)(Element *e, bool event);
    /* Time of the next event [s]; NULL: none. */
    double (*next)(const Element *e);
} BlockKind;

const BlockKind *block_kind(int32_t number);
extern const BlockKind block_delay;

bool history_copy(struct History **to, const struct History *from);
void history_free(struct History *history);

#endif
