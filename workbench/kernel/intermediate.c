#include "intermediate.h"

#include <math.h>

static Intermediate *intermediate_of(const System *system, size_t i) {
    return system->components[i].intermediate;
}

void intermediate_begin(System *system) {
    for (size_t i = 0; i < system->n_components; i++) {
        Intermediate *intermediate = intermediate_of(system, i);
        if (intermediate) {
            intermediate->system = system;
            intermediate->who = (int32_t)i;
        }
    }
}

/* Just before the end, where a signal jumps there. */
static double left_of(System *system, double t, double end) {
    return forcing_next_break(system->forcing, t) > end ? end : nextafter(end, -(double)INFINITY);
}

void intermediate_step(System *system, double t, double end) {
    for (size_t i = 0; i < system->n_components; i++) {
        Intermediate *intermediate = intermediate_of(system, i);
        if (intermediate) {
            intermediate->answered = 0;
            system->limit = left_of(system, t, end);
        }
    }
}

void intermediate_seen(System *system, double t, double end) {
    Forcing *forcing = system->forcing;
    for (size_t i = 0; i < forcing->n; i++) {
        const Intermediate *intermediate = intermediate_of(system, (size_t)forcing->owners[i]);
        if (intermediate && intermediate->answered && !forcing->discrete[i]) {
            forcing->seen[i] = forcing_value(forcing, i, left_of(system, t, end));
        }
    }
    system->limit = (double)INFINITY;
}

void kernel_intermediate_update(void *environment, double time, bool set_requested, bool get_allowed, bool finished,
                                bool can_return, bool *return_requested, double *return_time) {
    Intermediate *intermediate = environment;
    (void)get_allowed, (void)finished, (void)can_return, (void)return_time;
    if (return_requested) {
        *return_requested = false;
    }
    if (!intermediate || !intermediate->system || !intermediate->answers || !set_requested) {
        return;
    }
    System *system = intermediate->system;
    Forcing *forcing = system->forcing;
    const double t = fmin(time - system->components[intermediate->who].clock, system->limit);
    forcing->has_wanted = 0;
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->wanted[i] = forcing->discrete[i] ? forcing->written[i] : forcing_value(forcing, i, t);
    }
    for (size_t b = 0; b < forcing->fast.n_blocks; b++) {
        Block *block = &forcing->fast.blocks[b];
        if (block->component == intermediate->who &&
            !block_write(block, system->components, forcing->wanted, &system->failure)) {
            return; /* noted; the step that called goes no further */
        }
    }
    intermediate->answered = forcing->fast.n_blocks > 0;
}
