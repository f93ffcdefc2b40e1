#define _POSIX_C_SOURCE 200809L /* clock_gettime */

#include "timing.h"

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

/* The time of a clock that only goes on [s]. */
static double now(void) {
    LARGE_INTEGER ticks, per_second;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&per_second);
    return (double)ticks.QuadPart / (double)per_second.QuadPart;
}
#else
#include <time.h>

/* The time of a clock that only goes on [s]. */
static double now(void) {
    struct timespec read = {0};
    clock_gettime(CLOCK_MONOTONIC, &read);
    return (double)read.tv_sec + 1e-9 * (double)read.tv_nsec;
}
#endif

static bool settle(Component *component, Failure *failure) {
    return component_enter(component, ENTER_EVENT_MODE, 0, failure) && component_settle(component, 0, failure);
}

size_t time_steps(System *system, double time, double step, size_t n, double patience, double *seconds) {
    Component *component = system->components;
    const double until = now() + patience;
    size_t made = 0;
    bool good = true;
    for (double after = until - patience; good && made < n && after < until; made += good) {
        const double start = time + (double)made * step;
        Answer answer = {0};
        component->time = start;
        const double before = now();
        const int status = component->calls->do_step(component, start, step, &answer);
        after = now();
        seconds[made] = after - before;
        good = component_checked(component, DO_STEP, status, 0, &system->failure) && !answer.terminate &&
               answer.time >= start + step &&
               (!answer.event || !component->event_mode || settle(component, &system->failure));
    }
    return made;
}
