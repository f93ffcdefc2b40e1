/* delays.h: the signals that delay() reads a while later: their past, part of an instance's state.
 *
 * A delay notes its input after each accepted step and at each event. A step must not be longer than the delay, nor so
 * long that the polynomial between samples is off by more than DELAY_TOLERANCE: time events of its own see to it, rarer
 * where the integrator's steps are short enough. A jump comes out a delay later, at a time event. Before the first step
 * the input goes straight through; its value then is the past.
 */
#ifndef WORKBENCH_DELAYS_H
#define WORKBENCH_DELAYS_H

#include "history.h"

#define DELAY_TOLERANCE 1e-7 /* of the largest |u|, as estimated for each step; a few are up to 20 times as bad */

/* Only doubles: it lies in a saved state. */
typedef struct {
    double lag;      /* the delay [s] */
    double input;    /* as of the last evaluation ... */
    double before;   /* ... and in the event iteration before */
    double largest;  /* |u| so far */
    double passed;   /* time of the last jump that has come out, -HUGE_VAL: none [s] */
    double longest;  /* step that may follow [s] */
    double due;      /* the next event of its own, HUGE_VAL: none is known [s] */
    double allowed;  /* step, as of those since the last such event [s] */
    double count;    /* of samples */
} DelayRecord;

typedef struct Delay {
    DelayRecord record;
    Sample *samples; /* [count] of [capacity] */
    size_t capacity;
} Delay;

void delays_reset(Delay *delays, size_t n);
void delays_free(Delay *delays, size_t n);
/* The delay whose time is not a number above 0, NULL: there is none. */
const Delay *delays_wrong(const Delay *delays, size_t n);
/* At the beginning of an event: when to have the next one. True: it is one that a delay asked for. */
bool delays_plan(Delay *delays, size_t n, double time);
/* Where it changes the model, or the environment: what follows is not known, short steps must tell. */
void delays_begin_again(Delay *delays, size_t n, double time);
/* At an event: jumps that now come out; true: there are such. */
bool delays_choose(Delay *delays, size_t n, double time);
/* After an event iteration: whether an input that goes straight through has changed. */
bool delays_unsettled(Delay *delays, size_t n, double time);
/* After a step: whether the next one must be shorter than what is left until the next event. */
bool delays_in_haste(const Delay *delays, size_t n);
double delays_next(const Delay *delays, size_t n); /* event, HUGE_VAL: none [s] */
/* Note the inputs after a step. False: no memory. */
bool delays_note_step(Delay *delays, size_t n, double time);
/* Note them at the end of an event; `quiet`: nothing happened at it. False: no memory. */
bool delays_note_event(Delay *delays, size_t n, double time, bool quiet);

size_t delays_size(const Delay *delays, size_t n); /* of what is saved [bytes] */
void delays_save(const Delay *delays, size_t n, char *to);
/* Whether `size` bytes, which may come from anywhere, can be what delays_save wrote. */
bool delays_hold(size_t n, const char *from, size_t size);
/* From bytes that hold. False: no memory. */
bool delays_load(Delay *delays, size_t n, const char *from);

#endif
