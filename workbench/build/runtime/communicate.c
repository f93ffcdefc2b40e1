/* communicate.c: one communication step (see instance.h).
 *
 * A step covers [point, point + size): an event that falls on its end belongs to the next step, so
 * that a sampled input is the one set at that communication point. Until then values are left limits;
 * the event is made when an input has been set there and a value is looked at, or at the start of the
 * next doStep, or in FMI 3 Event Mode.
 */
#include "instance.h"

#include <float.h>
#include <math.h>

#define MOST_ITERATIONS 1000
#define SAME_POINT 1e-6 /* of the communication step: rounding in the environment's time */
#define ON_POINT 1e-9 /* of the communication step: the event is at the communication point */
#define CAUTION 0.02 /* of the last gap between state events: a longer first step could jump over the next one */

/* A time event may lie a rounding error behind the communication point: the core must see it reached. */
void communicate_reach_event(Instance *instance)
{
    const Record *record = &instance->record;
    double now = core_time(instance->core);
    double behind = record->next_event_time - now;
    bool ahead = instance->kind == KIND_CS && behind > 0.0 && behind < HUGE_VAL;
    if (ahead && behind <= ON_POINT * fabs(record->next_event_time)) {
        core_set_time(instance->core, record->next_event_time);
    }
}

static bool iterate(Instance *instance)
{
    CoreEventInfo info = {.discrete_states_need_update = true};
    for (int i = 0; info.discrete_states_need_update; i++) {
        if (i == MOST_ITERATIONS) {
            instance_fail(instance, "the event iteration at t = %.17g does not end (%d iterations)",
                          core_time(instance->core), MOST_ITERATIONS);
            return false;
        }
        if (instance_new_discrete_states(instance, &info) != STATUS_OK) {
            return false;
        }
    }
    return true;
}

bool communicate_handle_event(Instance *instance)
{
    if (core_mode(instance->core) != CORE_EVENT) {
        communicate_reach_event(instance);
        core_enter_event(instance->core);
    }
    if (!iterate(instance)) {
        return false;
    }
    instance->record.event_due = 0.0;
    instance->record.touched = 0.0;
    if (!core_enter_continuous(instance->core)) {
        instance_core_failed(instance);
        return false;
    }
    return true;
}

/* ---- checks ---- */

static double rounding(double point, double size)
{
    return SAME_POINT * size + 64.0 * DBL_EPSILON * fabs(point);
}

static Status check_arguments(Instance *instance, double point, double size)
{
    const Record *record = &instance->record;
    if (!isfinite(point) || !isfinite(size) || !(size > 0.0)) {
        return instance_fail(instance, "the communication step from %g must be longer than 0 and finite, not %g",
                             point, size);
    }
    if (fabs(point - record->communication_point) > rounding(point, size)) {
        return instance_fail(instance, "the current communication point is %.17g, not %.17g",
                             record->communication_point, point);
    }
    if (!(fabs(core_time(instance->core) - point) <= size + rounding(point, size))) { /* a saved state that says so */
        return instance_fail(instance, "the model stands at %.17g, not at the communication point %.17g",
                             core_time(instance->core), point);
    }
    if (point + size > record->stop_time + rounding(point, size)) {
        return instance_fail(instance, "the step to %.17g goes beyond the stop time %.17g", point + size,
                             record->stop_time);
    }
    return STATUS_OK;
}

/* ---- the step ---- */

typedef struct {
    double end;       /* of the step, or where the environment asked to return */
    double asked_end; /* of the step */
    double size;
    double next_stop; /* of the solver */
    StepReport *report;
} Step;

static Status integration_failed(Instance *instance)
{
    const Solver *solver = instance->solver;
    instance->muted = false;
    return instance_fail(instance, "integration (%s) stopped at t = %.17g: %s%s%s", solver->method->name, solver->t,
                         solver->problem, instance->kept[0] != '\0' ? "; the model says: " : "", instance->kept);
}

static void mute(Instance *instance)
{
    instance->kept[0] = '\0';
    instance->muted = true;
}

/* The longest step to begin with: the next event may follow as quickly as the last one did. */
static double longest_start(const Flights *flights, double now)
{
    double rounding_error = 64.0 * DBL_EPSILON * fabs(now);
    return fmax(fmax(CAUTION * flights->gaps[0], now - flights->last), rounding_error);
}

static Status restart(Instance *instance)
{
    double tolerance = instance->record.tolerance;
    tolerance = tolerance > 0.0 ? tolerance : model_info.default_tolerance;
    instance->solver->longest_start = longest_start(&instance->record.flights, core_time(instance->core));
    mute(instance);
    bool good = solver_begin(instance->solver, tolerance > 0.0 ? tolerance : 1e-6);
    if (good) {
        const Turned *turned = &instance->record.turned;
        turned_after(&instance->record.turned, instance->turned, instance->solver);
        double longest = instance->solver->longest_start; /* what was turned may have but a short way back */
        instance->solver->longest_start = turned->watches != 0.0 ? fmin(longest, turned->ahead) : longest;
    }
    instance->muted = false;
    return good ? STATUS_OK : integration_failed(instance);
}

static Status integrate(Instance *instance, const Step *step, bool *state_event, bool *haste)
{
    mute(instance);
    SolverResult result = solver_step(instance->solver, step->next_stop, &instance->record.step);
    instance->muted = false;
    if (result == SOLVER_FAILED) {
        return integration_failed(instance);
    }
    *state_event = result == SOLVER_EVENT;
    *haste = core_wants_event(instance->core);
    instance->record.last_successful_time = instance->solver->t;
    return STATUS_OK;
}

