#include "me_event.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const double SHRINKING = 0.99; /* two gaps of less than this part of the two before are told from equal ones */
static const double STILL = 1e5; /* longer gaps are close where nothing moves: at most so many fit into a run */
static const double HYSTERESIS = 1e-9; /* of a state's size: exporters give 1e-10 or less */

static Failure *failure_of(Me *me) {
    return &me->system->failure;
}

bool me_completed(Me *me, bool *event) {
    System *system = me->system;
    for (size_t i = 0; i < system->n_components; i++) {
        const Component *component = &system->components[i];
        Answer answer = {0};
        if (!component->completed_step) {
            continue;
        }
        const int status = component->calls->completed_step(component, &answer);
        if (!component_checked(component, COMPLETED_STEP, status, (int32_t)i, &system->failure)) {
            return false;
        }
        if (answer.terminate) {
            return fail_of(&system->failure, FAILED_ENDED, me->time, (int32_t)i);
        }
        *event = *event || answer.event;
    }
    return true;
}

static double spacing(double t) {
    return nextafter(fabs(t), (double)INFINITY) - fabs(t);
}

static void new_flight(Me *me, bool measured) {
    for (size_t i = 0; i < me->system->nx; i++) {
        me->flight[i] = measured ? me->highest[i] - me->lowest[i] : (double)INFINITY;
        me->lowest[i] = (double)INFINITY;
        me->highest[i] = -(double)INFINITY;
    }
}

void me_forget_events(Me *me) {
    flights_forget(&me->flights);
    me->cautious = (double)INFINITY;
    new_flight(me, false);
    turned_forget(&me->turned);
}

/* Whether infinitely many state events end right here, at `*end` [s]. */
static bool dwindles(Me *me, double *end) {
    if (!flights_count(&me->flights, me->time)) {
        return false;
    }
    const double *g = me->flights.gaps;
    new_flight(me, isfinite(g[3]) && g[0] + g[1] < SHRINKING * (g[2] + g[3]));
    return flights_dwindle(&me->flights, me->time, me->span, end);
}

/* Whether the last event turned some state back, and none moved since but within the hysteresis that an exporter gives
 * to a relation. */
static bool stands_still(const Me *me) {
    bool turned = false;
    for (size_t i = 0; i < me->system->nx; i++) {
        const double nominal = isfinite(me->most[i]) ? me->most[i] : 1.0;
        if (me->highest[i] - me->lowest[i] > HYSTERESIS * fmax(me->scale[i], nominal)) {
            return false;
        }
        turned = turned || me->turned.dx[i] * me->turned.old_dx[i] < 0.0;
    }
    return turned;
}

/* Refuse to go on when events follow each other without end. */
static bool guard_events(Me *me, bool located) {
    double end = 0.0;
    if (me->system->nz) {
        /* The next event may follow as quickly as this one did: a long first step would jump over it. */
        me->cautious = fmax(0.25 * (me->time - me->flights.event), 64.0 * spacing(me->time));
    }
    if (flights_chatter(&me->flights, me->time, located && stands_still(me) ? STILL * me->span : me->span)) {
        return fail_at(failure_of(me), FAILED_CHATTER, me->time);
    }
    return !located || !dwindles(me, &end) || fail_at(failure_of(me), FAILED_ZENO, end);
}

/* Iterate in event mode until neither a component nor a connected value changes. */
static bool rounds(Me *me, bool *states_changed) {
    System *system = me->system;
    for (int i = 0; i < MAX_EVENT_ITERATIONS; i++) {
        Round round = {.first = i == 0, .ended = NOBODY};
        if (!system_update(system, me->time, &round)) {
            return false;
        }
        *states_changed = *states_changed || round.states_changed;
        if (round.ended != NOBODY) {
            return fail_of(&system->failure, FAILED_ENDED, me->time, round.ended);
        }
        if (!round.again && !round.moved) {
            me->next_time = system_next_event(system, me->time);
            return true;
        }
    }
    return fail_at(&system->failure, FAILED_ITERATION, me->time);
}

static bool iterate(Me *me, bool *states_changed) {
    const bool done = rounds(me, states_changed);
    return system_settled(me->system) && done && system_enter(me->system, ENTER_CONTINUOUS_MODE);
}

bool me_put(Me *me) {
    return system_put(me->system, me->time, me->solver->x);
}

void me_note_states(Me *me, const double *x) {
    for (size_t i = 0; i < me->system->nx; i++) {
        me->scale[i] = fmax(me->scale[i], fmin(fabs(x[i]), me->most[i]));
        me->lowest[i] = fmin(me->lowest[i], x[i]);
        me->highest[i] = fmax(me->highest[i], x[i]);
    }
}

bool me_restart_solver(Me *me, const double *x) {
    me_note_states(me, x);
    if (!me->solver->method->restart(me->solver, me->time, x)) {
        snprintf(failure_of(me)->message, SOLVER_MESSAGE, "%s", me->solver->message);
        return fail_at(failure_of(me), FAILED_SOLVER, me->time);
    }
    failure_clear(failure_of(me));
    if (me->system->nz == 0) {
        return system_put(me->system, me->time, x); /* a solver that has no indicators leaves the FMUs where they stood */
    }
    const bool stands = turned_stand(&me->turned, me->time, x);
    if (stands) {
        failure_clear(failure_of(me));
    }
    return stands;
}

static bool write_inputs(Me *me) {
    Forcing *forcing = me->system->forcing;
    if (forcing->n == 0) {
        return system_propagate(me->system, true, NULL);
    }
    forcing_evaluate(forcing, me->time);
    return forcing_write_wanted(forcing, me->system->components, failure_of(me)) &&
           system_propagate(me->system, true, NULL);
}

/* Look at the rates before an event; the FMUs stand as before. */
static bool look_before(Me *me) {
    const bool looked = turned_before(&me->turned, me->time, me->solver->x, me->scale, AHEAD_MOST * me->span);
    if (looked) {
        failure_clear(failure_of(me));
    }
    return looked && me_put(me);
}

static bool look_after(Me *me, bool states_changed) {
    const bool looked = turned_after(&me->turned, me->time, me->x, states_changed);
    if (looked) {
        failure_clear(failure_of(me));
        /* What was turned may have but a short way back. */
        me->cautious = me->turned.watches ? fmin(me->cautious, me->turned.ahead) : me->cautious;
    }
    return looked;
}

bool me_event(Me *me, bool located) {
    System *system = me->system;
    bool states_changed = false;
    const bool watched = located || me->turned.watches;
    if (!guard_events(me, located) || (watched && !look_before(me))) {
        return false;
    }
    /* The FMUs must get the right limits now, and the left limits again on the way to the same break. */
    const double limit = system->limit;
    system->limit = (double)INFINITY;
    system_switch(system, me->time);
    for (size_t i = 0; i < system->n_components; i++) {
        system->components[i].time = me->time; /* after a restore it stands elsewhere */
    }
    if (!system_enter(system, ENTER_EVENT_MODE) || !write_inputs(me) ||
        !iterate(me, &states_changed)) {
        return false;
    }
    for (size_t i = 0; i < system->nx; i++) {
        me->x[i] = me->solver->x[i];
    }
    if (states_changed && !system_vectors(system, GET_STATES, me->x, false)) {
        return false;
    }
    const bool restarted = (!watched || look_after(me, states_changed)) && me_restart_solver(me, me->x);
    system->limit = limit > me->time ? limit : (double)INFINITY;
    return restarted;
}
