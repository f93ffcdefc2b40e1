#include "kernel.h"

#include <math.h>
#include <string.h>

int32_t kernel_version(void) {
    return KERNEL_VERSION;
}

size_t kernel_sizeof(const char *structure) {
    static const struct {
        const char *name;
        size_t size;
    } sizes[] = {
        {"Failure", sizeof(Failure)}, {"Component", sizeof(Component)},     {"Block", sizeof(Block)},
        {"Access", sizeof(Access)},   {"Signal", sizeof(Signal)},           {"Forcing", sizeof(Forcing)},
        {"Link", sizeof(Link)},       {"System", sizeof(System)},           {"Fourier", sizeof(Fourier)},
        {"Record", sizeof(Record)},   {"GearLibrary", sizeof(GearLibrary)}, {"Me", sizeof(Me)},
        {"Cs", sizeof(Cs)},           {"Wires", sizeof(Wires)},           {"Lti", sizeof(Lti)},
        {"Slopes", sizeof(Slopes)},   {"Unit", sizeof(Unit)},             {"Master", sizeof(Master)},
        {"Control", sizeof(Control)}, {"Clocks", sizeof(Clocks)},         {"Tick", sizeof(Tick)},
        {"Intermediate", sizeof(Intermediate)}, {"Sparsity", sizeof(Sparsity)}, {"Predictor", sizeof(Predictor)},
        {"Element", sizeof(Element)}, {"Instants", sizeof(Instants)},
    };
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        if (strcmp(sizes[i].name, structure) == 0) {
            return sizes[i].size;
        }
    }
    return 0;
}

const char *kernel_function_name(size_t index) {
    return function_name(index);
}

int32_t kernel_system_open(System *system) {
    failure_clear(&system->failure);
    system->nx = system->nz = 0;
    system->limit = (double)INFINITY;
    for (size_t i = 0; i < system->n_components; i++) {
        Component *component = &system->components[i];
        component->calls = component_calls(component->version);
        if (!component->calls) {
            return 0;
        }
        system->nx += component->nx;
        system->nz += component->nz;
    }
    return 1;
}

int32_t kernel_me_open(Me *me) {
    return me_open(me);
}

int32_t kernel_me_restart(Me *me) {
    failure_clear(&me->system->failure);
    return me_restart(me);
}

int32_t kernel_me_run(Me *me, double until, const double *targets, size_t n_targets, Record *record, int32_t fresh) {
    return me_run(me, until, targets, n_targets, record, fresh != 0);
}

int32_t kernel_me_go_on(Me *me) {
    return me_go_on(me);
}

void kernel_me_close(Me *me) {
    me_close(me);
}

int32_t kernel_cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record, int32_t fresh) {
    return cs_run(cs, until, targets, n_targets, record, fresh != 0);
}

int32_t kernel_cs_go_on(Cs *cs) {
    return cs_go_on(cs);
}

size_t kernel_time_steps(System *system, double time, double step, size_t n, double patience, double *seconds) {
    return time_steps(system, time, step, n, patience, seconds);
}

size_t kernel_control_doubles(const Cs *cs) {
    return control_doubles(cs);
}

void kernel_record_columns(const Record *record, double *columns) {
    enum { BLOCK = 8 }; /* columns: a cache line of a row */
    for (size_t first = 0; first < record->width; first += BLOCK) {
        const size_t end = first + BLOCK < record->width ? first + BLOCK : record->width;
        for (size_t row = 0; row < record->rows; row++) {
            for (size_t column = first; column < end; column++) {
                columns[column * record->rows + row] = record->data[row * record->width + column];
            }
        }
    }
}

void kernel_record_free(Record *record) {
    record_free(record);
}

double kernel_signal_value(const Signal *signal, double t) {
    return signal_value(signal, t);
}

double kernel_signal_next_break(const Signal *signal, double t) {
    return signal_next_break(signal, t);
}

void kernel_fourier(Fourier *fourier, const double *rows, size_t n, size_t width, double *coefficients) {
    fourier_clear(fourier);
    for (size_t i = 0; i < n; i++) {
        fourier_add(fourier, rows + i * width);
    }
    fourier_result(fourier, coefficients);
}

void kernel_fourier_rough(const Fourier *fourier, double *errors) {
    fourier_rough(fourier, errors);
}

void kernel_fourier_result(const Fourier *fourier, double *coefficients) {
    fourier_result(fourier, coefficients);
}
