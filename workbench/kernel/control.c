#include "control.h"

#include <math.h>
#include <string.h>

#include "cs_step.h"

static const double SAFETY = 0.8, SHRINK = 0.2, GROW = 2.0;
static const double LOCAL_ORDER = 3.0; /* of a step's error with linear inputs; with held ones 2: more are refused */
static const double SLIVER = 1e-9;     /* of a step: no piece is as short */

/* ---- going back ---- */

typedef enum { KEEP, PUT_BACK } Way;

/* What the master, its connections and its groups need besides the states of the FMUs, one after the other. */
static double *carry(double *at, double *values, size_t n, Way way) {
    if (n > 0) {
        memcpy(way == KEEP ? at : values, way == KEEP ? values : at, n * sizeof *values);
    }
    return at + n;
}

static double *carry_closed(double *at, const Wires *wires, Way way) {
    for (size_t i = 0; i < wires->n; i++) {
        if (way == KEEP) {
            at[i] = wires->closed[i];
        } else {
            wires->closed[i] = at[i] != 0.0;
        }
    }
    return at + wires->n;
}

static double *carry_wires(double *at, const Wires *wires, Way way) {
    at = carry(at, wires->values, wires->n, way);
    at = carry(at, wires->sizes, wires->n, way);
    return carry_closed(at, wires, way);
}

static double *carry_clocks(double *at, const Clocks *clocks, Way way) {
    for (size_t i = 0; i < clocks->n; i++) {
        Tick *tick = &clocks->ticks[i];
        at = carry(at, &tick->next, 1, way);
        at = carry(at, &tick->instants.first, 1, way);
        at = carry(at, &tick->instants.step, 1, way);
        at = carry(at, &tick->instants.denominator, 1, way);
        at = carry(at, &tick->count, 1, way);
        at = carry(at, &clocks->counts[tick->place], 1, way);
    }
    for (size_t i = 0; i < clocks->n_told; i++) {
        at = carry(at, &clocks->counts[clocks->places[i]], 1, way);
    }
    return at;
}

static double *carry_group(double *at, Unit *unit, Way way) {
    Me *me = unit->me;
    at = carry_wires(at, &me->system->wires, way);
    at = carry(at, me->scale, me->system->nx, way);
    at = carry(at, &me->next_time, 1, way);
    at = carry(at, &me->time, 1, way);
    unit->stale = 1;
    return at;
}

static void carry_all(Cs *cs, Way way) {
    System *system = cs->system;
    Master *master = cs->master;
    double *at = master->control->saved;
    at = carry(at, &cs->time, 1, way);
    at = carry(at, &cs->previous, 1, way);
    at = carry_wires(at, &system->wires, way);
    at = carry(at, master->slopes, 2 * system->wires.n, way);
    at = carry(at, master->spans, 2, way);
    at = carry(at, system->forcing->written, system->forcing->n, way);
    for (size_t i = 0; i < system->n_components; i++) {
        at = carry(at, &system->components[i].due, 1, way);
        at = carry(at, &system->components[i].time, 1, way);
        if (system->components[i].clocks) {
            at = carry_clocks(at, system->components[i].clocks, way);
        }
    }
    for (size_t k = 0; k < master->n_units; k++) {
        if (master->units[k].me) {
            at = carry_group(at, &master->units[k], way);
        }
    }
}

size_t control_doubles(const Cs *cs) {
    const System *system = cs->system;
    size_t n = 4 + 5 * system->wires.n + system->forcing->n + 2 * system->n_components;
    for (size_t i = 0; i < system->n_components; i++) {
        const Clocks *clocks = system->components[i].clocks;
        n += clocks ? 6 * clocks->n + clocks->n_told : 0;
    }
    for (size_t k = 0; k < cs->master->n_units; k++) {
        const Me *me = cs->master->units[k].me;
        n += me ? 3 * me->system->wires.n + me->system->nx + 2 : 0;
    }
    return n;
}

/* `function`: to get, set or free the saved states of all FMUs; also after one has failed the others are freed. */
static bool states(Cs *cs, FunctionIndex function) {
    System *system = cs->system;
    void **saved = cs->master->control->states;
    bool done = true;
    for (size_t i = 0; i < system->n_components && (done || function == FREE_FMU_STATE); i++) {
        done = component_saved(&system->components[i], function, &saved[i], (int32_t)i, &system->failure) && done;
    }
    return done;
}

static bool keep(Cs *cs) {
    Control *control = cs->master->control;
    memset(control->states, 0, cs->system->n_components * sizeof *control->states);
    carry_all(cs, KEEP);
    return states(cs, GET_FMU_STATE);
}

