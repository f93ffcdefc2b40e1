/* block_kinds.c: what each kind of block computes. u and x are its inputs and states, p its parameters. */
#include "block_kind.h"

#include <math.h>

static double sign(double value) {
    return value < 0.0 ? -1.0 : 1.0;
}

/* How far v is beyond an upper limit; a limit that is infinite has no event. */
static double above(double v, double limit) {
    return isfinite(limit) ? v - limit : -1.0;
}

static double below(double v, double limit) {
    return isfinite(limit) ? limit - v : -1.0;
}

/* -1 below lower, 1 above upper, else 0. */
static double side(double v, double lower, double upper) {
    return v > upper ? 1.0 : v < lower ? -1.0 : 0.0;
}

static void outside(double v, const double *limits, double *z) {
    z[0] = above(v, limits[1]);
    z[1] = below(v, limits[0]);
}

/* ---- saturation: p = lower, upper ---- */

static void band_choose(const Element *e, double *mode) {
    mode[0] = side(e->memory[0], e->p[0], e->p[1]);
}

static void band_indicators(const Element *e, double *z) {
    outside(e->memory[0], e->p, z);
}

static double limited(double v, const double *limits, double mode) {
    return mode > 0.0 ? limits[1] : mode < 0.0 ? limits[0] : v;
}

static double saturation_output(const Element *e, const double *mode) {
    return limited(e->memory[0], e->p, mode[0]);
}

static double saturation_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)e;
    (void)row;
    (void)column;
    return mode[0] == 0.0;
}

/* ---- dead band: p = lower, upper, slope ---- */

static double dead_band_output(const Element *e, const double *mode) {
    return mode[0] == 0.0 ? 0.0 : e->p[2] * (e->memory[0] - e->p[mode[0] > 0.0]);
}

static double dead_band_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)row;
    (void)column;
    return mode[0] == 0.0 ? 0.0 : e->p[2];
}

/* ---- relay: p = lower, upper, off_below, on_above; mode: whether it is on ---- */

static void relay_choose(const Element *e, double *mode) {
    const double to = side(e->memory[0], e->p[2], e->p[3]);
    mode[0] = to == 0.0 ? mode[0] : to > 0.0;
}

static void relay_indicators(const Element *e, double *z) {
    outside(e->memory[0], e->p + 2, z);
    z[e->mode[0] > 0.0 ? 0 : 1] = -1.0; /* it is there already */
}

static double relay_output(const Element *e, const double *mode) {
    return e->p[mode[0] > 0.0];
}

static double flat(const Element *e, const double *mode, size_t row, size_t column) {
    (void)e;
    (void)mode;
    (void)row;
    (void)column;
    return 0.0;
}

/* ---- quantiser: p = step; mode: number of the level ---- */

static void quantiser_indicators(const Element *e, double *z) {
    z[0] = e->memory[0] - (e->mode[0] + 0.5) * e->p[0];
    z[1] = (e->mode[0] - 0.5) * e->p[0] - e->memory[0];
}

static void quantiser_choose(const Element *e, double *mode) {
    const double u = e->memory[0], step = e->p[0];
    if (u <= (mode[0] + 0.5) * step && u >= (mode[0] - 0.5) * step) {
        return; /* on an edge, the level stays */
    }
    double n = floor(u / step + 0.5);
    n += u > (n + 0.5) * step;
    mode[0] = n - (u < (n - 0.5) * step);
}

static double quantiser_output(const Element *e, const double *mode) {
    return mode[0] * e->p[0];
}

/* ---- friction: u = speed, applied force; p = coulomb, static, viscous, stuck_speed; mode: 0 stuck, ±1 sliding ---- */

static void friction_choose(const Element *e, double *mode) {
    const double speed = e->memory[0], force = e->memory[1], stuck = e->p[3];
    if (mode[0] != 0.0 && mode[0] * speed > 0.0) {
        return;
    }
    const bool slides = fabs(speed) > stuck;
    mode[0] = slides ? sign(speed) : fabs(force) > e->p[1] ? sign(force) : 0.0;
}

static void friction_indicators(const Element *e, double *z) {
    const double speed = e->memory[0];
    const bool sticks = e->mode[0] == 0.0;
    z[0] = sticks ? fabs(e->memory[1]) - e->p[1] : -e->mode[0] * speed;
    z[1] = sticks ? fabs(speed) - e->p[3] : -1.0;
}

static double friction_output(const Element *e, const double *mode) {
    return mode[0] == 0.0 ? e->memory[1] : mode[0] * e->p[0] + e->p[2] * e->memory[0];
}

static double friction_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)row;
    return mode[0] == 0.0 ? column == 1 : column == 0 ? e->p[2] : 0.0;
}

