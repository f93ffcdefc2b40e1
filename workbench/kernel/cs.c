#include "cs.h"

#include <math.h>

#include "cs_step.h"

static const double GRID_ERROR = 1e-6; /* of a step: how far a point may lie off a constant grid */

static bool add_row(Cs *cs, const double *inputs, RowKind kind) {
    return record_add(cs->record, cs->system, cs->time, inputs, kind);
}

/* The number of equal steps that the way to `target` is cut into; 0: off the grid. */
static double steps_to(Cs *cs, double target) {
    const double span = target - cs->time;
    if (isnan(cs->fixed)) {
        const double count = fmax(1.0, ceil(span / cs->longest - 1e-9));
        if (cs->variable_step) {
            return count;
        }
        cs->fixed = cs->step_given ? cs->longest : span / count;
    }
    const double count = nearbyint(span / cs->fixed);
    const bool fits = count >= 1.0 && fabs(span - count * cs->fixed) <= GRID_ERROR * cs->fixed;
    return fits ? count : 0.0;
}

/* Make one step and record its two rows; at `until` the right limit is the next run's. */
static bool communicate(Cs *cs, double end, bool last) {
    System *system = cs->system;
    Forcing *forcing = system->forcing;
    const double start = cs->previous = cs->time;
    forcing_give_slopes(forcing, system->components, start, end);
    if (!cs_step_to(cs, end) || !system_count_step(system, end)) {
        return false;
    }
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->written[i] = forcing->seen[i];
    }
    if (!add_row(cs, forcing->seen, last ? ROW_ALWAYS : ROW_POINT)) {
        return false;
    }
    return last || (cs_set_inputs(cs, forcing_next_break(forcing, start) <= end) &&
                    add_row(cs, forcing->written, ROW_SECOND));
}

static bool to_target(Cs *cs, double target, double until) {
    const double start = cs->time;
    const double count = steps_to(cs, target);
    if (count < 1.0) {
        return fail_value(&cs->system->failure, FAILED_GRID, cs->time, 0, target);
    }
    for (double i = 1.0; i <= count; i++) {
        const double end = i == count ? target : start + (target - start) * (i / count);
        if (!communicate(cs, end, end == until)) {
            return false;
        }
    }
    return true;
}

bool cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record, bool fresh) {
    System *system = cs->system;
    const size_t none = n_targets;
    size_t next = 0;
    cs->record = record;
    failure_clear(&system->failure);
    record_begin(record, system);
    if (!cs_set_inputs(cs, fresh || forcing_next_break(system->forcing, cs->previous) <= cs->time) ||
        !add_row(cs, system->forcing->written, ROW_ALWAYS)) {
        return false;
    }
    while (cs->time < until) {
        while (next < none && targets[next] <= cs->time) {
            next++;
        }
        const double point = next < none ? targets[next] : until;
        if (!to_target(cs, fmin(point, forcing_next_break(system->forcing, cs->time)), until)) {
            return false;
        }
    }
    return true;
}
