#include "timing.h"

#include "stopwatch.h"

static bool settle(Component *component, Failure *failure) {
    return component_enter(component, ENTER_EVENT_MODE, 0, failure) && component_settle(component, 0, failure);
}

size_t time_steps(System *system, double time, double step, size_t n, double patience, double *seconds) {
    Component *component = system->components;
    const double until = stopwatch() + patience;
    size_t made = 0;
    bool good = true;
    for (double after = until - patience; good && made < n && after < until; made += good) {
        const double start = time + (double)made * step;
        Answer answer = {0};
        component->time = start;
        const double before = stopwatch();
        const int status = component->calls->do_step(component, start, step, &answer);
        after = stopwatch();
        seconds[made] = after - before;
        good = component_checked(component, DO_STEP, status, 0, &system->failure) && !answer.terminate &&
               answer.time >= start + step &&
               (!answer.event || !component->event_mode || settle(component, &system->failure));
    }
    return made;
}
