/* core.c: memory, evaluation and event iteration of one instance; see core.h. */
#include "core.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "delays.h"
#include "model.h"

enum { MESSAGE_LENGTH = 512 };

/* What a snapshot holds beside the arrays. No pointers. */
typedef struct {
    int mode;
    bool due;               /* the equations have to be evaluated before a value is read */
    bool outputs_due;       /* so do those that lead to an output; else these are up to date */
    bool parameters_due;    /* so do the calculated parameters */
    bool first_iteration;   /* of this event: clocks tick in it */
    bool terminated;        /* the model asked to end the simulation */
    bool stirred;           /* this event changed something of the model */
} Status;

struct Core {
    CoreLog log;
    void *environment;
    Frame frame;
    double *next_tick; /* [n_clocks] number of each clock's next tick */
    double *image;     /* all arrays of the snapshot, one block */
    double *scratch;   /* [n_all + n_frozen + n_conditions + n_states], never part of a snapshot */
    Status status;
};

/* Variables and event indicators together: indicators are variables with the last value references. */
static size_t n_all(void)
{
    return model_info.n_variables;
}

static size_t n_doubles(void)
{
    return 2 * n_all() + model_layout.n_frozen + 2 * model_layout.n_conditions + 2 * model_layout.n_clocks;
}

static size_t n_scratch(void)
{
    return n_all() + model_layout.n_frozen + model_info.n_states + 1;
}

static void set_due(Core *core, bool due)
{
    core->status.due = due;
    core->status.outputs_due = due;
}

void core_log(Core *core, bool is_error, const char *format, ...)
{
    char text[MESSAGE_LENGTH];
    va_list arguments;
    if (core->log == NULL) {
        return;
    }
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    core->log(core->environment, is_error, text);
}

/* Life */

static void lay_out(Core *core)
{
    double *next = core->image;
    core->frame.v = next;
    next += n_all();
    core->frame.pre = next;
    next += n_all();
    core->frame.frozen = next;
    next += model_layout.n_frozen;
    core->frame.condition = next;
    next += model_layout.n_conditions;
    core->frame.condition_pre = next;
    next += model_layout.n_conditions;
    core->frame.tick = next;
    next += model_layout.n_clocks;
    core->next_tick = next;
}

Core *core_new(CoreLog log, void *environment)
{
    Core *core = calloc(1, sizeof *core);
    if (core == NULL) {
        return NULL;
    }
    core->log = log;
    core->environment = environment;
    core->image = calloc(n_doubles(), sizeof *core->image);
    core->scratch = calloc(n_scratch(), sizeof *core->scratch);
    core->frame.delays = calloc(model_layout.n_delays + 1, sizeof *core->frame.delays);
    if (core->image == NULL || core->scratch == NULL || core->frame.delays == NULL) {
        core_free(core);
        return NULL;
    }
    lay_out(core);
    core_reset(core);
    return core;
}

void core_free(Core *core)
{
    if (core != NULL) {
        free(core->image);
        free(core->scratch);
        delays_free(core->frame.delays, model_layout.n_delays);
        free(core);
    }
}

void core_reset(Core *core)
{
    memset(core->image, 0, n_doubles() * sizeof *core->image);
    model_start_values(core->frame.v);
    memcpy(core->frame.pre, core->frame.v, n_all() * sizeof(double));
    core->frame.fresh = true;
    core->frame.initial = true;
    core->status.mode = CORE_INSTANTIATED;
    set_due(core, true);
    core->status.parameters_due = true;
    core->status.first_iteration = false;
    core->status.terminated = false;
    core->status.stirred = false;
    delays_reset(core->frame.delays, model_layout.n_delays);
}

/* Evaluation */

static bool is_finite_at(Core *core, unsigned vr, const char *what)
{
    if (isfinite(core->frame.v[vr])) {
        return true;
    }
    core_log(core, true, "%s %s is %g at time %.17g: not a finite number", what, model_info.names[vr],
             core->frame.v[vr], core->frame.v[0]);
    return false;
}

static bool derivatives_are_finite(Core *core)
{
    for (size_t i = 0; i < model_info.n_states; i++) {
        if (!is_finite_at(core, model_info.derivatives[i], "the derivative")) {
            return false;
        }
    }
    return true;
}

static void hold_discrete(Core *core)
{
    for (size_t i = 0; i < model_layout.n_discrete; i++) {
        const unsigned vr = model_layout.discrete[i];
        core->frame.pre[vr] = core->frame.v[vr];
    }
}

