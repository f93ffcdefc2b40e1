/* delays.c: see delays.h. */
#include "delays.h"

#include <float.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define CUT_SHORT 0.9 /* of the longest step: by an event of the delay */
enum { FIRST_CAPACITY = 64 };

static size_t count_of(const Delay *delay)
{
    return (size_t)delay->record.count;
}

/* To rounding: a loop through a delay that is closed at the start would else never come to rest. */
static bool as_before(const DelayRecord *r, double input)
{
    return fabs(input - r->before) <= 4.0 * DBL_EPSILON * fmax(fabs(input), fabs(r->before));
}

static Sample *last_of(const Delay *delay)
{
    return &delay->samples[count_of(delay) - 1];
}

/* Whether there is a past to read: else the input goes straight through. */
static bool has_begun(const Delay *delay, double time)
{
    return count_of(delay) > 1 || (count_of(delay) == 1 && time > delay->samples[0].t);
}

/* ---- reading, by the equations ---- */

double delayed(const Frame *f, double input, double lag, double number)
{
    Delay *delay = &f->delays[(size_t)number];
    const double time = f->v[0];
    double slope;
    delay->record.input = input;
    if (!has_begun(delay, time)) {
        delay->record.lag = lag;
        return as_before(&delay->record, input) ? delay->record.before : input;
    }
    return history_value(delay->samples, count_of(delay), time - delay->record.lag, delay->record.passed, &slope);
}

double goes_through(const Frame *f, double number)
{
    return has_begun(&f->delays[(size_t)number], f->v[0]) ? 0.0 : 1.0;
}

/* ---- life ---- */

void delays_reset(Delay *delays, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        delays[k].record = (DelayRecord){.passed = -HUGE_VAL, .longest = HUGE_VAL, .due = HUGE_VAL, .allowed = HUGE_VAL};
    }
}

void delays_free(Delay *delays, size_t n)
{
    for (size_t k = 0; delays != NULL && k < n; k++) {
        free(delays[k].samples);
    }
    free(delays);
}

const Delay *delays_wrong(const Delay *delays, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (!(delays[k].record.lag > 0.0 && isfinite(delays[k].record.lag))) {
            return &delays[k];
        }
    }
    return NULL;
}

/* ---- events ---- */

static bool in_haste(const DelayRecord *r)
{
    return r->allowed < CUT_SHORT * r->longest;
}

bool delays_in_haste(const Delay *delays, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (in_haste(&delays[k].record)) {
            return true;
        }
    }
    return false;
}

bool delays_plan(Delay *delays, size_t n, double time)
{
    bool asked_for = false;
    for (size_t k = 0; k < n; k++) {
        DelayRecord *r = &delays[k].record;
        if (reached(time, r->due) || in_haste(r)) {
            r->longest = fmin(r->lag, fmax(HISTORY_LEAST_STEP * r->lag, fmin(2.0 * r->longest, r->allowed)));
            r->allowed = HUGE_VAL;
            r->due = time + r->longest;
            asked_for = true;
        }
    }
    return asked_for;
}

void delays_begin_again(Delay *delays, size_t n, double time)
{
    for (size_t k = 0; k < n; k++) {
        DelayRecord *r = &delays[k].record;
        r->longest = fmin(r->longest, HISTORY_FIRST_STEP * r->lag);
        r->allowed = HUGE_VAL;
        r->due = fmin(r->due, time + r->longest);
    }
}

static const Sample *next_jump(const Delay *delay)
{
    return history_jump_after(delay->samples, count_of(delay), delay->record.passed);
}

bool delays_choose(Delay *delays, size_t n, double time)
{
    bool chosen = false;
    for (size_t k = 0; k < n; k++) {
        const Sample *jump = next_jump(&delays[k]);
        while (jump != NULL && reached(time, jump->t + delays[k].record.lag)) {
            delays[k].record.passed = jump->t;
            chosen = true;
            jump = next_jump(&delays[k]);
        }
    }
    return chosen;
}

