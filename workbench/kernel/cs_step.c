#include "cs_step.h"

#include <math.h>

#include "intermediate.h"
#include "master.h"

enum { MAX_EARLY_RETURNS = 10000 };

static const double ROUNDING = 1e-12; /* relative */

static Failure *failure_of(Cs *cs) {
    return &cs->system->failure;
}

/* ---- event mode ---- */

static bool enter_event_mode(Cs *cs, int32_t who) {
    Component *component = &cs->system->components[who];
    component->time = cs->time; /* after a restore it stands elsewhere */
    return component_enter(component, ENTER_EVENT_MODE, who, failure_of(cs));
}

/* ---- inputs ---- */

/* Write one component's part of `values`. */
static bool write_blocks(Cs *cs, Access *access, int32_t who, const double *values) {
    for (size_t b = 0; b < access->n_blocks; b++) {
        Block *block = &access->blocks[b];
        if (block->component == who && !block_write(block, cs->system->components, values, failure_of(cs))) {
            return false;
        }
    }
    return true;
}

static bool write_wanted(Cs *cs, int32_t who, bool events) {
    Forcing *forcing = cs->system->forcing;
    if (!write_blocks(cs, &forcing->fast, who, forcing->wanted) ||
        (events && !write_blocks(cs, &forcing->slow, who, forcing->wanted))) {
        return false;
    }
    for (size_t i = 0; i < forcing->n; i++) {
        if (forcing->owners[i] == who && (events || !forcing->discrete[i])) {
            forcing->written[i] = forcing->wanted[i];
        }
    }
    return true;
}

/* An event at the end of the last step is made with the inputs of this point: a sampled input is the one set here. */
static bool set_component_inputs(Cs *cs, int32_t who, bool jump) {
    Component *component = &cs->system->components[who];
    if (!component->event_mode) {
        return write_wanted(cs, who, true);
    }
    if (component->event_due ||
        forcing_differs(cs->system->forcing, jump ? ALL_INPUTS : DISCRETE_INPUTS, who)) {
        component->event_due = 0;
        return enter_event_mode(cs, who) && write_wanted(cs, who, true) &&
               component_settle(component, who, failure_of(cs));
    }
    return write_wanted(cs, who, false);
}

/* Whether inputs are held over a step at the value of its middle: the FMU takes no slopes. */
static bool is_centred(const Component *component) {
    return component->centres && !(component->interpolates && component->slopes_work);
}

/* Write the continuous inputs of `wanted`, where they are not what the FMU sees. */
static bool write_moved(Cs *cs, int32_t who) {
    return !forcing_differs(cs->system->forcing, CONTINUOUS_INPUTS, who) || write_wanted(cs, who, false);
}

/* Inputs inside a step as they are at `t`. */
static bool write_inside(Cs *cs, int32_t who, double t) {
    Forcing *forcing = cs->system->forcing;
    if (!is_centred(&cs->system->components[who])) {
        return true;
    }
    forcing->has_wanted = 0;
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->wanted[i] = forcing->discrete[i] ? forcing->written[i] : forcing_value(forcing, i, t);
    }
    return write_moved(cs, who);
}

/* After a step: inputs as they are just before its end, for outputs that show them directly. */
static bool arrive(Cs *cs, int32_t who, double start, double end) {
    Forcing *forcing = cs->system->forcing;
    if (!is_centred(&cs->system->components[who])) {
        return true;
    }
    forcing_look_ahead(forcing, start, end);
    copy_values(forcing->seen, forcing->wanted, forcing->n);
    return write_moved(cs, who);
}

void cs_look_ahead(Cs *cs, double end) {
    if (cs->master) {
        master_look_ahead(cs, end);
    } else {
        forcing_give_slopes(cs->system->forcing, cs->system->components, cs->time, end);
    }
}

bool cs_set_inputs(Cs *cs, bool jump) {
    System *system = cs->system;
    if (cs->master) {
        return master_set_inputs(cs, jump);
    }
    forcing_evaluate(system->forcing, cs->time);
    for (size_t i = 0; i < system->n_components; i++) {
        if ((system->forcing->n || system->components[i].event_due) && !set_component_inputs(cs, (int32_t)i, jump)) {
            return false;
        }
    }
    return system_propagate(system, false, NULL);
}

