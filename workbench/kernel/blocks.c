#include "blocks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernel.h"
#include "block_kind.h"

enum { OK = 0 };

/* ---- modes ---- */

/* The mode that holds: at events it follows inputs and states at once. */
static const double *present(const Element *e, double *scratch) {
    const BlockKind *kind = block_kind(e->kind);
    if (!e->event_mode || !kind->choose) {
        return e->mode;
    }
    memcpy(scratch, e->mode, sizeof e->mode);
    kind->choose(e, scratch);
    return scratch;
}

static bool is_defined(const Element *e) {
    const BlockKind *kind = block_kind(e->kind);
    return !kind->defined || kind->defined(e);
}

static int evaluate(Element *e) {
    double scratch[BLOCK_MODES];
    if (!is_defined(e)) {
        return FMI_DISCARD;
    }
    e->memory[e->nu + e->nx] = block_kind(e->kind)->output(e, present(e, scratch));
    return OK;
}

/* ---- life ---- */

int block_setup(Element *e, int tolerance_given, double tolerance, double start, int stop_given, double stop) {
    (void)tolerance_given;
    (void)tolerance;
    (void)stop_given;
    (void)stop;
    e->time = start;
    e->event_mode = 1;
    return OK;
}

int block_nothing(Element *e) {
    (void)e;
    return OK;
}

void block_free(Element *e) {
    history_free(e->history);
    e->history = NULL;
}

int block_set_time(Element *e, double time) {
    e->time = time;
    return OK;
}

int block_set_states(Element *e, const double *x, size_t n) {
    memcpy(element_states(e), x, n * sizeof *x);
    return OK;
}

int block_get_states(Element *e, double *x, size_t n) {
    memcpy(x, element_states(e), n * sizeof *x);
    return OK;
}

int block_get_derivatives(Element *e, double *dx, size_t n) {
    double scratch[BLOCK_MODES];
    if (n) {
        block_kind(e->kind)->rates(e, present(e, scratch), dx);
    }
    return OK;
}

int block_get_indicators(Element *e, double *z, size_t n) {
    if (n) {
        block_kind(e->kind)->indicators(e, z);
    }
    return OK;
}

int block_enter_event_mode(Element *e) {
    e->event_mode = 1;
    return OK;
}

int block_enter_continuous_mode(Element *e) {
    e->event_mode = 0;
    return OK;
}

int block_update(Element *e, LtiEventInfo *info) {
    const BlockKind *kind = block_kind(e->kind);
    memset(info, 0, sizeof *info);
    if (!is_defined(e)) {
        return FMI_ERROR;
    }
    if (kind->choose) {
        kind->choose(e, e->mode);
    }
    info->states_changed = kind->jump && kind->jump(e);
    if (kind->note && !kind->note(e, true)) {
        return FMI_ERROR;
    }
    info->next_time = kind->next ? kind->next(e) : (double)INFINITY;
    info->timed = info->next_time < (double)INFINITY;
    return OK;
}

int block_completed_step(Element *e, int never_back, int *event, int *terminate) {
    const BlockKind *kind = block_kind(e->kind);
    (void)never_back;
    *event = *terminate = 0;
    return kind->note && !kind->note(e, false) ? FMI_ERROR : OK;
}

/* ---- values ---- */

int block_get_real(Element *e, const uint32_t *references, size_t n, double *values) {
    const size_t y = e->nu + e->nx;
    int status = OK;
    for (size_t i = 0; i < n; i++) {
        if (references[i] == y && status == OK) {
            status = evaluate(e);
        }
        /* Behind the output: derivatives, then modes. */
        if (references[i] <= y) {
            values[i] = e->memory[references[i]];
        } else if (references[i] > y + e->nx) {
            values[i] = e->mode[references[i] - y - e->nx - 1];
        } else {
            double scratch[BLOCK_MODES], dx[BLOCK_MODES];
            block_kind(e->kind)->rates(e, present(e, scratch), dx);
            values[i] = dx[references[i] - y - 1];
        }
    }
    return status;
}

int block_set_real(Element *e, const uint32_t *references, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) {
        const size_t y = e->nu + e->nx, mode = references[i] - y - e->nx - 1;
        if (references[i] < y) {
            e->memory[references[i]] = values[i];
        } else if (references[i] > y + e->nx && mode < BLOCK_MODES) {
            e->mode[mode] = values[i];
        } else {
            return FMI_ERROR;
        }
    }
    return OK;
}

int block_get_directional(Element *e, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                          size_t n_knowns, const double *seed, double *sensitivity) {
    double scratch[BLOCK_MODES];
    const double *mode = present(e, scratch);
    const size_t y = e->nu + e->nx;
    for (size_t i = 0; i < n_unknowns; i++) {
        sensitivity[i] = 0.0;
        /* The output comes first among references, and last among the rows. */
        const size_t row = unknowns[i] == y ? e->nx : unknowns[i] - y - 1;
        for (size_t j = 0; j < n_knowns; j++) {
            if (unknowns[i] < y || row > e->nx || knowns[j] >= y) {
                return FMI_ERROR;
            }
            if (seed[j] != 0.0) {
                sensitivity[i] += seed[j] * block_kind(e->kind)->slope(e, mode, row, knowns[j]);
            }
        }
    }
    return OK;
}

/* ---- saved states: the block, its memory, its history ---- */

typedef struct {
    Element block;
    double memory[];
} BlockState;

static size_t memory_size(const Element *e) {
    return (e->nu + e->nx + 1) * sizeof(double);
}

int block_free_fmu_state(Element *e, void **state) {
    BlockState *saved = *state;
    (void)e;
    if (saved) {
        history_free(saved->block.history);
    }
    free(saved);
    *state = NULL;
    return OK;
}

int block_get_fmu_state(Element *e, void **state) {
    BlockState *saved = *state;
    if (!saved) {
        saved = malloc(sizeof *saved + memory_size(e));
        if (!saved) {
            return FMI_ERROR;
        }
        saved->block.history = NULL;
    }
    struct History *kept = saved->block.history;
    *state = saved;
    saved->block = *e;
    saved->block.history = kept;
    memcpy(saved->memory, e->memory, memory_size(e));
    return history_copy(&saved->block.history, e->history) ? OK : FMI_ERROR;
}

int block_set_fmu_state(Element *e, const void *state) {
    const BlockState *saved = state;
    struct History *kept = e->history;
    *e = saved->block;
    e->history = kept;
    memcpy(e->memory, saved->memory, memory_size(e));
    return history_copy(&e->history, saved->block.history) ? OK : FMI_ERROR;
}
