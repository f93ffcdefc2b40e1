#include "system.h"

#include <float.h>
#include <math.h>

#include "algebraic.h"

/* Relative: what FMUs that iterate inside may differ by when asked again. */
static const double SAME = 1e-8;
/* Relative: what a delay() of an FMU takes for the same input, too. */
static const double ROUNDED = 4.0 * DBL_EPSILON;

void system_go_on(System *system) {
    system->pause_at = system->steps + STEPS_BETWEEN_PAUSES;
    failure_clear(&system->failure);
    failure_clear(&system->unsolved);
}

bool system_pauses(System *system, double time) {
    return system->steps >= system->pause_at && !fail_at(&system->failure, PAUSED, time);
}

static double passed(const Wires *wires, size_t i) {
    return wires->closed[i] ? wires->gains[i] * wires->fresh[i] + wires->offsets[i] : 0.0;
}

bool link_read(System *system, Link *link, double *values) {
    const Wires *wires = &system->wires;
    if (!access_read(&link->source, system->components, wires->fresh, &system->failure)) {
        return false;
    }
    for (size_t i = 0; i < link->n; i++) {
        values[i] = passed(wires, link->members[i]);
    }
    return true;
}

bool link_write(System *system, Link *link, const double *values) {
    for (size_t i = 0; i < link->n; i++) {
        system->wires.values[link->members[i]] = values[i];
    }
    return access_write(&link->destination, system->components, system->wires.values, &system->failure);
}

static bool link_propagate(System *system, Link *link, bool *changed) {
    const Wires *wires = &system->wires;
    if (!access_read(&link->source, system->components, wires->fresh, &system->failure)) {
        return false;
    }
    for (size_t i = 0; i < link->n; i++) {
        const size_t wire = link->members[i];
        const double value = passed(wires, wire);
        if (!isfinite(value)) {
            return fail_value(&system->failure, FAILED_WIRE, system->components[0].time, wire, value);
        }
        *changed = *changed || !(value == wires->values[wire]);
        wires->values[wire] = value;
    }
    return access_write(&link->destination, system->components, wires->values, &system->failure);
}

static bool loop_propagate(System *system, Link *link, bool *changed) {
    if (!loop_solve(system, link, system->components[0].time)) {
        return false;
    }
    const double *start = link->work + LOOP_START * link->n;
    for (size_t i = 0; i < link->n; i++) {
        *changed = *changed || !(start[i] == system->wires.values[link->members[i]]);
    }
    return true;
}

bool system_propagate(System *system, bool events, bool *changed) {
    bool some = false;
    Link *links = events ? system->links : system->moving;
    const size_t n = events ? system->n_links : system->n_moving;
    for (size_t i = 0; i < n; i++) {
        Link *link = &links[i];
        if (!(link->work ? loop_propagate(system, link, &some) : link_propagate(system, link, &some))) {
            return false;
        }
    }
    if (changed) {
        *changed = some;
    }
    return true;
}

void system_switch(System *system, double time) {
    const Wires *wires = &system->wires;
    for (size_t i = 0; i < wires->n; i++) {
        wires->closed[i] = is_due(wires->closes_at[i], time);
    }
}

/* ---- ticks that are made anew ---- */

static bool saved(System *system, size_t i, FunctionIndex function) {
    Component *component = &system->components[i];
    return component_saved(component, function, &component->before, (int32_t)i, &system->failure);
}

/* To rounding: what ticks anew forgets how it came to rest, and a circle would go round in the last digits for ever. */
static bool is_other(double seen, double value) {
    return !(fabs(value - seen) <= ROUNDED * fmax(fabs(value), fabs(seen)));
}

static bool sees_others(const System *system, size_t i) {
    const Wires *wires = &system->wires;
    for (size_t w = 0; w < wires->n; w++) {
        if (wires->to[w] == (int32_t)i && is_other(wires->seen[w], wires->values[w])) {
            return true;
        }
    }
    return false;
}

static void note_seen(const System *system, size_t i) {
    const Wires *wires = &system->wires;
    for (size_t w = 0; w < wires->n; w++) {
        wires->seen[w] = wires->to[w] == (int32_t)i ? wires->values[w] : wires->seen[w];
    }
}

/* Give the component what stands on its connections. */
static bool write_inputs(System *system, size_t i) {
    for (size_t k = 0; k < system->n_links; k++) {
        const Access *destination = &system->links[k].destination;
        for (size_t b = 0; b < destination->n_blocks; b++) {
            Block *block = &destination->blocks[b];
            if (block->component == (int32_t)i &&
                !block_write(block, system->components, system->wires.values, &system->failure)) {
                return false;
            }
        }
    }
    return true;
}

/* Save what ticks now in a circle, or take it back if it has ticked with other inputs; *again: it was taken back. */
static bool prepare_tick(System *system, size_t i, double time, bool first, bool *again) {
    Component *component = &system->components[i];
    if (first && component->in_circle && component->due <= time && !saved(system, i, GET_FMU_STATE)) {
        component->before = NULL; /* it claims to and does not: it ticks with what it sees first */
        failure_clear(&system->failure);
    }
    if (!component->before) {
        return true;
    }
    *again = !first && sees_others(system, i);
    note_seen(system, i);
    return !*again || (saved(system, i, SET_FMU_STATE) && write_inputs(system, i));
}