/* While the model is initialised, starts and parameters may still change: all of it is evaluated. */
static void evaluate_initial(Core *core)
{
    model_parameters(&core->frame);
    model_start_expressions(&core->frame);
    model_discrete(&core->frame);
}

static void update(Core *core)
{
    if (!core->status.due) {
        return;
    }
    if (core->status.mode == CORE_INSTANTIATED || core->status.mode == CORE_INITIALISING) {
        evaluate_initial(core);
    } else {
        if (core->status.parameters_due) {
            model_parameters(&core->frame);
        }
        model_continuous(&core->frame);
    }
    set_due(core, false);
    core->status.parameters_due = false;
}

/* A solver's points inside a step are often looked at for the outputs alone. */
static void update_output(Core *core)
{
    if (!model_outputs_apart || core->status.mode != CORE_CONTINUOUS || core->status.parameters_due) {
        update(core);
    } else if (core->status.outputs_due) {
        model_outputs(&core->frame);
        core->status.outputs_due = false;
    }
}

bool core_get(Core *core, unsigned vr, double *value)
{
    if (model_info.variables[vr].causality == CAUSALITY_OUTPUT) {
        update_output(core);
    } else if (vr != 0) {
        update(core);
    }
    *value = core->frame.v[vr];
    return is_finite_at(core, vr, "the value of");
}

void core_set(Core *core, unsigned vr, double value)
{
    core->frame.v[vr] = value;
    if (core->status.mode == CORE_INSTANTIATED || core->status.mode == CORE_INITIALISING) {
        core->frame.pre[vr] = value; /* a start value is what pre() gives at the start */
    }
    set_due(core, true);
    if (model_info.variables[vr].causality == CAUSALITY_PARAMETER) {
        core->status.parameters_due = true;
    }
}

double core_time(const Core *core)
{
    return core->frame.v[0];
}

CoreMode core_mode(const Core *core)
{
    return (CoreMode)core->status.mode;
}

/* Clocks: tick k is at (phase + k·period), rounded once. */

static double tick_time(const ClockInfo *clock, double k)
{
    const double numerator = (double)(clock->phase_numerator * clock->period_denominator)
                             + k * (double)(clock->period_numerator * clock->phase_denominator);
    return numerator / (double)(clock->phase_denominator * clock->period_denominator);
}

static void start_clocks(Core *core)
{
    for (size_t i = 0; i < model_layout.n_clocks; i++) {
        const ClockInfo *clock = &model_layout.clocks[i];
        const double period = (double)clock->period_numerator / (double)clock->period_denominator;
        double k = floor((core->frame.v[0] - tick_time(clock, 0.0)) / period);
        k = k < 0.0 ? 0.0 : k;
        while (!reached(tick_time(clock, k), core->frame.v[0])) {
            k += 1.0;
        }
        core->next_tick[i] = k;
    }
}

static void tick_clocks(Core *core)
{
    for (size_t i = 0; i < model_layout.n_clocks; i++) {
        const bool due = core->status.first_iteration
                         && reached(core->frame.v[0], tick_time(&model_layout.clocks[i], core->next_tick[i]));
        core->frame.tick[i] = due ? 1.0 : 0.0;
        core->next_tick[i] += due ? 1.0 : 0.0;
    }
}

static double next_event_time(const Core *core)
{
    double next = model_next_deadline(&core->frame);
    for (size_t i = 0; i < model_layout.n_clocks; i++) {
        next = smaller(next, tick_time(&model_layout.clocks[i], core->next_tick[i]));
    }
    return smaller(next, delays_next(core->frame.delays, model_layout.n_delays));
}

/* Modes */

bool core_enter_initialisation(Core *core, double start_time)
{
    core->frame.v[0] = start_time;
    core->status.mode = CORE_INITIALISING;
    set_due(core, true);
    return true;
}

static void begin_event(Core *core)
{
    core->status.mode = CORE_EVENT;
    core->status.first_iteration = true;
    core->status.stirred = !delays_plan(core->frame.delays, model_layout.n_delays, core->frame.v[0]);
}

void core_enter_event(Core *core)
{
    begin_event(core);
    set_due(core, true);
    core->frame.fresh = true;
}

static bool noted(Core *core, bool good)
{
    if (!good) {
        core_log(core, true, "out of memory: the past of a delay() cannot be kept");
    }
    set_due(core, true); /* what comes out of it may now be known better */
    return good;
}