/* Events that follow each other without end: from there on no integration is possible. */
static Status guard_events(Instance *instance, const Step *step, bool state_event)
{
    Flights *flights = &instance->record.flights;
    double now = instance->solver->t;
    double span = fmax(step->size, fabs(now));
    double end = 0.0;
    if (flights_chatter(flights, now, span)) {
        return instance_fail(instance,
                             "more than %d events without progress at t = %.17g: the model chatters; give the "
                             "switching condition a hysteresis",
                             MOST_CLOSE_EVENTS, now);
    }
    if (state_event && flights_count(flights, now) && flights_dwindle(flights, now, span, &end)) {
        return instance_fail(instance,
                             "infinitely many events (Zeno behaviour, as of a ball that comes to rest) before "
                             "t = %.9g; let the model rest there",
                             end);
    }
    return STATUS_OK;
}

/* An event turned back or stopped what crosses its threshold, and no event followed where that went on. */
static Status guard_against_going_through(Instance *instance)
{
    const Turned *turned = &instance->record.turned;
    mute(instance);
    bool through = turned_went_through(turned, instance->turned, instance->solver);
    instance->muted = false;
    if (through) {
        return instance_fail(instance,
                             "the event at t = %.9g turns back or stops what crosses its threshold, yet that goes on "
                             "to the far side without another event (as a ball that comes to rest falls through its "
                             "floor); let the model rest there, held by a contact force; whether it is meant to pass "
                             "cannot be told: if so, write the passage without restarting a state (reinit)",
                             turned->since);
    }
    return STATUS_OK;
}

static void look_before_event(Instance *instance, const Step *step, bool state_event)
{
    mute(instance);
    turned_before(&instance->record.turned, instance->turned, instance->solver, state_event,
                  fmax(step->size, fabs(instance->solver->t)));
    instance->muted = false;
}

static bool returns_at_events(const Instance *instance)
{
    return instance->event_mode_used && instance->early_return_allowed;
}

static Status handle_event(Instance *instance, const Step *step, bool state_event)
{
    Status status = guard_events(instance, step, state_event);
    if (status != STATUS_OK) {
        return status;
    }
    look_before_event(instance, step, state_event);
    instance_log(instance, CATEGORY_EVENTS, "event at t = %.17g", instance->solver->t);
    instance->record.event_due = 1.0;
    instance->record.step = 0.0;
    if (returns_at_events(instance)) {
        step->report->event_handling_needed = true;
        return STATUS_OK;
    }
    return communicate_handle_event(instance) ? restart(instance) : STATUS_ERROR;
}

static Status ask_environment(Instance *instance, Step *step)
{
    double stop_at = HUGE_VAL;
    if (instance->intermediate == NULL) {
        return STATUS_OK;
    }
    if (!instance->intermediate(instance, &stop_at)) {
        return STATUS_ERROR;
    }
    step->end = fmin(step->end, fmax(stop_at, instance->solver->t));
    return STATUS_OK;
}

/* Where the solver has to stop next; the event at the end of the step is not this step's. */
static bool time_event_ahead(const Instance *instance, const Step *step)
{
    return instance->record.next_event_time < step->end - ON_POINT * step->size;
}

static Status advance(Instance *instance, Step *step)
{
    bool state_event = false;
    bool haste = false;
    bool time_event = time_event_ahead(instance, step);
    step->next_stop = time_event ? instance->record.next_event_time : step->end;
    if (step->next_stop > instance->solver->t) {
        Status status = integrate(instance, step, &state_event, &haste);
        status = status == STATUS_OK ? guard_against_going_through(instance) : status;
        status = status == STATUS_OK ? ask_environment(instance, step) : status;
        if (status != STATUS_OK) {
            return status;
        }
    }
    bool reached = time_event && instance->solver->t >= step->next_stop;
    return state_event || haste || reached ? handle_event(instance, step, state_event) : STATUS_OK;
}

static bool finished(const Instance *instance, const Step *step)
{
    return instance->solver->t >= step->end || step->report->event_handling_needed
        || instance->record.terminate != 0.0;
}

static Status begin(Instance *instance, double point)
{
    if (!inputs_begin(&instance->inputs, instance->core, point)) {
        return instance_core_failed(instance);
    }
    if (instance->record.event_due != 0.0 && !communicate_handle_event(instance)) {
        return STATUS_ERROR;
    }
    return restart(instance);
}

static void conclude(Instance *instance, const Step *step)
{
    Record *record = &instance->record;
    StepReport *report = step->report;
    double now = instance->solver->t;
    bool whole = now >= step->asked_end;
    if (record->turned.watches != 0.0 && record->turned.known == 0.0) {
        look_before_event(instance, step, false); /* inputs may jump here, and an event may be due */
    }
    inputs_end(&instance->inputs);
    record->communication_point = whole ? step->asked_end : now;
    record->last_successful_time = record->communication_point;
    report->terminate = record->terminate != 0.0;
    report->early_return = !whole && !report->terminate;
    if (record->next_event_time <= record->communication_point + ON_POINT * step->size) {
        record->event_due = 1.0;
        report->event_handling_needed = report->event_handling_needed || instance->event_mode_used;
    }
}

Status communicate(Instance *instance, double point, double size, StepReport *report)
{
    Step step = {.end = point + size, .asked_end = point + size, .size = size, .report = report};
    memset(report, 0, sizeof *report);
    Status status = check_arguments(instance, point, size);
    status = status == STATUS_OK ? begin(instance, point) : status;
    while (status == STATUS_OK && !finished(instance, &step)) {
        status = advance(instance, &step);
    }
    if (status == STATUS_OK) {
        conclude(instance, &step);
    } else {
        inputs_end(&instance->inputs);
    }
    return status;
}
