#include "signals.h"

#include <math.h>

typedef struct {
    double (*value)(const Signal *signal, double t);
    double (*next_break)(const Signal *signal, double t);
} SignalMethods;

static double no_break(const Signal *signal, double t) {
    (void)signal;
    (void)t;
    return (double)INFINITY;
}

static double constant_value(const Signal *signal, double t) {
    (void)t;
    return signal->p[0];
}

static double sine_value(const Signal *signal, double t) {
    const double *p = signal->p;
    return p[3] + p[0] * sin(p[1] * (t - p[4]) + p[2]);
}

static double step_value(const Signal *signal, double t) {
    return t >= signal->p[0] ? signal->p[1] : signal->p[2];
}

static double step_break(const Signal *signal, double t) {
    return t < signal->p[0] ? signal->p[0] : (double)INFINITY;
}

/* ---- pseudo-random binary sequence ---- */

static double prbs_begin(const Signal *signal, int64_t i) {
    return signal->p[3] + (double)i * signal->p[0];
}

static int64_t prbs_index(const Signal *signal, double t) {
    const double quotient = floor((t - signal->p[3]) / signal->p[0]);
    const int64_t i = fabs(quotient) < 9e15 ? (int64_t)quotient : 0;
    /* The quotient may round across a bit's border; the border itself decides. */
    if (prbs_begin(signal, i + 1) <= t) {
        return i + 1;
    }
    return prbs_begin(signal, i) > t ? i - 1 : i;
}

static uint8_t prbs_bit(const Signal *signal, int64_t i) {
    const int64_t n = (int64_t)signal->n;
    const int64_t k = i % n;
    return signal->bits[k < 0 ? k + n : k];
}

static double prbs_value(const Signal *signal, double t) {
    const double sign = prbs_bit(signal, prbs_index(signal, t)) ? 1.0 : -1.0;
    return signal->p[2] + sign * signal->p[1];
}

static double prbs_break(const Signal *signal, double t) {
    const int64_t i = prbs_index(signal, t);
    int64_t k = i + 1;
    while (prbs_bit(signal, k) == prbs_bit(signal, i)) {
        k++;
    }
    return prbs_begin(signal, k);
}

/* ---- tables ---- */

/* The number of times that are not after t. */
static size_t table_index(const Signal *signal, double t) {
    size_t low = 0;
    size_t high = signal->n;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (t < signal->times[middle]) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}

static double table_hold(const Signal *signal, double t) {
    const size_t i = table_index(signal, t);
    return signal->values[i == 0 ? 0 : i - 1];
}

static double table_linear(const Signal *signal, double t) {
    const size_t i = table_index(signal, t);
    if (i == 0 || i == signal->n) {
        return signal->values[i == 0 ? 0 : i - 1];
    }
    const double t0 = signal->times[i - 1];
    const double t1 = signal->times[i];
    const double y0 = signal->values[i - 1];
    const double y1 = signal->values[i];
    return y0 + (y1 - y0) * ((t - t0) / (t1 - t0));
}

static double table_break(const Signal *signal, double t) {
    const size_t i = table_index(signal, t);
    return i < signal->n ? signal->times[i] : (double)INFINITY;
}

/* ---- the caller's own ---- */

static double python_value(const Signal *signal, double t) {
    return signal->evaluate(t);
}

static double python_break(const Signal *signal, double t) {
    return signal->following(t);
}

static const SignalMethods METHODS[N_SIGNALS] = {
    [SIGNAL_CONSTANT] = {constant_value, no_break},
    [SIGNAL_SINE] = {sine_value, no_break},
    [SIGNAL_STEP] = {step_value, step_break},
    [SIGNAL_PRBS] = {prbs_value, prbs_break},
    [SIGNAL_TABLE_LINEAR] = {table_linear, table_break},
    [SIGNAL_TABLE_HOLD] = {table_hold, table_break},
    [SIGNAL_PYTHON] = {python_value, python_break},
};

double signal_value(const Signal *signal, double t) {
    return METHODS[signal->kind].value(signal, t);
}

double signal_next_break(const Signal *signal, double t) {
    return METHODS[signal->kind].next_break(signal, t);
}
