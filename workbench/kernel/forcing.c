#include "forcing.h"

#include <math.h>

double forcing_next_break(Forcing *forcing, double t) {
    if (forcing->has_break && t >= forcing->break_from && t < forcing->break_at) {
        return forcing->break_at;
    }
    double first = (double)INFINITY;
    for (size_t i = 0; i < forcing->n; i++) {
        first = fmin(first, signal_next_break(&forcing->signals[i], t));
    }
    forcing->has_break = first > t;
    forcing->break_from = t;
    forcing->break_at = first;
    return first;
}

double forcing_value(const Forcing *forcing, size_t i, double t) {
    return signal_value(&forcing->signals[i], t) + forcing->bias[i];
}

void forcing_evaluate(Forcing *forcing, double t) {
    if (forcing->has_wanted && forcing->wanted_at == t) {
        return;
    }
    forcing->has_wanted = 1;
    forcing->wanted_at = t;
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->wanted[i] = value_as_type((ValueType)forcing->types[i], forcing_value(forcing, i, t));
    }
}

bool forcing_differs(const Forcing *forcing, Inputs which, int32_t who) {
    for (size_t i = 0; i < forcing->n; i++) {
        const Inputs kind = forcing->discrete[i] ? DISCRETE_INPUTS : CONTINUOUS_INPUTS;
        const bool meant = (which & kind) != 0 && (who == ANYONE || forcing->owners[i] == who);
        if (meant && !(forcing->wanted[i] == forcing->written[i])) {
            return true;
        }
    }
    return false;
}

bool forcing_write_continuous(Forcing *forcing, Component *components, double t, Failure *failure) {
    if (forcing->fast.n_blocks == 0) {
        return true;
    }
    for (size_t i = 0; i < forcing->n; i++) {
        if (!forcing->discrete[i]) {
            forcing->written[i] = forcing_value(forcing, i, t);
        }
    }
    return access_write(&forcing->fast, components, forcing->written, failure);
}

bool forcing_write_wanted(Forcing *forcing, Component *components, Failure *failure) {
    if (!access_write(&forcing->fast, components, forcing->wanted, failure) ||
        !access_write(&forcing->slow, components, forcing->wanted, failure)) {
        return false;
    }
    copy_values(forcing->written, forcing->wanted, forcing->n);
    return true;
}

/* ---- slopes ---- */

/* Give one block its slopes; whether the FMU took them. */
static bool block_slopes(Forcing *forcing, const Block *block, Component *component, double span, const double *left) {
    if (!component->interpolates || !component->slopes_work) {
        return false;
    }
    for (size_t k = 0; k < block->n; k++) {
        const size_t i = block->columns[k];
        forcing->slopes[block->slots[k]] = (left[i] - forcing->written[i]) / span;
    }
    int status = NOT_EXPORTED;
    if (component->calls->set_slopes && block->type == FLOAT64) {
        status = component->calls->set_slopes(component, block->references, block->n_references, forcing->orders,
                                              forcing->slopes);
    }
    /* Some FMUs claim to interpolate inputs but answer with an error; theirs are held then. */
    component->slopes_work = status >= 0 && status <= FMI_WARNING;
    return component->slopes_work != 0;
}

void forcing_look_ahead(Forcing *forcing, double t, double end) {
    const double left = forcing_next_break(forcing, t) > end ? end : nextafter(end, -(double)INFINITY);
    /* A continuous input is a number with a point: its value is what `forcing_evaluate` would find. */
    forcing->has_wanted = forcing->n_discrete == 0;
    forcing->wanted_at = left;
    for (size_t i = 0; i < forcing->n; i++) {
        forcing->wanted[i] = forcing->discrete[i] ? forcing->written[i] : forcing_value(forcing, i, left);
    }
}

void forcing_give_slopes(Forcing *forcing, Component *components, double t, double end) {
    copy_values(forcing->seen, forcing->written, forcing->n);
    bool usable = false;
    for (size_t b = 0; b < forcing->fast.n_blocks; b++) {
        const Component *component = &components[forcing->fast.blocks[b].component];
        usable = usable || (component->interpolates && component->slopes_work);
    }
    if (!usable) {
        return;
    }
    forcing_look_ahead(forcing, t, end);
    for (size_t b = 0; b < forcing->fast.n_blocks; b++) {
        const Block *block = &forcing->fast.blocks[b];
        if (block_slopes(forcing, block, &components[block->component], end - t, forcing->wanted)) {
            for (size_t k = 0; k < block->n; k++) {
                forcing->seen[block->columns[k]] = forcing->wanted[block->columns[k]];
            }
        }
    }
}