bool core_enter_continuous(Core *core)
{
    Delay *delays = core->frame.delays;
    const size_t n = model_layout.n_delays;
    update(core);
    core->status.mode = CORE_CONTINUOUS;
    core->frame.fresh = false;
    return n == 0 || noted(core, delays_note_event(delays, n, core->frame.v[0], !core->status.stirred));
}

bool core_completed_step(Core *core)
{
    update(core);
    return derivatives_are_finite(core) && core_accepted(core);
}

bool core_accepted(Core *core)
{
    if (model_layout.n_delays == 0) {
        return true;
    }
    update(core);
    return noted(core, delays_note_step(core->frame.delays, model_layout.n_delays, core->frame.v[0]));
}

bool core_wants_event(const Core *core)
{
    return delays_in_haste(core->frame.delays, model_layout.n_delays);
}

/* One event iteration */

static bool any_ticks(const Core *core)
{
    for (size_t i = 0; i < model_layout.n_clocks; i++) {
        if (core->frame.tick[i] != 0.0) {
            return true;
        }
    }
    return false;
}

static bool differs(const double *a, const double *b, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (a[i] != b[i] && !(isnan(a[i]) && isnan(b[i]))) {
            return true;
        }
    }
    return false;
}

static bool discrete_changed(const Core *core)
{
    for (size_t i = 0; i < model_layout.n_discrete; i++) {
        const unsigned vr = model_layout.discrete[i];
        if (core->frame.v[vr] != core->frame.pre[vr]) {
            return true;
        }
    }
    return false;
}

/* Carry out reinit, terminate and assert; false after a failed assert. */
static bool act(Core *core, CoreEventInfo *info)
{
    const char *message = "";
    double *x = core->scratch;
    core_get_states(core, x);
    const unsigned fired = model_actions(&core->frame, x, &message);
    if ((fired & ACTION_ASSERT) != 0) {
        core_log(core, true, "assertion failed at time %.17g: %s", core->frame.v[0], message);
        return false;
    }
    if ((fired & ACTION_TERMINATE) != 0) {
        core_log(core, false, "terminated at time %.17g: %s", core->frame.v[0], message);
        core->status.terminated = true;
    }
    if ((fired & ACTION_REINIT) != 0) {
        core_set_states(core, x);
        info->continuous_states_changed = true;
    }
    return true;
}

bool core_exit_initialisation(Core *core)
{
    CoreEventInfo info = {.next_event_time = HUGE_VAL};
    set_due(core, true);
    update(core);
    start_clocks(core);
    const Delay *wrong = delays_wrong(core->frame.delays, model_layout.n_delays);
    if (wrong != NULL) {
        core_log(core, true, "a delay() of %g s: it must be above 0 and finite", wrong->record.lag);
        return false;
    }
    begin_event(core);
    if (!act(core, &info)) { /* what `when initial()` asks for */
        return false;
    }
    core->frame.initial = false;
    /* What is true from the start does not rise. */
    memcpy(core->frame.condition_pre, core->frame.condition, model_layout.n_conditions * sizeof(double));
    update(core);
    return derivatives_are_finite(core);
}

bool core_new_discrete_states(Core *core, CoreEventInfo *info)
{
    double *frozen_before = core->scratch + n_all();
    *info = (CoreEventInfo){.next_event_time = HUGE_VAL};
    if (core->status.parameters_due) {
        model_parameters(&core->frame);
        core->status.parameters_due = false;
    }
    memcpy(frozen_before, core->frame.frozen, model_layout.n_frozen * sizeof(double));
    hold_discrete(core);
    tick_clocks(core);
    core->frame.fresh = true;
    const bool jumped = delays_choose(core->frame.delays, model_layout.n_delays, core->frame.v[0]);
    model_discrete(&core->frame);
    set_due(core, false);
    if (!act(core, info)) {
        return false;
    }
    info->discrete_states_need_update =
        info->continuous_states_changed || discrete_changed(core)
        || differs(core->frame.condition, core->frame.condition_pre, model_layout.n_conditions)
        || differs(core->frame.frozen, frozen_before, model_layout.n_frozen)
        || delays_unsettled(core->frame.delays, model_layout.n_delays, core->frame.v[0]);
    core->status.stirred = core->status.stirred || jumped || info->discrete_states_need_update || any_ticks(core);
    if (core->status.stirred) {
        delays_begin_again(core->frame.delays, model_layout.n_delays, core->frame.v[0]);
    }
    memcpy(core->frame.condition_pre, core->frame.condition, model_layout.n_conditions * sizeof(double));
    core->status.first_iteration = false;
    info->terminate = core->status.terminated;
    info->next_event_time = next_event_time(core);
    info->next_event_time_defined = isfinite(info->next_event_time);
    return info->continuous_states_changed || derivatives_are_finite(core);
}

