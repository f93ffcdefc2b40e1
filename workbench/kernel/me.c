#include "me.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "me_event.h"

enum { MAX_STEPS = 20000 }; /* between two recorded points or events */
static const double CAUTION_GROWS = 8.0;
static const double NEAR = 1e-6; /* of the time scale */

static bool is_discard(const Failure *failure) {
    return failure->code == FAILED_STATUS && failure->status == FMI_DISCARD;
}

/* Whether other states may do: an FMU discards these, or a loop has no solution there. */
static bool is_recoverable(const Failure *failure) {
    return is_discard(failure) || failure->code == FAILED_LOOP || failure->code == FAILED_WIRE;
}

/* ---- what the solver sees ---- */

static Evaluation outcome(System *system, const double *values, size_t n, bool done) {
    if (!done) {
        return is_recoverable(&system->failure) ? RECOVERABLE : FAILED;
    }
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(values[i])) {
            return RECOVERABLE;
        }
    }
    return EVALUATED;
}

static bool prepare(System *system, double t, const double *x) {
    if (is_recoverable(&system->failure)) {
        if (!is_discard(&system->failure)) {
            system->unsolved = system->failure;
        }
        failure_clear(&system->failure);
    }
    return system_put(system, t, x);
}

static Evaluation derivatives(void *owner, double t, const double *x, double *dx) {
    System *system = ((Me *)owner)->system;
    const bool done = prepare(system, t, x) && system_vectors(system, GET_DERIVATIVES, dx, false);
    system->evaluations++;
    return outcome(system, dx, system->nx, done);
}

static Evaluation indicators(void *owner, double t, const double *x, double *z) {
    System *system = ((Me *)owner)->system;
    const bool done = prepare(system, t, x) && system_vectors(system, GET_INDICATORS, z, true);
    return outcome(system, z, 0, done);
}

/* ---- life ---- */

static const SolverMethod *method_of(const char *name) {
    static const SolverMethod *const methods[] = {&solver_vkm, &solver_gear, &solver_none};
    for (size_t i = 0; i < sizeof methods / sizeof methods[0]; i++) {
        if (strcmp(methods[i]->name, name) == 0) {
            return methods[i];
        }
    }
    return NULL;
}

bool me_open(Me *me) {
    System *system = me->system;
    const SolverMethod *method = method_of(me->solver_name);
    me->problem = (Problem){me, system->nx, system->nz, derivatives, indicators, me->sparsity};
    me->told = 0;
    for (size_t i = 0; i < system->n_components; i++) {
        me->told = me->told || system->components[i].completed_step;
    }
    me->x = calloc(4 * system->nx + turned_doubles(system->nx, system->nz) + 1, sizeof(double));
    if (!me->x) {
        return fail_at(&system->failure, FAILED_MEMORY, me->time);
    }
    me->flight = me->x + system->nx;
    me->lowest = me->flight + system->nx;
    me->highest = me->lowest + system->nx;
    const Tolerance tolerance = {me->rtol, me->scale, me->flight};
    turned_bind(&me->turned, &me->problem, me->highest + system->nx);
    me->solver = method ? method->create(&me->problem, &tolerance, me->gear) : NULL;
    return me->solver ? me_restart(me) : fail_at(&system->failure, FAILED_MEMORY, me->time);
}

void me_close(Me *me) {
    if (me->solver) {
        me->solver->method->destroy(me->solver);
    }
    free(me->x);
    me->solver = NULL;
    me->x = NULL;
}

bool me_restart(Me *me) {
    me_forget_events(me);
    for (size_t i = 0; i < me->system->n_components; i++) {
        me->system->components[i].due = -(double)INFINITY;
    }
    return system_vectors(me->system, GET_STATES, me->x, false) && me_restart_solver(me, me->x);
}

/* ---- rows ---- */

static bool add_row(Me *me, double time, RowKind kind) {
    return record_add(me->record, me->system, time, me->system->forcing->written, kind);
}