/* ---- tables: p = extrapolation (0 hold, 1 linear, 2 none); mode: segment, -1 and n - 1 beyond the ends ---- */

static double segment_of(const double *x, size_t n, double u) {
    size_t low = 0, high = n; /* x[low - 1] < u <= x[high] */
    if (u == x[0]) {
        return 0.0;
    }
    while (low < high) {
        const size_t middle = (low + high) / 2;
        if (x[middle] < u) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return (double)low - 1.0;
}

static double keep_segment(const double *x, size_t n, double u, double mode) {
    const bool from = mode < 0.0 || u >= x[(size_t)mode];
    const bool to = mode < 0.0 ? u < x[0] : mode >= (double)n - 1.0 || u <= x[(size_t)mode + 1];
    return from && to ? mode : segment_of(x, n, u);
}

static void segment_indicators(const double *x, size_t n, double u, double mode, double *z) {
    z[0] = mode < (double)n - 1.0 ? u - x[(size_t)(mode + 1.0)] : -1.0;
    z[1] = mode >= 0.0 ? x[(size_t)mode] - u : -1.0;
}

/* A place in a grid: x = x[i] + part · (x[i + 1] - x[i]); by: ∂part/∂u. */
typedef struct {
    size_t i;
    double part, by;
} Place;

static Place place(const Element *e, size_t axis, const double *mode) {
    const double *x = e->grids[axis], u = e->memory[axis];
    const double last = (double)e->sizes[axis] - 1.0;
    const bool beyond = mode[axis] < 0.0 || mode[axis] >= last;
    Place p = {(size_t)fmin(fmax(mode[axis], 0.0), last - 1.0), 0.0, 0.0};
    const double width = x[p.i + 1] - x[p.i];
    if (beyond && e->p[0] == 0.0) {
        p.part = mode[axis] < 0.0 ? 0.0 : 1.0;
    } else {
        p.part = (u - x[p.i]) / width;
        p.by = 1.0 / width;
    }
    return p;
}

static bool inside(const Element *e, size_t axis) {
    const double u = e->memory[axis];
    const double *x = e->grids[axis];
    return u >= x[0] && u <= x[e->sizes[axis] - 1];
}

static void lookup_choose(const Element *e, double *mode) {
    for (size_t axis = 0; axis < e->nu; axis++) {
        mode[axis] = keep_segment(e->grids[axis], e->sizes[axis], e->memory[axis], mode[axis]);
    }
}

static void lookup_indicators(const Element *e, double *z) {
    for (size_t axis = 0; axis < e->nu; axis++) {
        segment_indicators(e->grids[axis], e->sizes[axis], e->memory[axis], e->mode[axis], z + 2 * axis);
    }
}

static bool lookup_defined(const Element *e) {
    bool all = true;
    for (size_t axis = 0; axis < e->nu; axis++) {
        all = all && inside(e, axis);
    }
    return all || e->p[0] != 2.0;
}

static double lookup_output(const Element *e, const double *mode) {
    const Place x = place(e, 0, mode);
    const double *y = e->grids[1] + x.i;
    return y[0] + x.part * (y[1] - y[0]);
}

static double lookup_slope(const Element *e, const double *mode, size_t row, size_t column) {
    const Place x = place(e, 0, mode);
    const double *y = e->grids[1] + x.i;
    (void)row;
    (void)column;
    return x.by * (y[1] - y[0]);
}

static double lookup_2d_output(const Element *e, const double *mode) {
    const Place a = place(e, 0, mode), b = place(e, 1, mode);
    const double *z = e->grids[2] + a.i * e->sizes[1] + b.i, *next = z + e->sizes[1];
    const double here = z[0] + b.part * (z[1] - z[0]);
    return here + a.part * (next[0] + b.part * (next[1] - next[0]) - here);
}

static double lookup_2d_slope(const Element *e, const double *mode, size_t row, size_t column) {
    const Place a = place(e, 0, mode), b = place(e, 1, mode);
    const double *z = e->grids[2] + a.i * e->sizes[1] + b.i, *next = z + e->sizes[1];
    (void)row;
    if (column == 1) {
        return b.by * (z[1] - z[0] + a.part * (next[1] - next[0] - (z[1] - z[0])));
    }
    return a.by * (next[0] + b.part * (next[1] - next[0]) - (z[0] + b.part * (z[1] - z[0])));
}

/* ---- product of all inputs ---- */

static double product_but(const Element *e, size_t left_out) {
    double product = 1.0;
    for (size_t i = 0; i < e->nu; i++) {
        product *= i == left_out ? 1.0 : e->memory[i];
    }
    return product;
}

static double product_output(const Element *e, const double *mode) {
    (void)mode;
    return product_but(e, e->nu);
}

static double product_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)mode;
    (void)row;
    return product_but(e, column);
}

