#include "master.h"

#include <math.h>

#include "control.h"
#include "cs_step.h"

enum { MAX_EARLY_RETURNS = 10000, WHOLE = -1 };

static const double ARRIVED = 1e-12; /* relative: an FMU that comes as near to the end of its step is there */

static Failure *failure_of(Cs *cs) {
    return &cs->system->failure;
}

/* A group's failure is noted in its own system. */
static bool fail_of_group(Cs *cs, const Unit *unit) {
    const Failure *found = &unit->me->system->failure;
    return fail_value(failure_of(cs), FAILED_UNIT, found->time, (size_t)(unit - cs->master->units), 0.0);
}

static bool is_static(const Unit *unit) {
    return unit->me->system->nx == 0 && unit->me->system->nz == 0;
}

/* ---- instants ---- */

void master_gather(const Cs *cs, Gathered *next) {
    const Master *master = cs->master;
    const double clear = cs->time + rounding(cs->time);
    system_gather_switches(cs->system, next);
    for (size_t k = 0; k < master->n_units; k++) {
        const Unit *unit = &master->units[k];
        cs_gather(cs, next, unit->me ? unit->me->next_time : cs->system->components[unit->component].due);
        for (size_t i = 0; i < unit->n_instants; i++) {
            gather(next, instant_after(&unit->instants[i], clear));
        }
    }
}

/* ---- events: all components iterate together ---- */

/* Give forced inputs their present values: the last step may have been shorter than it was meant to be. */
static bool write_ramps(Cs *cs) {
    Master *master = cs->master;
    Forcing *forcing = cs->system->forcing;
    if (master->hold_inputs || forcing->fast.n_blocks == 0) {
        return true;
    }
    for (size_t i = 0; i < forcing->n; i++) {
        master->ramped[i] = forcing->written[i] + master->ramps[i] * (cs->time - master->since);
    }
    return access_write(&forcing->fast, cs->system->components, master->ramped, failure_of(cs));
}

/* A group that rounding alone makes due later finds its time reached. */
static bool reach_due(Cs *cs, const Unit *unit) {
    const double due = unit->me->next_time;
    const bool later = due > cs->time && is_due(due, cs->time);
    for (size_t i = 0; later && i < unit->n_members; i++) {
        const size_t member = unit->members[i];
        if (!component_set_time(&cs->system->components[member], due, (int32_t)member, failure_of(cs))) {
            return false;
        }
    }
    return true;
}

static bool enter_events(Cs *cs) {
    System *system = cs->system;
    for (size_t k = 0; k < cs->master->n_units; k++) {
        const Unit *unit = &cs->master->units[k];
        if (unit->me && !reach_due(cs, unit)) {
            return false;
        }
    }
    for (size_t i = 0; i < system->n_components; i++) {
        Component *component = &system->components[i];
        component->time = cs->time;
        if (component->event_mode && !component_enter(component, ENTER_EVENT_MODE, (int32_t)i, &system->failure)) {
            return false;
        }
    }
    for (size_t k = 0; k < cs->master->n_units; k++) {
        if (cs->master->units[k].me) {
            system_switch(cs->master->units[k].me->system, cs->time);
        }
    }
    system_switch(system, cs->time);
    return true;
}

/* The group goes on from the joint event iteration. */
static bool settle_group(Cs *cs, Unit *unit) {
    Me *me = unit->me;
    System *own = me->system;
    me->time = cs->time;
    for (size_t i = 0; i < unit->n_members; i++) {
        const size_t member = unit->members[i];
        const Component *component = &cs->system->components[member];
        if (!component_enter(component, ENTER_CONTINUOUS_MODE, (int32_t)member, failure_of(cs))) {
            return false;
        }
        own->components[i].due = component->due;
        own->components[i].time = cs->time;
    }
    me->next_time = system_next_event(own, cs->time);
    unit->stale = 1;
    failure_clear(&own->failure);
    return system_propagate(own, false, NULL) || fail_of_group(cs, unit);
}

static bool leave_events(Cs *cs) {
    for (size_t k = 0; k < cs->master->n_units; k++) {
        Unit *unit = &cs->master->units[k];
        if (unit->me) {
            if (!settle_group(cs, unit)) {
                return false;
            }
            continue;
        }
        const Component *component = &cs->system->components[unit->component];
        if (component->event_mode &&
            !component_enter(component, ENTER_STEP_MODE, unit->component, failure_of(cs))) {
            return false;
        }
    }
    return true;
}