/* `located`: at an indicator's zero. */
static bool event_rows(Me *me, bool located) {
    me->events++;
    return add_row(me, me->time, ROW_ALWAYS) && me_event(me, located) && add_row(me, me->time, ROW_ALWAYS);
}

static double waiting(const Me *me) {
    return me->n_targets ? me->targets[0] : (double)INFINITY;
}

static void pop_target(Me *me) {
    me->targets++;
    me->n_targets--;
}

/* Forget the points up to the present time: they have their rows. */
static void drop_targets(Me *me) {
    while (me->n_targets && waiting(me) <= me->time) {
        pop_target(me);
    }
}

/* Record the points inside the last step; FMUs must not be asked about them later. */
static bool record_points(Me *me, bool *some) {
    const Solver *solver = me->solver;
    while (me->n_targets && waiting(me) < solver->t) {
        const double point = waiting(me);
        pop_target(me);
        *some = true;
        if (!solver->method->interpolate(solver, point, me->x)) {
            return fail_at(&me->system->failure, FAILED_SOLVER, point);
        }
        if (!system_put(me->system, point, me->x) || !add_row(me, point, ROW_POINT)) {
            return false;
        }
    }
    return true;
}

/* Record `until`; other stops are recorded with their event. */
static bool record_end(Me *me) {
    if (me->n_targets != 1 || waiting(me) != me->time) {
        return true;
    }
    pop_target(me);
    return add_row(me, me->time, ROW_ALWAYS);
}

/* ---- from stop to stop ---- */

/* Cross a gap too small for any solver. */
static bool hop(Me *me, double stop) {
    me->time = stop;
    memcpy(me->x, me->solver->x, me->system->nx * sizeof(double));
    return system_put(me->system, stop, me->x) && me_restart_solver(me, me->x) && record_end(me);
}

static bool check_states(Me *me) {
    for (size_t i = 0; i < me->system->nx; i++) {
        const double x = me->solver->x[i];
        if (!isfinite(x)) {
            return fail_value(&me->system->failure, FAILED_STATE, me->solver->t, i, x);
        }
    }
    me_note_states(me, me->solver->x);
    return true;
}

static bool check_turned(Me *me) {
    bool through = false;
    if (!turned_check(&me->turned, me->solver->t, me->solver->x, &through)) {
        return false;
    }
    failure_clear(&me->system->failure);
    return !through || fail_at(&me->system->failure, FAILED_THROUGH, me->turned.since);
}

static bool solver_failed(Me *me) {
    Failure *failure = &me->system->failure;
    if (is_discard(failure) && me->solver->message[0]) {
        failure_clear(failure);
    }
    /* A connection that gives no value just ahead says more than a solver that comes to a stop before it. */
    const Failure *unsolved = &me->system->unsolved;
    if (!is_recoverable(failure) && unsolved->code && fabs(unsolved->time - me->solver->t) <= NEAR * me->span) {
        *failure = *unsolved;
    }
    if (is_recoverable(failure)) {
        return false;
    }
    snprintf(failure->message, sizeof failure->message, "%s", me->solver->message);
    return fail_at(failure, FAILED_SOLVER, me->solver->t);
}

/* How long the next step may be: for inputs, after an event, and for components that note their inputs at steps. */
static double longest_step(const Me *me) {
    const System *system = me->system;
    double longest = fmin(system->forcing->longest_step, me->cautious);
    for (size_t i = 0; i < system->n_components; i++) {
        longest = system->components[i].longest ? fmin(longest, *system->components[i].longest) : longest;
    }
    return longest;
}