bool delays_unsettled(Delay *delays, size_t n, double time)
{
    bool unsettled = false;
    for (size_t k = 0; k < n; k++) {
        DelayRecord *r = &delays[k].record;
        const bool same = as_before(r, r->input);
        unsettled = unsettled || (!same && !has_begun(&delays[k], time));
        r->before = same ? r->before : r->input;
    }
    return unsettled;
}

double delays_next(const Delay *delays, size_t n)
{
    double next = HUGE_VAL;
    for (size_t k = 0; k < n; k++) {
        const Sample *jump = next_jump(&delays[k]);
        next = fmin(next, delays[k].record.due);
        next = jump != NULL ? fmin(next, jump->t + delays[k].record.lag) : next;
    }
    return next;
}

/* ---- writing ---- */

static bool reserve(Delay *delay, size_t n)
{
    if (n <= delay->capacity) {
        return true;
    }
    const size_t doubled = delay->capacity > 0 ? 2 * delay->capacity : FIRST_CAPACITY;
    const size_t capacity = n > doubled ? n : doubled;
    if (capacity > SIZE_MAX / sizeof(Sample)) {
        return false;
    }
    Sample *samples = realloc(delay->samples, capacity * sizeof *samples);
    if (samples == NULL) {
        return false;
    }
    delay->samples = samples;
    delay->capacity = capacity;
    return true;
}

static bool push(Delay *delay, double time, double begins)
{
    const size_t n = count_of(delay);
    if (!reserve(delay, n + 1)) {
        return false;
    }
    delay->samples[n] = (Sample){time, delay->record.input, begins};
    delay->record.count = (double)(n + 1);
    delay->record.largest = fmax(delay->record.largest, fabs(delay->record.input));
    return true;
}

/* Forget what nobody will ask for again. */
static void prune(Delay *delay, double time)
{
    const size_t gone = history_old(delay->samples, count_of(delay), delay->capacity, time - delay->record.lag);
    if (gone > 0) {
        delay->record.count -= (double)gone;
        memmove(delay->samples, delay->samples + gone, count_of(delay) * sizeof *delay->samples);
    }
}

/* An environment that went back in time without a saved state. */
static void go_back(Delay *delay, double time)
{
    while (count_of(delay) > 1 && last_of(delay)->t > time) {
        delay->record.count -= 1.0;
    }
}

static void adapt(Delay *delay)
{
    DelayRecord *r = &delay->record;
    const size_t n = count_of(delay);
    const double factor = history_factor(delay->samples, n, DELAY_TOLERANCE * r->largest);
    const double step = delay->samples[n - 1].t - delay->samples[n - 2].t;
    if (factor < 1.0 || step > CUT_SHORT * r->longest) { /* else the integrator's steps are short enough by themselves */
        r->allowed = fmin(r->allowed, factor * step);
    }
}

static bool note_step(Delay *delay, double time)
{
    if (count_of(delay) == 0) {
        return push(delay, time, HISTORY_KINK);
    }
    go_back(delay, time);
    if (time - last_of(delay)->t <= HISTORY_TOGETHER * delay->record.lag) {
        return true;
    }
    if (!push(delay, time, HISTORY_PLAIN)) {
        return false;
    }
    adapt(delay);
    prune(delay, time);
    return true;
}