/* Iterate until no component wants another round and no connected value changes. */
static bool rounds(Cs *cs) {
    if (!system_propagate(cs->system, true, NULL)) {
        return false;
    }
    for (int i = 0; i < MAX_EVENT_ITERATIONS; i++) {
        Round round = {.first = i == 0, .ended = NOBODY};
        if (!system_update(cs->system, cs->time, &round)) {
            return false;
        }
        if (round.ended != NOBODY) {
            return fail_of(failure_of(cs), FAILED_ENDED, cs->time, WHOLE);
        }
        if (!round.again && !round.moved) {
            return true;
        }
    }
    return fail_of(failure_of(cs), FAILED_ITERATION, cs->time, WHOLE);
}

static bool iterate(Cs *cs) {
    const bool done = rounds(cs);
    return system_settled(cs->system) && done && leave_events(cs);
}

bool master_set_inputs(Cs *cs, bool jump) {
    Master *master = cs->master;
    Forcing *forcing = cs->system->forcing;
    if (forcing->n == 0 && !master->event_due) {
        return true;
    }
    forcing_evaluate(forcing, cs->time);
    if (master->event_due || forcing_differs(forcing, jump ? ALL_INPUTS : DISCRETE_INPUTS, ANYONE)) {
        master->event_due = 0;
        return enter_events(cs) && forcing_write_wanted(forcing, cs->system->components, failure_of(cs)) &&
               iterate(cs);
    }
    return forcing_write_continuous(forcing, cs->system->components, cs->time, failure_of(cs)) &&
           system_propagate(cs->system, false, NULL);
}

/* ---- inputs over a step ---- */

void master_look_ahead(Cs *cs, double end) {
    Master *master = cs->master;
    Forcing *forcing = cs->system->forcing;
    copy_values(forcing->seen, forcing->written, forcing->n);
    master->since = cs->time;
    if (!master->hold_inputs) {
        forcing_look_ahead(forcing, cs->time, end);
        copy_values(forcing->seen, forcing->wanted, forcing->n);
    }
    const double middle = cs->time + 0.5 * (end - cs->time);
    for (size_t i = 0; i < forcing->n; i++) {
        const bool bows = master->extrapolation > 1 && !forcing->discrete[i];
        const double chord = 0.5 * (forcing->written[i] + forcing->seen[i]);
        master->ramps[i] = (forcing->seen[i] - forcing->written[i]) / (end - cs->time);
        master->bows[i] = bows ? 2.0 / 3.0 * (forcing_value(forcing, i, middle) - chord) : 0.0; /* Simpson's rule */
    }
}

/* Where a value goes that is not known yet: along Newton's polynomial through the last communication points. */
static double extrapolated(const Master *master, size_t n_wires, size_t wire, double span) {
    const double slope = master->slopes[wire], *spans = master->spans;
    double change = master->extrapolation > 0 ? slope * span : 0.0;
    if (master->extrapolation > 1 && spans[0] > 0.0 && spans[1] > 0.0) {
        const double bend = (slope - master->slopes[n_wires + wire]) / (spans[0] + spans[1]);
        change += bend * span * (span + spans[0]);
    }
    return master->start[wire] + change;
}

/* By how much the mean of the parabola through the last point and both ends of the step is off that of its chord. */
static double bow(const Master *master, size_t wire, double span, double change) {
    const double before = master->spans[0];
    if (master->extrapolation < 2 || !(before > 0.0)) {
        return 0.0;
    }
    return -(change / span - master->slopes[wire]) / (span + before) * span * span / 6.0;
}

/* A connected value at both ends of the step, as its destination is to see it. */
static void set_limits(const Master *master, size_t n_wires, size_t wire, double span, double *first, double *last,
                       double *bowed) {
    const bool known = master->known[wire];
    if (known && (master->hold_inputs || master->from_held[wire])) {
        *first = *last = master->reached[wire];
        return;
    }
    *first = *last = master->start[wire];
    if (!master->hold_inputs && master->moves[wire]) {
        *last = known ? master->reached[wire] : extrapolated(master, n_wires, wire, span);
        *bowed = bow(master, wire, span, *last - *first);
    }
}

