#include "system.h"

#include <math.h>

void system_go_on(System *system) {
    system->pause_at = system->steps + STEPS_BETWEEN_PAUSES;
    failure_clear(&system->failure);
}

bool system_pauses(System *system, double time) {
    return system->steps >= system->pause_at && !fail_at(&system->failure, PAUSED, time);
}

static bool link_propagate(System *system, Link *link, bool *changed) {
    if (!access_read(&link->source, system->components, link->fresh, &system->failure)) {
        return false;
    }
    for (size_t i = 0; i < link->n; i++) {
        const double value = link->gains[i] * link->fresh[i];
        *changed = *changed || !(value == link->values[i]);
        link->values[i] = value;
    }
    return access_write(&link->destination, system->components, link->values, &system->failure);
}

bool system_propagate(System *system, bool events, bool *changed) {
    bool some = false;
    for (size_t i = 0; i < system->n_links; i++) {
        Link *link = &system->links[i];
        if ((events || !link->discrete) && !link_propagate(system, link, &some)) {
            return false;
        }
    }
    if (changed) {
        *changed = some;
    }
    return true;
}

bool system_put(System *system, double t, const double *x) {
    for (size_t i = 0; i < system->n_components; i++) {
        Component *component = &system->components[i];
        /* FMI's setter takes a pointer to const; one signature serves getters and setters here. */
        if (!component_set_time(component, t, (int32_t)i, &system->failure) ||
            !component_states(component, SET_STATES, (double *)x, component->nx, (int32_t)i, &system->failure)) {
            return false;
        }
        x += component->nx;
    }
    return forcing_write_continuous(system->forcing, system->components, fmin(system->limit, t), &system->failure) &&
           system_propagate(system, false, NULL);
}

bool system_vectors(System *system, FunctionIndex function, double *values, bool indicators) {
    for (size_t i = 0; i < system->n_components; i++) {
        const Component *component = &system->components[i];
        const size_t n = indicators ? component->nz : component->nx;
        if (!component_states(component, function, values, n, (int32_t)i, &system->failure)) {
            return false;
        }
        values += n;
    }
    return true;
}

bool system_enter(System *system, FunctionIndex mode) {
    for (size_t i = 0; i < system->n_components; i++) {
        if (!component_enter(&system->components[i], mode, (int32_t)i, &system->failure)) {
            return false;
        }
    }
    return true;
}
