#include "cs.h"

#include <math.h>

#include "control.h"
#include "cs_step.h"
#include "intermediate.h"

static const double GRID_ERROR = 1e-6; /* of a step: how far a point may lie off a constant grid */

static bool add_row(Cs *cs, const double *inputs, RowKind kind) {
    return record_add(cs->record, cs->system, cs->time, inputs, kind);
}

/* The row of the right limits. */
static bool add_right(Cs *cs, RowKind kind) {
    return add_row(cs, cs->system->forcing->written, kind) && ((!cs->record->read && !cs->master) || cs_announce(cs));
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

bool cs_communicate(Cs *cs, double end, bool last) {
    System *system = cs->system;
    Forcing *forcing = system->forcing;
    const double start = cs->previous = cs->time;
    cs_look_ahead(cs, end);
    intermediate_step(system, start, end);
    if (!cs_step_to(cs, end)) {
        return false;
    }
    intermediate_seen(system, start, end);
    system->steps++;
    copy_values(forcing->written, forcing->seen, forcing->n);
    if (!add_row(cs, forcing->seen, last ? ROW_ALWAYS : ROW_POINT)) {
        return false;
    }
    return last || (cs_set_inputs(cs, forcing_next_break(forcing, start) <= end) && add_right(cs, ROW_SECOND));
}

/* Cut the way to the next point or break into equal steps. */
static bool choose_target(Cs *cs) {
    while (cs->n_targets && cs->targets[0] <= cs->time) {
        cs->targets++;
        cs->n_targets--;
    }
    const double point = cs->n_targets ? cs->targets[0] : cs->until;
    cs->start = cs->time;
    cs->target = cs_next_stop(cs, fmin(point, forcing_next_break(cs->system->forcing, cs->time)));
    cs->count = steps_to(cs, cs->target);
    cs->made = 0.0;
    return cs->count >= 1.0 || fail_value(&cs->system->failure, FAILED_GRID, cs->time, 0, cs->target);
}

static bool next_step(Cs *cs) {
    if (cs->master && cs->master->control) {
        return control_step(cs);
    }
    cs->made++;
    const double end =
        cs->made == cs->count ? cs->target : cs->start + (cs->target - cs->start) * (cs->made / cs->count);
    return cs_communicate(cs, end, end == cs->until);
}

static bool run_on(Cs *cs) {
    while (cs->time < cs->until) {
        if (system_pauses(cs->system, cs->time)) {
            return false;
        }
        if ((cs->made == cs->count && !choose_target(cs)) || !next_step(cs)) {
            return false;
        }
    }
    return true;
}

bool cs_go_on(Cs *cs) {
    system_go_on(cs->system);
    return run_on(cs);
}

bool cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record, bool fresh) {
    System *system = cs->system;
    cs->until = until;
    cs->targets = targets;
    cs->n_targets = n_targets;
    cs->made = cs->count = 0.0;
    cs->record = record;
    system_go_on(system);
    if (!cs->master) { /* whose inputs are lines over a step, known when it begins */
        intermediate_begin(system);
    }
    record_begin(record, system);
    copy_values(system->forcing->seen, system->forcing->written, system->forcing->n);
    return cs_set_inputs(cs, fresh || forcing_next_break(system->forcing, cs->previous) <= cs->time) &&
           add_right(cs, ROW_ALWAYS) && run_on(cs);
}