static void set_courses(const Cs *cs, const Unit *unit, double end) {
    const Master *master = cs->master;
    const Forcing *forcing = cs->system->forcing;
    const size_t n_wires = cs->system->wires.n;
    for (size_t i = 0; i < unit->n; i++) {
        const size_t source = unit->sources[i];
        unit->bows[i] = 0.0;
        if (source < n_wires) {
            set_limits(master, n_wires, source, end - cs->time, &unit->starts[i], &unit->ends[i], &unit->bows[i]);
        } else {
            const size_t k = source - n_wires;
            unit->starts[i] = forcing->written[k] + master->ramps[k] * (cs->time - master->since);
            unit->ends[i] = forcing->written[k] + master->ramps[k] * (end - master->since);
            unit->bows[i] = master->bows[k];
        }
        if (!unit->moving[i]) {
            unit->bows[i] = 0.0;
            unit->starts[i] = unit->ends[i] = value_as_type((ValueType)unit->types[i], unit->starts[i]);
        }
    }
}

/* The inputs after this part of the step, to `values`; whether one of them moves. */
static bool evaluate(const Unit *unit, double part) {
    bool moves = false;
    for (size_t i = 0; i < unit->n; i++) {
        const double start = unit->starts[i];
        const bool still = unit->ends[i] == start;
        unit->values[i] = still ? start : start + (unit->ends[i] - start) * part;
        moves = moves || !still || unit->bows[i] != 0.0;
    }
    return moves;
}

/* The same, with the mean over the step that they are to have. */
static void evaluate_inside(const Unit *unit, double part) {
    evaluate(unit, part);
    for (size_t i = 0; i < unit->n && !unit->as_start; i++) {
        unit->values[i] += unit->bows[i];
    }
}

/* ---- one co-simulation component ---- */

static bool write_fast(Cs *cs, Unit *unit) {
    return access_write(&unit->fast, cs->system->components, unit->values, failure_of(cs));
}

static bool announce(Cs *cs, Unit *unit, double ramped) {
    const size_t n_wires = cs->system->wires.n;
    bool moves = false;
    for (size_t i = 0; i < unit->n; i++) {
        const size_t source = unit->sources[i];
        const size_t k = source - n_wires;
        const double now = source < n_wires
                               ? cs->system->wires.values[source]
                               : cs->system->forcing->written[k] + cs->master->ramps[k] * ramped;
        moves = moves || (unit->moving[i] && input_moves(unit->ends[i], now));
        unit->starts[i] = now;
        unit->values[i] = isnan(unit->ends[i]) ? now : unit->ends[i];
    }
    if (!moves || !write_fast(cs, unit)) {
        return !moves;
    }
    copy_values(unit->values, unit->starts, unit->n);
    return write_fast(cs, unit);
}

bool master_announce(Cs *cs, double ramped) {
    for (size_t k = 0; k < cs->master->n_units; k++) {
        Unit *unit = &cs->master->units[k];
        if (!unit->me && unit->fast.n_blocks && !announce(cs, unit, ramped)) {
            return false;
        }
    }
    return true;
}

/* Tell the FMU how its inputs go on; some claim to take slopes but answer with an error: false. */
static bool give_slopes(Cs *cs, Unit *unit, double span) {
    Component *component = &cs->system->components[unit->component];
    for (size_t b = 0; b < unit->fast.n_blocks && component->slopes_work; b++) {
        const Block *block = &unit->fast.blocks[b];
        if (!component->calls->set_slopes || block->type != FLOAT64) {
            component->slopes_work = 0;
            break;
        }
        for (size_t k = 0; k < block->n; k++) {
            const size_t i = block->columns[k];
            unit->rates[block->slots[k]] = (unit->ends[i] - unit->starts[i]) / span;
        }
        const int status = component->calls->set_slopes(component, block->references, block->n_references,
                                                        unit->orders, unit->rates);
        component->slopes_work = status >= 0 && status <= FMI_WARNING;
    }
    return component->slopes_work != 0;
}

/* Tell the FMU its inputs from this part of the step to its end. */
static bool give(Cs *cs, Unit *unit, double part, double span) {
    const Component *component = &cs->system->components[unit->component];
    if (unit->fast.n_blocks == 0) {
        return true;
    }
    const bool linear = !unit->as_start && component->interpolates && component->slopes_work;
    evaluate_inside(unit, unit->as_start ? 0.0 : linear ? part : 0.5 * (part + 1.0));
    if (!write_fast(cs, unit)) {
        return false;
    }
    if (!linear || give_slopes(cs, unit, span)) {
        return true;
    }
    evaluate_inside(unit, 0.5 * (part + 1.0));
    return write_fast(cs, unit);
}

