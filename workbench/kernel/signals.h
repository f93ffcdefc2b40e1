/* signals.h: functions of absolute session time; the twins of workbench/signals/kinds.py, to the last bit. */
#ifndef WORKBENCH_KERNEL_SIGNALS_H
#define WORKBENCH_KERNEL_SIGNALS_H

#include <stddef.h>
#include <stdint.h>

/* The order is that of the table in workbench/kernel/native_signals.py. */
typedef enum {
    SIGNAL_CONSTANT,     /* p: value */
    SIGNAL_SINE,         /* p: amplitude, omega [rad/s], phase [rad], offset, start [s] */
    SIGNAL_STEP,         /* p: time [s], value, initial */
    SIGNAL_PRBS,         /* p: hold [s], amplitude, offset, start [s]; bits [n] */
    SIGNAL_TABLE_LINEAR, /* times [n] [s], values [n] */
    SIGNAL_TABLE_HOLD,
    SIGNAL_PYTHON, /* a signal the kernel does not know: two calls back to the caller */
    N_SIGNALS
} SignalKind;

enum { SIGNAL_PARAMETERS = 5 };

typedef struct {
    int32_t kind;
    double p[SIGNAL_PARAMETERS];
    const double *times, *values;
    const uint8_t *bits;
    size_t n;
    double (*evaluate)(double t);
    double (*following)(double t);
} Signal;

/* The right limit at t. */
double signal_value(const Signal *signal, double t);
/* The first time after t where the value or the slope jumps, or infinity. */
double signal_next_break(const Signal *signal, double t);

#endif