bool input_moves(double before, double now) {
    return fabs(now - before) > ROUNDING * fmax(fabs(now), fabs(before));
}

static bool announce(Cs *cs, int32_t who) {
    Forcing *forcing = cs->system->forcing;
    bool moves = false;
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->seen[i] = isnan(forcing->seen[i]) ? forcing->written[i] : forcing->seen[i];
        moves = moves || (forcing->owners[i] == who && !forcing->discrete[i] &&
                          input_moves(forcing->seen[i], forcing->written[i]));
    }
    return !moves || (write_blocks(cs, &forcing->fast, who, forcing->seen) &&
                      write_blocks(cs, &forcing->fast, who, forcing->written));
}

bool cs_announce(Cs *cs) {
    System *system = cs->system;
    if (cs->master) {
        return master_announce(cs, 0.0);
    }
    for (size_t i = 0; i < system->n_components; i++) {
        if (!announce(cs, (int32_t)i)) {
            return false;
        }
    }
    return true;
}

/* ---- steps ---- */

/* An event inside the step is made at once; one at its end after the left limits there are recorded. */
static bool handle(Cs *cs, int32_t who, const Answer *answer, bool early) {
    Component *component = &cs->system->components[who];
    if (answer->terminate) {
        return fail_of(failure_of(cs), FAILED_ENDED, cs->time, who);
    }
    if (!answer->event) {
        return true;
    }
    if (!component->event_mode) {
        return fail_of(failure_of(cs), FAILED_EVENT_MODE, answer->time, who);
    }
    component->event_due = !early;
    return !early || (write_inside(cs, who, cs->time) && enter_event_mode(cs, who) &&
                      component_settle(component, who, failure_of(cs)));
}

/* Whether the FMU stopped before the end by more than rounding. */
static bool is_early(double reached, double start, double end) {
    return reached < end && end - reached > ROUNDING * fmax(fabs(end), end - start);
}

static bool step_component(Cs *cs, int32_t who, double start, double end) {
    Component *component = &cs->system->components[who];
    cs->time = start;
    for (int i = 0; i < MAX_EARLY_RETURNS; i++) {
        Answer answer = {0};
        component->time = cs->time;
        if (!write_inside(cs, who, 0.5 * (cs->time + end))) {
            return false;
        }
        const int status = component->calls->do_step(component, cs->time, end - cs->time, &answer);
        if (!component_checked(component, DO_STEP, status, who, failure_of(cs)) ||
            failure_of(cs)->code != NO_FAILURE) { /* of a callback */
            return false;
        }
        const bool early = is_early(answer.time, cs->time, end);
        if (early || answer.terminate) {
            cs->time = answer.time;
        }
        if (!handle(cs, who, &answer, early)) {
            return false;
        }
        if (!early) {
            component->time = end;
            return arrive(cs, who, start, end);
        }
    }
    return fail_of(failure_of(cs), FAILED_EARLY, cs->time, who);
}

void cs_gather(const Cs *cs, Gathered *next, double due) {
    gather(next, is_due(due, cs->time) ? (double)INFINITY : due);
}

double cs_next_stop(const Cs *cs, double target) {
    Gathered next = gathered_after(cs->time);
    if (cs->master && !cs->variable_step) {
        return target;
    }
    if (cs->master) {
        master_gather(cs, &next);
    }
    for (size_t i = 0; i < cs->system->n_components && !cs->master; i++) {
        cs_gather(cs, &next, clocks_next(cs->system->components[i].clocks));
    }
    return is_due(target, next.last) ? target : next.last;
}

bool cs_step_to(Cs *cs, double end) {
    const double start = cs->time;
    if (cs->master) {
        return master_step_to(cs, end);
    }
    for (size_t i = 0; i < cs->system->n_components; i++) {
        if (!step_component(cs, (int32_t)i, start, end)) {
            return false;
        }
    }
    cs->time = end;
    for (size_t i = 0; i < cs->system->n_components; i++) {
        Component *component = &cs->system->components[i];
        component->event_due = component->event_due || is_due(clocks_next(component->clocks), end);
    }
    return true;
}
