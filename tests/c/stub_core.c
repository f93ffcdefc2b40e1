/* stub_core.c: core.h implemented by hand for the tests of the runtime; no generator involved.
 *
 * One model of independent parts, each with an analytic solution:
 *   ball     h' = v, v' = -g; when h <= 0: v := -e v
 *   stiff    a' = -500.5 a + 499.5 b, b' = 499.5 a - 500.5 b: rates 1 and 1000
 *   integral s' = u; y = s + gain u; above = u > 0.5
 *   sampled  count := count + increment every 0.1 s; held := u; end when count reaches last (> 0)
 *   sliding  w' = -1 where w > 0, else 1 (when slide): chatters at w = 0
 *   fault    r' = 0, not a number after the time `fault`
 * -DSTUB_STIFF: integrated with the implicit method. -DSTUB_STATELESS: no states and no ball.
 */
#include "core.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TIME, H, V, DER_H, DER_V, A, B, DER_A, DER_B, S, DER_S, U, Y, GAIN, G, E, COUNT, INCREMENT, ABOVE, ENABLE,
    MODE, PERIOD, LAST, W, DER_W, SLIDE, R, DER_R, FAULT, HELD, SPAN, WAVE, N
};

#define REAL(c, v, i, r) {TYPE_REAL, CAUSALITY_##c, VARIABILITY_##v, INITIAL_##i, ROLE_##r}
#define WHOLE(t, c, v, i, r) {TYPE_##t, CAUSALITY_##c, VARIABILITY_##v, INITIAL_##i, ROLE_##r}

static const VariableInfo variables[N] = {
    [TIME] = REAL(INDEPENDENT, CONTINUOUS, NONE, OTHER),
    [H] = REAL(OUTPUT, CONTINUOUS, EXACT, STATE),
    [V] = REAL(LOCAL, CONTINUOUS, EXACT, STATE),
    [DER_H] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [DER_V] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [A] = REAL(OUTPUT, CONTINUOUS, EXACT, STATE),
    [B] = REAL(LOCAL, CONTINUOUS, APPROX, STATE),
    [DER_A] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [DER_B] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [S] = REAL(OUTPUT, CONTINUOUS, EXACT, STATE),
    [DER_S] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [U] = REAL(INPUT, CONTINUOUS, NONE, OTHER),
    [Y] = REAL(OUTPUT, CONTINUOUS, CALCULATED, OTHER),
    [GAIN] = REAL(PARAMETER, TUNABLE, EXACT, OTHER),
    [G] = REAL(PARAMETER, FIXED, EXACT, OTHER),
    [E] = REAL(PARAMETER, FIXED, EXACT, OTHER),
    [COUNT] = WHOLE(INTEGER, OUTPUT, DISCRETE, EXACT, DISCRETE_STATE),
    [INCREMENT] = WHOLE(INTEGER, PARAMETER, TUNABLE, EXACT, OTHER),
    [ABOVE] = WHOLE(BOOLEAN, OUTPUT, DISCRETE, CALCULATED, OTHER),
    [ENABLE] = WHOLE(BOOLEAN, INPUT, DISCRETE, NONE, OTHER),
    [MODE] = WHOLE(ENUMERATION, PARAMETER, TUNABLE, EXACT, OTHER),
    [PERIOD] = REAL(LOCAL, CONSTANT, EXACT, OTHER),
    [LAST] = WHOLE(INTEGER, PARAMETER, FIXED, EXACT, OTHER),
    [W] = REAL(LOCAL, CONTINUOUS, EXACT, STATE),
    [DER_W] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [SLIDE] = WHOLE(BOOLEAN, PARAMETER, FIXED, EXACT, OTHER),
    [R] = REAL(LOCAL, CONTINUOUS, EXACT, STATE),
    [DER_R] = REAL(LOCAL, CONTINUOUS, CALCULATED, DERIVATIVE),
    [FAULT] = REAL(PARAMETER, FIXED, EXACT, OTHER),
    [HELD] = REAL(OUTPUT, DISCRETE, EXACT, DISCRETE_STATE),
    [SPAN] = WHOLE(INTEGER, OUTPUT, DISCRETE, EXACT, DISCRETE_STATE),
    [WAVE] = REAL(OUTPUT, CONTINUOUS, CALCULATED, OTHER),
};

static const char *const names[N] = {
    "time", "h", "v", "der(h)", "der(v)", "a", "b", "der(a)", "der(b)", "s", "der(s)", "u", "y", "gain", "g", "e",
    "count", "increment", "above", "enable", "mode", "period", "last", "w", "der(w)", "slide", "r", "der(r)",
    "fault", "held", "span", "wave"};

static const double start_values[N] = {
    [H] = 1.0,    [A] = 2.0,     [GAIN] = 2.0,   [G] = 9.81,  [E] = 0.7,
    [INCREMENT] = 1.0, [MODE] = 1.0, [PERIOD] = 0.1, [W] = 0.5, [FAULT] = 1e300};