/* ---- largest or smallest input: p = 1 or -1; mode: number of the input ---- */

static void extreme_choose(const Element *e, double *mode) {
    size_t best = (size_t)mode[0];
    for (size_t i = 0; i < e->nu; i++) {
        best = e->p[0] * (e->memory[i] - e->memory[best]) > 0.0 ? i : best;
    }
    mode[0] = (double)best;
}

static void extreme_indicators(const Element *e, double *z) {
    const size_t best = (size_t)e->mode[0];
    for (size_t i = 0; i < e->nu; i++) {
        z[i] = i == best ? -1.0 : e->p[0] * (e->memory[i] - e->memory[best]);
    }
}

static double extreme_output(const Element *e, const double *mode) {
    return e->memory[(size_t)mode[0]];
}

static double extreme_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)e;
    (void)row;
    return column == (size_t)mode[0];
}

/* ---- switch: y = u1 where u2 > threshold, else u3; p = threshold ---- */

static void switch_choose(const Element *e, double *mode) {
    mode[0] = e->memory[1] > e->p[0];
}

static void switch_indicators(const Element *e, double *z) {
    z[0] = e->memory[1] - e->p[0];
}

static double switch_output(const Element *e, const double *mode) {
    return e->memory[mode[0] > 0.0 ? 0 : 2];
}

static double switch_slope(const Element *e, const double *mode, size_t row, size_t column) {
    (void)e;
    (void)row;
    return column == (mode[0] > 0.0 ? 0U : 2U);
}

/* ---- integrator: p = lower, upper, gain; mode: the limit at which it stands ---- */

static void integrator_choose(const Element *e, double *mode) {
    const double x = element_states(e)[0], rate = e->p[2] * e->memory[0];
    const double at = x >= e->p[1] ? 1.0 : x <= e->p[0] ? -1.0 : 0.0;
    mode[0] = at * rate > 0.0 ? at : 0.0;
}

static bool integrator_jump(Element *e) {
    double *x = element_states(e);
    const double to = fmin(fmax(x[0], e->p[0]), e->p[1]);
    const bool jumps = to != x[0];
    x[0] = to;
    return jumps;
}

static void integrator_indicators(const Element *e, double *z) {
    outside(element_states(e)[0], e->p, z);
    z[2] = -1.0;
    if (e->mode[0] != 0.0) {
        z[0] = z[1] = -1.0;
        z[2] = -e->mode[0] * e->p[2] * e->memory[0];
    }
}

static double integrator_output(const Element *e, const double *mode) {
    (void)mode;
    return element_states(e)[0];
}

static void integrator_rates(const Element *e, const double *mode, double *dx) {
    dx[0] = mode[0] == 0.0 ? e->p[2] * e->memory[0] : 0.0;
}

static double integrator_slope(const Element *e, const double *mode, size_t row, size_t column) {
    if (row == 1) {
        return column == 1;
    }
    return mode[0] == 0.0 && column == 0 ? e->p[2] : 0.0;
}

/* ---- rate limiter: dx/dt = (u - x) / lag within limits, y = x; p = falling, rising, lag ---- */

static double pull(const Element *e) {
    return (e->memory[0] - element_states(e)[0]) / e->p[2];
}

static void rate_choose(const Element *e, double *mode) {
    mode[0] = side(pull(e), e->p[0], e->p[1]);
}

static void rate_indicators(const Element *e, double *z) {
    outside(pull(e), e->p, z);
}

static void rate_rates(const Element *e, const double *mode, double *dx) {
    dx[0] = limited(pull(e), e->p, mode[0]);
}

static double rate_slope(const Element *e, const double *mode, size_t row, size_t column) {
    if (row == 1) {
        return column == 1;
    }
    return mode[0] != 0.0 ? 0.0 : (column == 0 ? 1.0 : -1.0) / e->p[2];
}

/* ---- backlash: dx/dt = (what u - x is beyond the gap) / lag, y = slope · x; p = -half, half, lag, slope ---- */

static void backlash_choose(const Element *e, double *mode) {
    mode[0] = side(e->memory[0] - element_states(e)[0], e->p[0], e->p[1]);
}

static void backlash_indicators(const Element *e, double *z) {
    outside(e->memory[0] - element_states(e)[0], e->p, z);
}

static void backlash_rates(const Element *e, const double *mode, double *dx) {
    const double between = e->memory[0] - element_states(e)[0];
    dx[0] = mode[0] == 0.0 ? 0.0 : (between - e->p[mode[0] > 0.0]) / e->p[2];
}

static double backlash_output(const Element *e, const double *mode) {
    (void)mode;
    return e->p[3] * element_states(e)[0];
}