static bool note_event(Delay *delay, double time, bool quiet)
{
    go_back(delay, time);
    if (!has_begun(delay, time)) { /* the past is what stands at the start */
        delay->record.count = 0.0;
        delay->record.largest = 0.0;
        return push(delay, time, HISTORY_KINK);
    }
    Sample *last = last_of(delay);
    const double u = delay->record.input;
    const double width = time - last->t;
    const bool jumps = fabs(u - last->u) > HISTORY_SAME * fmax(delay->record.largest, fabs(u));
    const double otherwise = quiet ? HISTORY_PLAIN : HISTORY_KINK;
    if (width <= 0.0 && history_begins(last, HISTORY_JUMP)) { /* a further event at the same time */
        last->u = u;
        return true;
    }
    if (width <= 0.0 && !jumps) {
        last->begins = fmax(last->begins, otherwise);
        return true;
    }
    return push(delay, time, jumps && width <= HISTORY_TOGETHER * delay->record.lag ? HISTORY_JUMP : otherwise);
}

bool delays_note_step(Delay *delays, size_t n, double time)
{
    bool good = true;
    for (size_t k = 0; k < n; k++) {
        good = note_step(&delays[k], time) && good;
    }
    return good;
}

bool delays_note_event(Delay *delays, size_t n, double time, bool quiet)
{
    bool good = true;
    for (size_t k = 0; k < n; k++) {
        good = note_event(&delays[k], time, quiet) && good;
    }
    return good;
}

/* ---- saved states: each delay's record, then its samples ---- */

size_t delays_size(const Delay *delays, size_t n)
{
    size_t size = n * sizeof(DelayRecord);
    for (size_t k = 0; k < n; k++) {
        size += count_of(&delays[k]) * sizeof(Sample);
    }
    return size;
}

void delays_save(const Delay *delays, size_t n, char *to)
{
    for (size_t k = 0; k < n; k++) {
        const size_t samples = count_of(&delays[k]) * sizeof(Sample);
        memcpy(to, &delays[k].record, sizeof(DelayRecord));
        to += sizeof(DelayRecord);
        if (samples > 0) {
            memcpy(to, delays[k].samples, samples);
        }
        to += samples;
    }
}

static bool may_begin(double begins)
{
    return begins >= HISTORY_PLAIN && begins <= HISTORY_JUMP && floor(begins) >= begins;
}

/* Whether they are what was noted: one after the other. */
static bool samples_hold(const char *from, size_t n)
{
    double before = -HUGE_VAL;
    for (size_t i = 0; i < n; i++) {
        Sample sample;
        memcpy(&sample, from + i * sizeof sample, sizeof sample);
        if (!(isfinite(sample.t) && sample.t >= before && may_begin(sample.begins))) {
            return false;
        }
        before = sample.t;
    }
    return true;
}

/* Whether a record may have that many samples at most, and its times are some. */
static bool record_holds(const DelayRecord *r, size_t most)
{
    const bool counts = r->count >= 0.0 && r->count <= (double)most && floor(r->count) >= r->count;
    const bool lasts = !(r->count > 0.0) || (r->lag > 0.0 && isfinite(r->lag));
    return counts && lasts && !isnan(r->passed) && r->longest > 0.0 && !isnan(r->due) && r->allowed > 0.0;
}

bool delays_hold(size_t n, const char *from, size_t size)
{
    for (size_t k = 0; k < n; k++) {
        DelayRecord record;
        if (size < sizeof record) {
            return false;
        }
        memcpy(&record, from, sizeof record);
        from += sizeof record;
        size -= sizeof record;
        if (!record_holds(&record, size / sizeof(Sample)) || !samples_hold(from, (size_t)record.count)) {
            return false;
        }
        from += (size_t)record.count * sizeof(Sample);
        size -= (size_t)record.count * sizeof(Sample);
    }
    return size == 0;
}

bool delays_load(Delay *delays, size_t n, const char *from)
{
    for (size_t k = 0; k < n; k++) {
        DelayRecord record;
        memcpy(&record, from, sizeof record);
        from += sizeof record;
        const size_t count = (size_t)record.count;
        if (!reserve(&delays[k], count)) {
            return false;
        }
        delays[k].record = record;
        if (count > 0) {
            memcpy(delays[k].samples, from, count * sizeof(Sample));
        }
        from += count * sizeof(Sample);
    }
    return true;
}