static const double minimum[N] = {
    -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL,
    -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, 0.0, -HUGE_VAL, -100.0, -HUGE_VAL, -HUGE_VAL, 1.0,
    -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL, -HUGE_VAL,
    -HUGE_VAL};
static const double maximum[N] = {
    HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL,
    HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, 1.0, HUGE_VAL, 100.0, HUGE_VAL, HUGE_VAL, 3.0, HUGE_VAL, HUGE_VAL,
    HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL};

static const unsigned states[] = {H, V, A, B, S, W, R};
static const unsigned derivatives[] = {DER_H, DER_V, DER_A, DER_B, DER_S, DER_W, DER_R};
static const double nominals[] = {1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0};

#ifdef STUB_STATELESS
enum { N_STATES = 0, FIRST_INDICATOR = 1, N_INDICATORS = 1 };
#else
enum { N_STATES = 7, FIRST_INDICATOR = 0, N_INDICATORS = 3 };
#endif

const ModelInfo model_info = {
    .name = "Stub",
    .token = "{stub-of-the-runtime-tests}",
    .n_variables = N,
    .n_states = N_STATES,
    .n_indicators = N_INDICATORS,
    .n_relations = 3,
    .n_memory = 1,
    .variables = variables,
    .names = names,
    .states = states,
    .derivatives = derivatives,
    .state_nominals = nominals,
    .minimum = minimum,
    .maximum = maximum,
    .has_time_events = true,
#ifdef STUB_STIFF
    .stiff = true,
#else
    .stiff = false,
#endif
    .default_tolerance = 1e-6,
};

/* Relations in the order of the indicators: h <= 0, u > 0.5, w > 0. */
enum { FALLEN, U_ABOVE, W_ABOVE, N_RELATIONS };

typedef struct {
    double v[N];
    double relation[N_RELATIONS];
    double fallen_before;
    double resting; /* with STUB_REST, the speed [m/s] below which the ball is left on the floor */
    double ticks; /* of the clock so far */
    double mode;
    double due;
    double first;
} Image;

struct Core {
    Image image;
    CoreLog log;
    void *environment;
};

void core_log(Core *core, bool is_error, const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    core->log(core->environment, is_error, text);
}

Core *core_new(CoreLog log, void *environment)
{
    Core *core = calloc(1, sizeof *core);
    if (core != NULL) {
        core->log = log;
        core->environment = environment;
        core_reset(core);
    }
    return core;
}

void core_free(Core *core)
{
    free(core);
}

void core_reset(Core *core)
{
    memset(&core->image, 0, sizeof core->image);
    memcpy(core->image.v, start_values, sizeof start_values);
    core->image.mode = CORE_INSTANTIATED;
    core->image.due = 1.0;
}

static void indicators(const Image *m, double *z)
{
    z[FALLEN] = m->v[H];
    z[U_ABOVE] = m->v[U] - 0.5;
    z[W_ABOVE] = m->v[W];
}

static void relations(Image *m)
{
    double z[N_RELATIONS];
    indicators(m, z);
    m->relation[FALLEN] = z[FALLEN] <= 0.0 ? 1.0 : 0.0;
    m->relation[U_ABOVE] = z[U_ABOVE] > 0.0 ? 1.0 : 0.0;
    m->relation[W_ABOVE] = z[W_ABOVE] > 0.0 ? 1.0 : 0.0;
}

static void update(Image *m)
{
    double *v = m->v;
    if (m->due == 0.0) {
        return;
    }
    m->due = 0.0;
    if ((int)m->mode != (int)CORE_CONTINUOUS) {
        relations(m);
    }
    v[DER_H] = m->resting != 0.0 ? 0.0 : v[V];
    v[DER_V] = m->resting != 0.0 ? 0.0 : -v[G];
    v[DER_A] = -500.5 * v[A] + 499.5 * v[B];
    v[DER_B] = 499.5 * v[A] - 500.5 * v[B];
    v[DER_S] = v[U];
    v[Y] = v[S] + v[GAIN] * v[U];
    v[ABOVE] = m->relation[U_ABOVE];
    v[DER_W] = v[SLIDE] == 0.0 ? 0.0 : (m->relation[W_ABOVE] != 0.0 ? -1.0 : 1.0);
    v[DER_R] = v[TIME] > v[FAULT] ? NAN : 0.0;
    v[WAVE] = sin(v[TIME]);
}

static bool report_nan(Core *core, unsigned vr)
{
    if (isfinite(core->image.v[vr])) {
        return true;
    }
    core_log(core, true, "%s is not a number at time %g", names[vr], core->image.v[TIME]);
    return false;
}

bool core_get(Core *core, unsigned vr, double *value)
{
    update(&core->image);
    *value = core->image.v[vr];
    return report_nan(core, vr);
}

void core_set(Core *core, unsigned vr, double value)
{
    core->image.v[vr] = value;
    core->image.due = 1.0;
}

