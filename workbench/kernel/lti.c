#include "lti.h"

#include <stdlib.h>
#include <string.h>

#include "kernel.h"

enum { OK = 0 };

static double *states(const Lti *lti) {
    return lti->memory + lti->nu;
}

/* out = left · x + right · u, with `rows` rows. */
static void combine(const Lti *lti, const double *left, const double *right, size_t rows, double *out) {
    const double *u = lti->memory;
    const double *x = states(lti);
    for (size_t i = 0; i < rows; i++) {
        double sum = 0.0;
        for (size_t j = 0; j < lti->nx; j++) {
            sum += left[i * lti->nx + j] * x[j];
        }
        for (size_t j = 0; j < lti->nu; j++) {
            sum += right[i * lti->nu + j] * u[j];
        }
        out[i] = sum;
    }
}

static bool is_sampled(const Lti *lti) {
    return lti->instants.step > 0.0;
}

/* Bring the outputs up to date; those of a sampled system stand between ticks. */
static int evaluate(const Lti *lti) {
    double *y = states(lti) + lti->nx;
    if (lti->function) {
        return lti->function(lti->memory, y);
    }
    if (!is_sampled(lti) || lti->ticking) {
        combine(lti, lti->c, lti->d, lti->ny, y);
    }
    return OK;
}

static double tick(const Lti *lti, int64_t after) {
    return is_sampled(lti) ? instant(&lti->instants, (double)(lti->ticks + after)) : (double)INFINITY;
}

static bool is_now(const Lti *lti) {
    return lti->time >= tick(lti, 0);
}

int lti_set_time(Lti *lti, double time) {
    lti->time = time;
    return OK;
}

int lti_set_states(Lti *lti, const double *x, size_t n) {
    memcpy(states(lti), x, n * sizeof *x);
    return OK;
}

int lti_get_states(Lti *lti, double *x, size_t n) {
    memcpy(x, states(lti), n * sizeof *x);
    return OK;
}

int lti_get_derivatives(Lti *lti, double *dx, size_t n) {
    combine(lti, lti->a, lti->b, n, dx);
    return OK;
}

int lti_enter_event_mode(Lti *lti) {
    lti->ticking = is_now(lti);
    return OK;
}

int lti_enter_continuous_mode(Lti *lti) {
    if (!lti->ticking) {
        return OK;
    }
    const int status = evaluate(lti);
    if (is_now(lti)) { /* not where it begins between two ticks: it shows what it gives, and stands */
        combine(lti, lti->a, lti->b, lti->nx, lti->next);
        memcpy(states(lti), lti->next, lti->nx * sizeof(double));
        lti->ticks++;
    }
    lti->ticking = 0;
    return status;
}

int lti_update(Lti *lti, LtiEventInfo *info) {
    memset(info, 0, sizeof *info);
    info->timed = is_sampled(lti);
    info->next_time = tick(lti, lti->ticking && is_now(lti));
    return OK;
}

/* How an output or a derivative moves with an input or a state, at once; false: it is neither. Value references of
 * derivatives are those behind the outputs. */
static bool moved_by(const Lti *lti, uint32_t unknown, uint32_t known, double *value) {
    const size_t first = lti->nu + lti->nx;
    const bool rate = unknown >= first + lti->ny;
    const size_t row = rate ? unknown - first - lti->ny : unknown - first;
    const bool input = known < lti->nu;
    if (unknown < first || known >= first || row >= (rate ? lti->nx : lti->ny)) {
        return false;
    }
    const double *by_states = rate ? lti->a : lti->c;
    const double *by_inputs = rate ? lti->b : lti->d;
    *value = input ? by_inputs[row * lti->nu + known] : by_states[row * lti->nx + known - lti->nu];
    return true;
}

int lti_get_directional(Lti *lti, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns,
                        const double *seed, double *sensitivity) {
    const bool moves = !is_sampled(lti) || lti->ticking; /* else outputs stand */
    for (size_t i = 0; i < n_unknowns; i++) {
        sensitivity[i] = 0.0;
        for (size_t j = 0; j < n_knowns; j++) {
            double value = 0.0;
            if (lti->function || !moved_by(lti, unknowns[i], knowns[j], &value)) {
                return FMI_ERROR;
            }
            sensitivity[i] += moves ? seed[j] * value : 0.0;
        }
    }
    return OK;
}

/* ---- saved states: the block, then its memory ---- */

typedef struct {
    Lti block;
    double memory[];
} LtiState;

static size_t memory_size(const Lti *lti) {
    return (lti->nu + lti->nx + lti->ny) * sizeof(double);
}

int lti_get_fmu_state(Lti *lti, void **state) {
    LtiState *saved = *state ? *state : malloc(sizeof *saved + memory_size(lti));
    if (!saved) {
        return FMI_ERROR;
    }
    saved->block = *lti;
    memcpy(saved->memory, lti->memory, memory_size(lti));
    *state = saved;
    return OK;
}

int lti_set_fmu_state(Lti *lti, const void *state) {
    const LtiState *saved = state;
    *lti = saved->block;
    memcpy(lti->memory, saved->memory, memory_size(lti));
    return OK;
}

int lti_free_fmu_state(Lti *lti, void **state) {
    (void)lti;
    free(*state);
    *state = NULL;
    return OK;
}

int lti_get_real(Lti *lti, const uint32_t *references, size_t n, double *values) {
    int status = OK;
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= lti->nu + lti->nx) {
            status = evaluate(lti);
            break;
        }
    }
    for (size_t i = 0; i < n; i++) {
        values[i] = lti->memory[references[i]];
    }
    return status;
}

int lti_set_real(Lti *lti, const uint32_t *references, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) {
        lti->memory[references[i]] = values[i];
    }
    return OK;
}