static double backlash_slope(const Element *e, const double *mode, size_t row, size_t column) {
    if (row == 1) {
        return column == 1 ? e->p[3] : 0.0;
    }
    return mode[0] == 0.0 ? 0.0 : (column == 0 ? 1.0 : -1.0) / e->p[2];
}

/* ---- PI and PID: p = lower, upper, proportional, integral, derivative, filter, tracking; x = integral, filtered u;
 *      mode: the limit that the output has reached ---- */

static double pid_free(const Element *e) {
    const double *p = e->p, *x = element_states(e), u = e->memory[0];
    return p[2] * u + x[0] + (e->nx > 1 ? p[4] * (u - x[1]) / p[5] : 0.0);
}

static void pid_choose(const Element *e, double *mode) {
    mode[0] = side(pid_free(e), e->p[0], e->p[1]);
}

static void pid_indicators(const Element *e, double *z) {
    outside(pid_free(e), e->p, z);
}

static double pid_output(const Element *e, const double *mode) {
    return limited(pid_free(e), e->p, mode[0]);
}

static void pid_rates(const Element *e, const double *mode, double *dx) {
    const double *p = e->p, free = pid_free(e), u = e->memory[0];
    dx[0] = p[3] * u + (mode[0] == 0.0 ? 0.0 : (limited(free, p, mode[0]) - free) / p[6]);
    if (e->nx > 1) {
        dx[1] = (u - element_states(e)[1]) / p[5];
    }
}

/* ∂free/∂(u, x)[column] */
static double pid_free_slope(const Element *e, size_t column) {
    const double kick = e->nx > 1 ? e->p[4] / e->p[5] : 0.0;
    return column == 0 ? e->p[2] + kick : column == 1 ? 1.0 : -kick;
}

static double pid_slope(const Element *e, const double *mode, size_t row, size_t column) {
    const double free = pid_free_slope(e, column);
    if (row == e->nx) {
        return mode[0] == 0.0 ? free : 0.0;
    }
    if (row == 1) {
        return (column == 0 ? 1.0 : column == 2 ? -1.0 : 0.0) / e->p[5];
    }
    return (column == 0 ? e->p[3] : 0.0) - (mode[0] == 0.0 ? 0.0 : free / e->p[6]);
}

const BlockKind *block_kind(int32_t number) {
    static const BlockKind kinds[N_BLOCKS] = {
        [BLOCK_SATURATION] = {.choose = band_choose, .output = saturation_output, .indicators = band_indicators, .slope = saturation_slope},
        [BLOCK_DEAD_BAND] = {.choose = band_choose, .output = dead_band_output, .indicators = band_indicators, .slope = dead_band_slope},
        [BLOCK_RELAY] = {.choose = relay_choose, .output = relay_output, .indicators = relay_indicators, .slope = flat},
        [BLOCK_QUANTISER] = {.choose = quantiser_choose, .output = quantiser_output, .indicators = quantiser_indicators, .slope = flat},
        [BLOCK_FRICTION] = {.choose = friction_choose, .output = friction_output, .indicators = friction_indicators, .slope = friction_slope},
        [BLOCK_LOOKUP] = {.choose = lookup_choose, .output = lookup_output, .indicators = lookup_indicators, .slope = lookup_slope, .defined = lookup_defined},
        [BLOCK_LOOKUP_2D] = {.choose = lookup_choose, .output = lookup_2d_output, .indicators = lookup_indicators, .slope = lookup_2d_slope, .defined = lookup_defined},
        [BLOCK_PRODUCT] = {.output = product_output, .slope = product_slope},
        [BLOCK_EXTREME] = {.choose = extreme_choose, .output = extreme_output, .indicators = extreme_indicators, .slope = extreme_slope},
        [BLOCK_SWITCH] = {.choose = switch_choose, .output = switch_output, .indicators = switch_indicators, .slope = switch_slope},
        [BLOCK_INTEGRATOR] = {.choose = integrator_choose, .output = integrator_output, .rates = integrator_rates, .indicators = integrator_indicators, .slope = integrator_slope, .jump = integrator_jump},
        [BLOCK_RATE_LIMITER] = {.choose = rate_choose, .output = integrator_output, .rates = rate_rates, .indicators = rate_indicators, .slope = rate_slope},
        [BLOCK_BACKLASH] = {.choose = backlash_choose, .output = backlash_output, .rates = backlash_rates, .indicators = backlash_indicators, .slope = backlash_slope},
        [BLOCK_PID] = {.choose = pid_choose, .output = pid_output, .rates = pid_rates, .indicators = pid_indicators, .slope = pid_slope},
    };
    return number == BLOCK_DELAY ? &block_delay : &kinds[number];
}