static bool go_back(Cs *cs) {
    carry_all(cs, PUT_BACK);
    cs->master->event_due = 0;
    cs->system->forcing->has_wanted = 0;
    return states(cs, SET_FMU_STATE);
}

/* ---- the error ---- */

bool control_watch(Cs *cs) {
    const Control *control = cs->master->control;
    for (size_t i = 0; i < control->n_wires; i++) {
        control->fine[i] = cs->master->reached[control->wires[i]];
    }
    double *outputs = control->fine + control->n_wires;
    return access_read(&control->outputs, cs->system->components, outputs, &cs->system->failure);
}

/* Whether the step is good enough; what comes next is noted. */
static bool judge(Control *control, double span) {
    const size_t n = control->n_wires + control->n_outputs;
    double error = 0.0;
    for (size_t i = 0; i < n; i++) {
        const double seen = fmax(fabs(control->coarse[i]), fabs(control->fine[i]));
        const double scale = fmax(control->scale[i], seen);
        if (scale > 0.0) {
            error = fmax(error, fabs(control->fine[i] - control->coarse[i]) / scale / control->tolerance);
        }
    }
    const double factor = error == 0.0 ? GROW : SAFETY * pow(error, -1.0 / LOCAL_ORDER);
    const double step = span * fmin(fmax(factor, SHRINK), GROW);
    if (error > 1.0) {
        control->step = step;
        return false;
    }
    /* A last piece before a point is short for no reason of accuracy. */
    control->step = span < control->step ? fmax(step, control->step) : step;
    for (size_t i = 0; i < n; i++) {
        control->scale[i] = fmax(control->scale[i], fmax(fabs(control->coarse[i]), fabs(control->fine[i])));
    }
    return true;
}

/* ---- one step in one, then in two halves ---- */

static bool in_one(Cs *cs, double end) {
    Control *control = cs->master->control;
    cs_look_ahead(cs, end);
    if (!cs_step_to(cs, end)) {
        return false;
    }
    copy_values(control->coarse, control->fine, control->n_wires + control->n_outputs);
    return true;
}

static bool in_two(Cs *cs, double end) {
    const double middle = cs->time + 0.5 * (end - cs->time);
    return cs_communicate(cs, middle, false) && cs_communicate(cs, end, end == cs->until);
}

/* Hand over the rows of the step. */
static bool hand_over(Cs *cs, Record *record) {
    Control *control = cs->master->control;
    const Record *trial = &control->trial;
    for (size_t i = 0; i < trial->rows; i++) {
        const double *row = trial->data + i * trial->width;
        const bool second = i > 0 && (i & 1) != 0;
        const RowKind kind = second ? ROW_SECOND : row[0] == cs->until ? ROW_ALWAYS : ROW_POINT;
        if (!record_put(record, row, kind)) {
            return fail_at(&cs->system->failure, FAILED_MEMORY, row[0]);
        }
    }
    return true;
}

/* The two halves, whose rows are kept apart; also those before a failure are handed over. */
static bool try_halves(Cs *cs, double end, double least, bool *good) {
    Control *control = cs->master->control;
    Record *record = cs->record, *trial = &control->trial;
    const double span = end - cs->time;
    trial->access = record->access;
    trial->n_values = record->n_values;
    trial->bound = record->bound;
    trial->keep = 1;
    trial->every = 1;
    record_begin(trial, cs->system);
    cs->record = trial;
    const bool done = in_two(cs, end);
    cs->record = record;
    *good = done && (judge(control, span) || span <= least);
    if (done && !*good) {
        return true;
    }
    const bool handed = hand_over(cs, record);
    control->longest = *good ? fmax(control->longest, 0.5 * span) : control->longest;
    return done && handed;
}

bool control_step(Cs *cs) {
    Control *control = cs->master->control;
    const double begin = cs->time;
    const double step = fmin(control->step, cs->system->forcing->longest_step);
    const double pieces = fmax(1.0, ceil((cs->target - begin) / step - SLIVER));
    const double end = pieces == 1.0 ? cs->target : begin + (cs->target - begin) / pieces;
    bool good = false;
    bool done = keep(cs) && in_one(cs, end) && go_back(cs) && try_halves(cs, end, control->least, &good) &&
                (good || go_back(cs));
    const bool freed = states(cs, FREE_FMU_STATE);
    cs->made = cs->time == cs->target ? cs->count : 0.0;
    return done && freed;
}