/* Give the inputs the values that they have at the end, for outputs that show them directly. */
static bool arrive(Cs *cs, Unit *unit, double part) {
    return unit->as_start || unit->fast.n_blocks == 0 || !evaluate(unit, part) || write_fast(cs, unit);
}

/* Make an event inside the step; the others do not see it before its end. */
static bool local_event(Cs *cs, Unit *unit, double part, double time) {
    Component *component = &cs->system->components[unit->component];
    component->time = time;
    if (!component->event_mode) {
        return fail_of(failure_of(cs), FAILED_EVENT_MODE, time, unit->component);
    }
    evaluate(unit, part);
    return component_enter(component, ENTER_EVENT_MODE, unit->component, failure_of(cs)) &&
           access_write(&unit->inlet, cs->system->components, unit->values, failure_of(cs)) &&
           component_settle(component, unit->component, failure_of(cs));
}

/* Step to *end, or to an event of the FMU's own if it `may_stop` there. */
static bool step_component(Cs *cs, Unit *unit, double *end, bool may_stop) {
    Component *component = &cs->system->components[unit->component];
    const double span = *end - cs->time;
    double time = cs->time;
    for (int i = 0; i < MAX_EARLY_RETURNS; i++) {
        Answer answer = {0};
        component->time = time;
        if (!give(cs, unit, (time - cs->time) / span, span)) {
            return false;
        }
        const int status = component->calls->do_step(component, time, *end - time, &answer);
        if (!component_checked(component, DO_STEP, status, unit->component, failure_of(cs))) {
            return false;
        }
        if (answer.terminate) {
            return fail_of(failure_of(cs), FAILED_ENDED, answer.time, unit->component);
        }
        if (answer.time >= *end - ARRIVED * fmax(fabs(*end), span)) {
            component->time = *end;
            return arrive(cs, unit, 1.0);
        }
        time = answer.time;
        if (answer.event && may_stop) {
            *end = component->time = time;
            return arrive(cs, unit, (time - cs->time) / span);
        }
        if (answer.event && !local_event(cs, unit, (time - cs->time) / span, time)) {
            return false;
        }
    }
    return fail_of(failure_of(cs), FAILED_EARLY, time, unit->component);
}

/* ---- one group ---- */

/* Nothing to integrate, and nothing that could happen on the way. */
static bool follow(Cs *cs, Unit *unit, double end) {
    System *own = unit->me->system;
    for (size_t i = 0; i < unit->n_members; i++) {
        const size_t member = unit->members[i];
        own->components[i].time = end;
        if (!component_set_time(&cs->system->components[member], end, (int32_t)member, failure_of(cs))) {
            return false;
        }
    }
    unit->me->time = end;
    evaluate(unit, 1.0);
    failure_clear(&own->failure);
    return access_write(&unit->inlet, cs->system->components, unit->values, failure_of(cs)) &&
           (system_propagate(own, false, NULL) || fail_of_group(cs, unit));
}

static void force_group(const Unit *unit, double start, double end) {
    Forcing *forcing = unit->me->system->forcing;
    unit->times[0] = start;
    unit->times[1] = end;
    for (size_t i = 0; i < unit->n; i++) {
        unit->signals[i].kind = unit->starts[i] == unit->ends[i] ? SIGNAL_CONSTANT : SIGNAL_TABLE_LINEAR;
        unit->signals[i].p[0] = unit->starts[i] + unit->bows[i];
        unit->tables[2 * i] = unit->starts[i] + unit->bows[i];
        unit->tables[2 * i + 1] = unit->ends[i] + unit->bows[i];
        forcing->written[i] = unit->moving[i] ? forcing->written[i] : unit->starts[i]; /* it stands there already */
    }
    forcing->has_break = forcing->has_wanted = 0;
}

/* Give the inputs the values that they have at the end, where the step had others for the sake of the mean. */
static bool arrive_group(Cs *cs, Unit *unit) {
    bool bowed = false;
    for (size_t i = 0; i < unit->n; i++) {
        bowed = bowed || unit->bows[i] != 0.0;
    }
    if (!bowed) {
        return true;
    }
    evaluate(unit, 1.0);
    return access_write(&unit->fast, cs->system->components, unit->values, failure_of(cs)) &&
           (system_propagate(unit->me->system, false, NULL) || fail_of_group(cs, unit));
}

