#include "fourier.h"

#include <math.h>
#include <string.h>

enum { DIFFERENCES = 4, KEPT = 8 };

static const double TWO_PI = 6.283185307179586476925286766559;

static size_t width(const Fourier *fourier) {
    return 1 + 2 * fourier->orders;
}

void fourier_clear(Fourier *fourier) {
    fourier->rows = fourier->next = 0;
    fourier->at = fourier->basis;
    fourier->start = fourier->reached = fourier->time = fourier->gap = fourier->longest = 0.0;
    memset(fourier->weights, 0, width(fourier) * sizeof(double));
    memset(fourier->sums, 0, fourier->n * width(fourier) * sizeof(double));
    memset(fourier->largest, 0, fourier->n * sizeof(double));
    memset(fourier->jumped, 0, fourier->n * sizeof(double));
    memset(fourier->nodes, 0, fourier->n * KEPT * sizeof(double));
    memset(fourier->rough, 0, fourier->n * sizeof(double));
    fourier->n_nodes = 0;
}

/* 1, sin, cos, sin 2, cos 2, … by the addition theorems; each order from two of about half of it. */
static void fill_basis(const Fourier *fourier, double t, double *basis) {
    const double angle = TWO_PI * fourier->frequency * (t - fourier->begin);
    basis[0] = 1.0;
    basis[1] = sin(angle);
    basis[2] = cos(angle);
    for (size_t k = 2; k <= fourier->orders; k++) {
        const double *low = basis + 2 * (k / 2) - 1;
        const double *high = basis + 2 * (k - k / 2) - 1;
        const double s = low[0] * high[1] + low[1] * high[0];
        const double c = low[1] * high[1] - low[0] * high[0];
        basis[2 * k - 1] = s;
        basis[2 * k] = c;
    }
}

/* Whether the caller knows of the time; most rows are there. */
static bool find_time(Fourier *fourier, double t) {
    while (fourier->next < fourier->n_known && fourier->known_times[fourier->next] < t) {
        fourier->next++;
    }
    return fourier->next < fourier->n_known && fourier->known_times[fourier->next] == t;
}

static void find_basis(Fourier *fourier, double t, bool known) {
    if (known && fourier->known) {
        fourier->at = fourier->known + fourier->next * width(fourier);
    } else {
        fill_basis(fourier, t, fourier->basis);
        fourier->at = fourier->basis;
    }
}

static void begin(Fourier *fourier, const double *row) {
    fourier->start = fourier->reached = row[0];
    for (size_t i = 0; i < fourier->n; i++) {
        fourier->first[i] = row[fourier->columns[i]];
    }
    find_basis(fourier, row[0], find_time(fourier, row[0]));
}

static inline void add_scaled(double *restrict sums, double factor, const double *restrict basis, size_t m) {
    for (size_t k = 0; k < m; k++) {
        sums[k] += factor * basis[k];
    }
}

/* The last node's weight is known once the node behind it is: half the gaps on both sides. */
static void integrate(Fourier *fourier, double gap) {
    const size_t m = width(fourier);
    const double weight = 0.5 * (fourier->gap + gap);
    add_scaled(fourier->weights, weight, fourier->at, m);
    for (size_t i = 0; i < fourier->n; i++) {
        add_scaled(fourier->sums + i * m, weight * fourier->node[i], fourier->at, m);
    }
}

/* The grid's step [s]. */
static double step_of(const Fourier *fourier) {
    return (fourier->known_times[fourier->n_known - 1] - fourier->start) / (double)fourier->n_known;
}

/* What a jump adds to the trapezoidal sums: `value` times the basis where it is, and `slope` times its derivative. */
static void add_jump(const Fourier *fourier, double *sums, double value, double slope, const double *basis) {
    sums[0] += value;
    for (size_t k = 1; k <= fourier->orders; k++) {
        const double turned = slope * TWO_PI * fourier->frequency * (double)k;
        sums[2 * k - 1] += value * basis[2 * k - 1] + turned * basis[2 * k];
        sums[2 * k] += value * basis[2 * k] - turned * basis[2 * k - 1];
    }
}

/* Two rows with one time. At a node the sums have half of either value; only the second term is left. */
static void integrate_jumps(Fourier *fourier, const double *row) {
    const double t = row[0], h = step_of(fourier);
    const bool between = t != fourier->reached;
    const double ahead = between ? fourier->reached + 0.5 * h - t : 0.0;
    const double slope = between ? 0.5 * (ahead * ahead - h * h / 12.0) : h * h / 12.0;
    bool filled = !between;
    for (size_t i = 0; i < fourier->n; i++) {
        const double jump = row[fourier->columns[i]] - fourier->first[i] - fourier->last[i];
        if (jump == 0.0) {
            continue;
        }
        fourier->jumped[i] += jump;
        if (!filled) {
            fill_basis(fourier, t, fourier->between);
            filled = true;
        }
        add_jump(fourier, fourier->sums + i * width(fourier), jump * ahead, jump * slope,
                 between ? fourier->between : fourier->at);
    }
}