double core_time(const Core *core)
{
    return core->image.v[TIME];
}

CoreMode core_mode(const Core *core)
{
    return (CoreMode)(int)core->image.mode;
}

bool core_enter_initialisation(Core *core, double start_time)
{
    core_set_time(core, start_time);
    core->image.mode = CORE_INITIALISING;
    return true;
}

bool core_exit_initialisation(Core *core)
{
    Image *m = &core->image;
    m->due = 1.0;
    update(m);
    m->fallen_before = m->relation[FALLEN];
    m->ticks = ceil(m->v[TIME] / 0.1 - 1e-9);
    core_enter_event(core);
    return true;
}

void core_enter_event(Core *core)
{
    core->image.mode = CORE_EVENT;
    core->image.due = 1.0;
    core->image.first = 1.0;
}

static double next_tick(const Image *m)
{
    return m->ticks / 10.0;
}

static bool tick(Image *m)
{
    if (m->first == 0.0 || m->v[TIME] < next_tick(m)) {
        return false;
    }
    m->ticks += 1.0;
    m->v[COUNT] += m->v[INCREMENT];
    m->v[HELD] = m->v[U];
    return true;
}

bool core_new_discrete_states(Core *core, CoreEventInfo *info)
{
    Image *m = &core->image;
    m->due = 1.0;
    update(m);
    bool ticked = tick(m);
    bool bounced = N_STATES > 0 && m->relation[FALLEN] != 0.0 && m->fallen_before == 0.0;
    m->fallen_before = m->relation[FALLEN];
    m->first = 0.0;
    if (bounced) {
        m->v[V] = -m->v[E] * m->v[V];
        m->v[SPAN] += 1.0;
#ifdef STUB_REST
        if (m->v[V] < STUB_REST) {
            m->v[H] = m->v[V] = 0.0;
            m->resting = 1.0;
        }
#endif
        m->due = 1.0;
    }
    *info = (CoreEventInfo){
        .discrete_states_need_update = ticked || bounced || m->v[MODE] == 3.0,
        .terminate = m->v[LAST] > 0.0 && m->v[COUNT] >= m->v[LAST],
        .continuous_states_changed = bounced,
        .next_event_time_defined = true,
        .next_event_time = next_tick(m),
    };
    return true;
}

bool core_enter_continuous(Core *core)
{
    update(&core->image);
    core->image.mode = CORE_CONTINUOUS;
    return true;
}

bool core_completed_step(Core *core)
{
    (void)core;
    return true;
}

bool core_accepted(Core *core)
{
    (void)core;
    return true;
}

bool core_wants_event(const Core *core)
{
    (void)core;
    return false;
}

void core_set_time(Core *core, double time)
{
    core->image.v[TIME] = time;
    core->image.due = 1.0;
}

void core_set_states(Core *core, const double *x)
{
    for (size_t i = 0; i < N_STATES; i++) {
        core->image.v[states[i]] = x[i];
    }
    core->image.due = 1.0;
}

void core_get_states(const Core *core, double *x)
{
    for (size_t i = 0; i < N_STATES; i++) {
        x[i] = core->image.v[states[i]];
    }
}

bool core_get_derivatives(Core *core, double *dx)
{
    bool good = true;
    update(&core->image);
    for (size_t i = 0; i < N_STATES; i++) {
        dx[i] = core->image.v[derivatives[i]];
        good = report_nan(core, derivatives[i]) && good;
    }
    return good;
}

bool core_get_indicators(Core *core, double *z)
{
    double all[N_RELATIONS];
    update(&core->image);
    indicators(&core->image, all);
    for (size_t i = 0; i < N_INDICATORS; i++) {
        z[i] = all[i + FIRST_INDICATOR];
    }
    return true;
}

bool core_directional(Core *core, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                      size_t n_knowns, const double *seed, double *sensitivity)
{
    const double *v = core->image.v;
    double d[N] = {0.0};
    for (size_t i = 0; i < n_knowns; i++) {
        d[knowns[i]] = seed[i];
    }
    d[DER_H] = d[V];
    d[DER_A] = -500.5 * d[A] + 499.5 * d[B];
    d[DER_B] = 499.5 * d[A] - 500.5 * d[B];
    d[DER_S] = d[U];
    d[Y] = d[S] + v[GAIN] * d[U] + d[GAIN] * v[U];
    for (size_t i = 0; i < n_unknowns; i++) {
        sensitivity[i] = d[unknowns[i]];
    }
    return true;
}

size_t core_saved_size(const Core *core)
{
    (void)core;
    return sizeof(Image);
}

void core_save(const Core *core, void *image)
{
    memcpy(image, &core->image, sizeof core->image);
}

bool core_holds(const void *image, size_t size)
{
    (void)image;
    return size == sizeof(Image);
}

bool core_load(Core *core, const void *image)
{
    memcpy(&core->image, image, sizeof core->image);
    return true;
}
