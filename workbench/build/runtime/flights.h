/* flights.h: infinitely many state events before a finite time (Zeno behaviour). */
#ifndef WORKBENCH_FLIGHTS_H
#define WORKBENCH_FLIGHTS_H

#include <stdbool.h>

#define FLIGHTS_GAPS 7

/* The gaps between the last state events [s]. Only doubles: it lies in a saved state. */
typedef struct {
    double last;               /* state event that is not an indicator leaving its zero again [s] */
    double gaps[FLIGHTS_GAPS]; /* between such events, the latest first; HUGE_VAL: none */
    double longest_pair;       /* two successive gaps, before they began to shrink */
    double gathering;          /* where the events gather as of the last one, HUGE_VAL: nowhere */
} Flights;

void flights_forget(Flights *flights);

/* A state event at `now`; `span` is the time scale. True: infinitely many of them end here, at *end. */
bool flights_dwindle(Flights *flights, double now, double span, double *end);

/* The longest step to begin with at `now`: the next event may follow as quickly as the last one did. */
double flights_longest_step(const Flights *flights, double now);

#endif