/* The fourth difference of y and the four values before it: next to nothing of what is smooth over five nodes. */
static double fourth_difference(const double *before, double y) {
    return fabs(before[0] - 4.0 * before[1] + 6.0 * before[2] - 4.0 * before[3] + y);
}

static void push(double *before, double y) {
    memmove(before, before + 1, (DIFFERENCES - 1) * sizeof(double));
    before[DIFFERENCES - 1] = y;
}

/* The first node has the value 0. */
static void add_differences(Fourier *fourier) {
    for (size_t i = 0; i < fourier->n; i++) {
        const double y = fourier->last[i] - fourier->jumped[i];
        double *nodes = fourier->nodes + i * KEPT, *latest = nodes + DIFFERENCES;
        if (fourier->n_nodes >= DIFFERENCES - 1) {
            fourier->rough[i] += fourth_difference(latest, y);
        }
        if (fourier->n_nodes < DIFFERENCES) {
            nodes[fourier->n_nodes] = y;
        }
        push(latest, y);
    }
    fourier->n_nodes++;
}

static void add_node(Fourier *fourier, const double *row, bool known) {
    const double gap = row[0] - fourier->reached;
    integrate(fourier, gap);
    fourier->gap = gap;
    fourier->reached = row[0];
    if (gap > 0.0) {
        find_basis(fourier, row[0], known);
    }
}

void fourier_add(Fourier *fourier, const double *row) {
    bool node = true;
    if (fourier->rows == 0) {
        begin(fourier, row);
    } else {
        const bool known = find_time(fourier, row[0]);
        node = !fourier->grid || known || row[0] == fourier->reached;
        fourier->longest = fmax(fourier->longest, row[0] - fourier->time);
        if (fourier->grid && row[0] == fourier->time) {
            integrate_jumps(fourier, row);
        }
        if (node) {
            add_node(fourier, row, known);
        }
    }
    for (size_t i = 0; i < fourier->n; i++) {
        const double y = row[fourier->columns[i]];
        fourier->last[i] = y - fourier->first[i];
        fourier->largest[i] = fmax(fourier->largest[i], fabs(y));
    }
    if (node) {
        memcpy(fourier->node, fourier->last, fourier->n * sizeof(double));
    }
    if (node && fourier->rows > 0 && row[0] > fourier->time) {
        add_differences(fourier);
    }
    fourier->time = row[0];
    fourier->rows++;
}

void fourier_result(const Fourier *fourier, double *coefficients) {
    const size_t m = width(fourier);
    const double span = fourier->reached - fourier->start;
    const double weight = 0.5 * fourier->gap;
    const double h = fourier->grid ? step_of(fourier) : 0.0;
    for (size_t i = 0; i < fourier->n; i++) {
        const double *sums = fourier->sums + i * m;
        const double y = weight * fourier->node[i];
        const double back = -fourier->node[i] * h * h / 12.0; /* from the last row to the first of the next period */
        const double mean = (sums[0] + y) / span;
        coefficients[i * m] = fourier->first[i] + mean;
        for (size_t k = 1; k < m; k++) {
            const double all = fourier->weights[k] + weight * fourier->at[k];
            coefficients[i * m + k] = sums[k] + y * fourier->at[k] - mean * all;
        }
        add_jump(fourier, coefficients + i * m, 0.0, back, fourier->at);
        for (size_t k = 1; k < m; k++) {
            coefficients[i * m + k] *= 2.0 / span;
        }
    }
}

/* A jump J somewhere between two nodes costs the trapezoidal rule up to half a step of it, and puts 8 J into the sum of
 * the fourth differences; the coefficients are twice the integrals over the span. The nodes go on as they began. */
void fourier_rough(const Fourier *fourier, double *errors) {
    for (size_t i = 0; i < fourier->n; i++) {
        const double *nodes = fourier->nodes + i * KEPT;
        double latest[DIFFERENCES], sum = fourier->rough[i];
        memcpy(latest, nodes + DIFFERENCES, sizeof latest);
        const double end = latest[DIFFERENCES - 1];
        for (size_t k = 0; k < DIFFERENCES; k++) {
            sum += fourth_difference(latest, end + nodes[k]);
            push(latest, end + nodes[k]);
        }
        errors[i] = fourier->grid && fourier->n_nodes > DIFFERENCES ? sum / (8.0 * (double)fourier->n_nodes) : 0.0;
    }
}