/* Continuous time */

void core_set_time(Core *core, double time)
{
    core->frame.v[0] = time;
    set_due(core, true);
}

void core_set_states(Core *core, const double *x)
{
    for (size_t i = 0; i < model_info.n_states; i++) {
        core->frame.v[model_info.states[i]] = x[i];
    }
    set_due(core, true);
}

void core_get_states(const Core *core, double *x)
{
    for (size_t i = 0; i < model_info.n_states; i++) {
        x[i] = core->frame.v[model_info.states[i]];
    }
}

bool core_get_derivatives(Core *core, double *dx)
{
    update(core);
    for (size_t i = 0; i < model_info.n_states; i++) {
        dx[i] = core->frame.v[model_info.derivatives[i]];
    }
    return derivatives_are_finite(core);
}

bool core_get_indicators(Core *core, double *z)
{
    update(core);
    for (size_t i = 0; i < model_info.n_indicators; i++) {
        z[i] = core->frame.v[model_layout.indicators[i]];
        if (!is_finite_at(core, model_layout.indicators[i], "the event indicator")) {
            return false;
        }
    }
    return true;
}

bool core_directional(Core *core, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                      size_t n_knowns, const double *seed, double *sensitivity)
{
    double *d = core->scratch;
    update(core);
    memset(d, 0, n_all() * sizeof *d);
    for (size_t i = 0; i < n_knowns; i++) {
        d[knowns[i]] = seed[i];
    }
    model_tangent(&core->frame, d);
    for (size_t i = 0; i < n_unknowns; i++) {
        sensitivity[i] = d[unknowns[i]];
        if (!isfinite(sensitivity[i])) {
            core_log(core, true, "the directional derivative of %s is %g at time %.17g",
                     model_info.names[unknowns[i]], sensitivity[i], core->frame.v[0]);
            return false;
        }
    }
    return true;
}

/* Snapshots */

static size_t fixed_size(void)
{
    return n_doubles() * sizeof(double) + sizeof(Status) + 2 * sizeof(bool);
}

size_t core_saved_size(const Core *core)
{
    return fixed_size() + delays_size(core->frame.delays, model_layout.n_delays);
}

void core_save(const Core *core, void *saved)
{
    char *to = saved;
    const bool flags[2] = {core->frame.fresh, core->frame.initial};
    memcpy(to, core->image, n_doubles() * sizeof(double));
    to += n_doubles() * sizeof(double);
    memcpy(to, &core->status, sizeof(Status));
    memcpy(to + sizeof(Status), flags, sizeof flags);
    delays_save(core->frame.delays, model_layout.n_delays, to + sizeof(Status) + sizeof flags);
}

/* Whether bytes are of a mode and of flags: any others read as such are undefined. */
static bool status_holds(const char *from)
{
    int mode;
    memcpy(&mode, from + offsetof(Status, mode), sizeof mode);
    if (mode < CORE_INSTANTIATED || mode > CORE_CONTINUOUS) {
        return false;
    }
    for (size_t i = offsetof(Status, due); i < offsetof(Status, stirred) + sizeof(bool); i++) {
        if (from[i] != 0 && from[i] != 1) {
            return false;
        }
    }
    for (size_t i = sizeof(Status); i < sizeof(Status) + 2 * sizeof(bool); i++) {
        if (from[i] != 0 && from[i] != 1) {
            return false;
        }
    }
    return true;
}

bool core_holds(const void *saved, size_t size)
{
    const char *from = saved;
    return size >= fixed_size() && status_holds(from + n_doubles() * sizeof(double))
        && delays_hold(model_layout.n_delays, from + fixed_size(), size - fixed_size());
}

bool core_load(Core *core, const void *saved)
{
    const char *from = saved;
    bool flags[2];
    if (!delays_load(core->frame.delays, model_layout.n_delays, from + fixed_size())) {
        return false;
    }
    memcpy(core->image, from, n_doubles() * sizeof(double));
    from += n_doubles() * sizeof(double);
    memcpy(&core->status, from, sizeof(Status));
    memcpy(flags, from + sizeof(Status), sizeof flags);
    core->frame.fresh = flags[0];
    core->frame.initial = flags[1];
    return true;
}