static bool step_group(Cs *cs, Unit *unit, double end) {
    Me *me = unit->me;
    if (is_static(unit) && me->next_time > end) {
        return follow(cs, unit, end);
    }
    force_group(unit, cs->time, end);
    failure_clear(&me->system->failure);
    /* The joint event iteration has seen all jumps. */
    if (unit->stale && !me_restart(me)) {
        return fail_of_group(cs, unit);
    }
    const double target = end;
    bool done = me_run(me, end, &target, 1, cs->master->nobody, !unit->stale);
    while (!done && me->system->failure.code == PAUSED) {
        done = me_go_on(me); /* the caller looks after signals between communication steps */
    }
    unit->stale = 0;
    for (size_t i = 0; i < unit->n_members; i++) {
        cs->system->components[unit->members[i]].time = me->system->components[i].time;
    }
    return done ? arrive_group(cs, unit) : fail_of_group(cs, unit);
}

/* ---- all units ---- */

/* What a held unit shows at the end of a step it has computed at its start. */
static void note_late(Cs *cs, size_t wire) {
    const Master *master = cs->master;
    const bool news = master->from_held[wire] && !(master->reached[wire] == master->start[wire]);
    if (news && cs->system->components[cs->system->wires.to[wire]].ticked) {
        master->late[wire] = 1;
    }
}

/* Read what the connections that leave a unit reach. */
static bool read_ends(Cs *cs, Unit *unit) {
    const Wires *wires = &cs->system->wires;
    if (!access_read(&unit->outlet, cs->system->components, unit->raw, failure_of(cs))) {
        return false;
    }
    for (size_t i = 0; i < unit->n_outgoing; i++) {
        const size_t wire = unit->outgoing[i];
        if (!isfinite(unit->raw[i])) {
            return fail_value(failure_of(cs), FAILED_WIRE, cs->time, wire, unit->raw[i]);
        }
        cs->master->reached[wire] = wires->closed[wire] ? wires->gains[wire] * unit->raw[i] + wires->offsets[wire] : 0.0;
        note_late(cs, wire);
    }
    return true;
}

static bool step_unit(Cs *cs, Unit *unit, double *end, bool may_stop) {
    set_courses(cs, unit, *end);
    return (unit->me ? step_group(cs, unit, *end) : step_component(cs, unit, end, may_stop)) && read_ends(cs, unit);
}

static void mark_known(Master *master, size_t from, size_t to) {
    for (size_t k = from; k < to; k++) {
        const Unit *unit = &master->units[master->order[k]];
        for (size_t i = 0; i < unit->n_outgoing; i++) {
            master->known[unit->outgoing[i]] = 1;
        }
    }
}

/* How connected values changed in this step; what is held goes on standing still. */
static void note_slopes(Master *master, size_t n, double span) {
    copy_values(master->slopes + n, master->slopes, n);
    master->spans[1] = master->spans[0];
    master->spans[0] = span;
    for (size_t i = 0; i < n; i++) {
        const bool moved = master->known[i] && !master->from_held[i];
        master->slopes[i] = moved ? (master->reached[i] - master->start[i]) / span : 0.0;
    }
}

/* Step every unit; *end becomes earlier if the first one stops at an event of its own. */
static bool step_all(Cs *cs, double *end) {
    Master *master = cs->master;
    const size_t n = cs->system->wires.n;
    copy_values(master->start, cs->system->wires.values, n);
    for (size_t i = 0; i < n; i++) {
        master->known[i] = 0;
    }
    size_t begin = 0;
    for (size_t s = 0; s < master->n_stages; s++) {
        for (size_t k = begin; k < master->stages[s]; k++) {
            if (!step_unit(cs, &master->units[master->order[k]], end, k == 0)) {
                return false;
            }
        }
        mark_known(master, begin, master->stages[s]);
        begin = master->stages[s];
    }
    note_slopes(master, n, *end - cs->time);
    return true;
}

bool master_step_to(Cs *cs, double end) {
    for (int i = 0; i < MAX_EARLY_RETURNS; i++) {
        double reached = end;
        if (!step_all(cs, &reached)) {
            return false;
        }
        const bool early = reached < end && end - reached > ARRIVED * fmax(fabs(end), end - cs->time);
        cs->time = early ? reached : end;
        cs->master->event_due = !early;
        if (!early) {
            return !cs->master->control || control_watch(cs);
        }
        if (!enter_events(cs) || !write_ramps(cs) || !iterate(cs) ||
            !master_announce(cs, cs->time - cs->master->since)) {
            return false;
        }
    }
    return fail_of(failure_of(cs), FAILED_EARLY, cs->time, WHOLE);
}