/* One accepted step with all that belongs to it, but its event; *located: that is at an indicator's zero. */
static bool take_step(Me *me, double stop, bool *located, bool *event) {
    Solver *solver = me->solver;
    bool some = false;
    if (!solver->method->step(solver, stop, longest_step(me), located)) {
        return solver_failed(me);
    }
    *event = *located;
    failure_clear(&me->system->failure);
    me->cautious *= CAUTION_GROWS;
    me->system->steps++;
    if (!check_states(me) || !check_turned(me) || !record_points(me, &some)) {
        return false;
    }
    if (me->slopes && !slopes_after_step(me->slopes, solver, me->scale, me->record, me->system)) {
        return false;
    }
    me->steps = some ? 0 : me->steps + 1;
    if (me->steps > MAX_STEPS) {
        return fail_at(&me->system->failure, FAILED_STEPS, solver->t);
    }
    me->time = solver->t;
    if (!*event && !me->told && me->time < stop) {
        return true; /* nobody looks at the FMUs before the next step */
    }
    return me_put(me) && me_completed(me, event);
}

/* Step until `stop`, recording points on the way and handling events found on the way. */
static bool to_stop(Me *me, double stop) {
    if (stop - me->time <= 1e-14 * fmax(fabs(stop), fabs(me->time))) {
        return hop(me, stop);
    }
    while (me->time < stop) {
        bool located = false, event = false;
        if (system_pauses(me->system, me->time) || !take_step(me, stop, &located, &event)) {
            return false;
        }
        if (event) {
            if (!event_rows(me, located)) {
                return false;
            }
            drop_targets(me);
            me->steps = 0;
            if (me->next_time < stop) {
                return true;
            }
        }
    }
    return record_end(me);
}

/* Handle what the run stopped for before `until`. */
static bool at_stop(Me *me, double end) {
    Forcing *forcing = me->system->forcing;
    const bool due = me->time == end || me->time == me->next_time;
    forcing_evaluate(forcing, me->time);
    bool done = true;
    if (due || forcing_differs(forcing, DISCRETE_INPUTS, ANYONE)) {
        done = event_rows(me, false);
    } else if (waiting(me) == me->time) {
        done = add_row(me, me->time, ROW_POINT);
    }
    drop_targets(me);
    return done;
}

/* Take the right limit at the present time: inputs that jump, an event that is due. */
static bool enter(Me *me, bool fresh) {
    Forcing *forcing = me->system->forcing;
    forcing_evaluate(forcing, me->time);
    if (forcing_differs(forcing, ALL_INPUTS, ANYONE) || me->next_time <= me->time) {
        return me_event(me, false);
    }
    if (fresh) {
        return me_put(me) && me_restart_solver(me, me->solver->x);
    }
    return true;
}

/* The next stop; *end: the next break, or `until`. */
static double next_stop(Me *me, double until, double *end) {
    Forcing *forcing = me->system->forcing;
    *end = fmin(until, forcing_next_break(forcing, me->time));
    me->system->limit = nextafter(*end, -(double)INFINITY);
    if (*end == until && forcing_next_break(forcing, nextafter(until, -(double)INFINITY)) > until) {
        me->system->limit = (double)INFINITY;
    }
    const double apart = *end - me->next_time; /* an event that only rounding puts before the end is at it */
    const double stop = apart <= rounding_of(me->next_time, me->next_time - me->time) ? *end : me->next_time;
    return forcing->n_discrete ? fmin(stop, waiting(me)) : stop;
}

static bool run_to(Me *me, double until) {
    while (me->time < until) {
        double end = until;
        const double stop = next_stop(me, until, &end);
        me->steps = me->resumed ? me->steps : 0;
        me->resumed = 0;
        if (!to_stop(me, stop)) {
            return false;
        }
        if (me->time < until && me->time == stop && !at_stop(me, end)) {
            return false;
        }
    }
    me->system->limit = (double)INFINITY;
    return true;
}

bool me_run(Me *me, double until, const double *targets, size_t n_targets, Record *record, bool fresh) {
    me->until = until;
    me->targets = targets;
    me->n_targets = n_targets;
    me->record = record;
    me->span = fmax(fmax(until - me->time, fabs(until)), 1e-9);
    system_go_on(me->system);
    record_begin(record, me->system);
    return enter(me, fresh) && add_row(me, me->time, ROW_ALWAYS) && run_to(me, until);
}

bool me_go_on(Me *me) {
    system_go_on(me->system);
    me->resumed = 1;
    return run_to(me, me->until);
}