bool system_settled(System *system) {
    bool done = true;
    for (size_t i = 0; i < system->n_components; i++) {
        done = (!system->components[i].before || saved(system, i, FREE_FMU_STATE)) && done;
        system->components[i].before = NULL;
    }
    return done;
}

/* ---- one round ---- */

/* One component evaluates the event once; *acted: its outputs may be others now. */
static bool update_one(System *system, size_t i, double time, Round *round, bool *acted) {
    Component *component = &system->components[i];
    Answer answer = {0};
    bool anew = false;
    component->ticked = round->first ? component->due <= time && isfinite(component->due) : component->ticked;
    if (!prepare_tick(system, i, time, round->first, &anew) ||
        !component_update(component, &answer, (int32_t)i, &system->failure)) {
        return false;
    }
    /* Where it is not known when its event was due, it was due now if there is a next one. */
    const bool due = component->due <= time && (isfinite(component->due) || isfinite(answer.time));
    *acted = anew || answer.again || answer.states_changed || due;
    component->due = answer.time;
    round->some = true;
    round->again = round->again || answer.again;
    round->states_changed = round->states_changed || answer.states_changed;
    round->ended = answer.terminate ? (int32_t)i : round->ended;
    return true;
}

bool system_update(System *system, double time, Round *round) {
    bool acted = false, some = false;
    for (size_t k = 0; k < system->n_components; k++) {
        const size_t i = system->order ? system->order[k] : k;
        if (!system->components[i].event_mode) {
            continue;
        }
        if (acted && !system_propagate(system, true, &some)) {
            return false;
        }
        round->moved = round->moved || (acted && some);
        if (!update_one(system, i, time, round, &acted)) {
            return false;
        }
    }
    if (round->some && !system_propagate(system, true, &some)) {
        return false;
    }
    round->moved = round->moved || (round->some && some);
    return true;
}

void system_gather_switches(const System *system, Gathered *next) {
    const Wires *wires = &system->wires;
    for (size_t i = 0; i < wires->n; i++) {
        gather(next, is_due(wires->closes_at[i], next->now) ? (double)INFINITY : wires->closes_at[i]);
    }
}

double system_next_event(const System *system, double now) {
    Gathered next = gathered_after(now);
    for (size_t i = 0; i < system->n_components; i++) {
        gather(&next, fmax(system->components[i].due, now)); /* what is overdue is due now: time never goes back */
    }
    system_gather_switches(system, &next);
    return next.last;
}

/* Whether a value passed on is its source's still; it is not where that was read before an input that moves it came. */
static bool stands(System *system, const Link *link) {
    const Wires *wires = &system->wires;
    if (!access_read(&link->source, system->components, wires->fresh, &system->failure)) {
        return false;
    }
    for (size_t i = 0; i < link->n; i++) {
        const size_t wire = link->members[i];
        const double was = wires->values[wire], value = passed(wires, wire);
        if (fabs(value - was) > SAME * (fabs(value) + fabs(was) + wires->typical[wire])) {
            return fail_value(&system->failure, FAILED_ORDER, system->components[0].time, wire, value);
        }
    }
    return true;
}

/* Pass on what moves, and check the order of the links as long as it is not believed. */
static bool pass_on(System *system) {
    bool some = false;
    if (!system_propagate(system, false, &some)) {
        return false;
    }
    if (!some || system->ordered >= ENOUGH_ORDERED) {
        return true;
    }
    system->ordered++;
    for (size_t i = 0; i < system->n_moving; i++) {
        if (!system->moving[i].work && !stands(system, &system->moving[i])) {
            return false;
        }
    }
    return true;
}

bool system_put(System *system, double t, const double *x) {
    for (size_t i = 0; i < system->n_components; i++) {
        Component *component = &system->components[i];
        /* FMI's setter takes a pointer to const; one signature serves getters and setters here. */
        if (!component_set_time(component, t, (int32_t)i, &system->failure) ||
            !component_states(component, SET_STATES, (double *)x, component->nx, (int32_t)i, &system->failure)) {
            return false;
        }
        x += component->nx;
    }
    return forcing_write_continuous(system->forcing, system->components, fmin(system->limit, t), &system->failure) &&
           pass_on(system);
}

bool system_vectors(System *system, FunctionIndex function, double *values, bool indicators) {
    for (size_t i = 0; i < system->n_components; i++) {
        const Component *component = &system->components[i];
        const size_t n = indicators ? component->nz : component->nx;
        if (!component_states(component, function, values, n, (int32_t)i, &system->failure)) {
            return false;
        }
        values += n;
    }
    return true;
}

bool system_enter(System *system, FunctionIndex mode) {
    for (size_t i = 0; i < system->n_components; i++) {
        if (!component_enter(&system->components[i], mode, (int32_t)i, &system->failure)) {
            return false;
        }
    }
    return true;
}
