/* lying.c: an FMU of FMI 2.0 that keeps all promises but one.
 *
 * dx/dt = v, dv/dt = u + w - K x - D v, y = x, f = v + u/2. Which promise is broken is told by the GUID it is
 * instantiated with, "{lying-leak}": one library serves all. What is wrong in the description alone is "honest" here.
 * Co-Simulation integrates by the classical Runge-Kutta method with short steps of its own, and takes input slopes.
 * "late-inputs" integrates on across communication points, as a solver does that is not restarted where inputs change:
 * it looks at its inputs only every 37 ms. "own-clock" begins to integrate at 0 whatever start time it is told. Runs of
 * "coarse" scatter by the tolerance that it is told. The stiffness of "pid" depends on the number of the process, the
 * force of "unset" on memory that nobody has set, that of "first" on whether this is the first instance of the process.
 * "half-restore" restores the position, not the velocity.
 * "repeats" takes a step that it is not promised to be final (noSetFMUStatePriorToCurrentPoint) for the last one again.
 * "peeked" overlooks over a step that an input moved before it, where it was asked for a value in between.
 */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmi2_stub.h"

#define STIFFNESS 40.0
#define DAMPING 0.8
#define HARD 1e4
#define LONGEST 1e-3 /* of the steps inside */
#define USED 4000    /* bytes: more than the C library keeps apart */
#define LATE 60      /* calls after which a forgotten variable shows */
#define LOOKS 37     /* steps inside after which a late FMU looks at its inputs */
#define SMALL_LEAK ((size_t)64 << 10)
#define LARGE_LEAK ((size_t)2 << 20)

enum { VR_X, VR_V, VR_DER_X, VR_DER_V, VR_U, VR_W, VR_Y, VR_F, N_VARIABLES };

typedef enum {
    HONEST, FORGETFUL, WRONG_RESTORE, FAILING_RESTORE, WRONG_DERIVATIVE, NO_DERIVATIVE, CLOCK, RANDOM, SHARED, SINGLE,
    STICKY_RESET, REFUSED_RESET, EULER, DIVERGING, UNSTABLE, DEAF, REFUSED_SLOPES, IGNORED_SLOPES, WRONG_SLOPES,
    ZERO_NOMINAL, TINY_NOMINAL, LEAK, LARGE, COUNTER, LATE_INPUTS, OWN_CLOCK, COARSE, PID, FIRST, UNSET, REPEATS,
    HALF_RESTORE, PEEKED,
    N_LIES
} Lie;

static const char *const names[N_LIES] = {
    "honest", "forgetful", "wrong-restore", "failing-restore", "wrong-derivative", "no-derivative", "clock", "random",
    "shared", "single", "sticky-reset", "refused-reset", "euler", "diverging", "unstable", "deaf", "refused-slopes",
    "ignored-slopes", "wrong-slopes", "zero-nominal", "tiny-nominal", "leak", "large-leak", "counter", "late-inputs",
    "own-clock", "coarse", "pid", "first", "unset", "repeats",
    "half-restore", "peeked",
};

typedef struct {
    double time, x, v, input[2], slope[2];
    double waiting[2]; /* inputs that a deaf or late FMU has heard but not yet taken */
    long steps;        /* that were made: what a forgetful state forgets */
    long inside;       /* steps inside, of a late FMU */
    double before[2];  /* inputs of the last step, of one that is peeked at */
    int unread;        /* its inputs moved since it was asked for a value */
} State;

typedef struct {
    Lie lie;
    State s, before; /* before: at the begin of the last step */
    double tolerance; /* of a coarse solver, as far as its runs scatter */
    double own;       /* force, or change of the stiffness, of those that are not the same everywhere */
} Model;

static int alive, begun;
static unsigned noise;
static void *volatile hoard;

static double force(const Model *m, const State *s)
{
    double extra = 0.0;
    switch (m->lie) {
    case CLOCK:
        extra = 0.3 * sin(2.0 * s->time);
        break;
    case RANDOM:
        noise = noise * 1103515245U + 12345U;
        extra = 1e-3 * ((double)(noise >> 16) / 65536.0 - 0.5);
        break;
    case COARSE:
        noise = noise * 1103515245U + 12345U;
        extra = m->tolerance * ((double)(noise >> 16) / 65536.0 - 0.5);
        break;
    case FIRST:
    case UNSET:
        extra = m->own;
        break;
    case SHARED:
        extra = alive > 1 ? 0.01 : 0.0;
        break;
    case FORGETFUL:
        extra = s->steps > LATE ? 0.01 * (double)(s->steps - LATE) : 0.0;
        break;
    default:
        break;
    }
    return s->input[0] + s->input[1] + extra;
}

static double stiffness(const Model *m)
{
    return m->lie == DIVERGING  ? HARD
           : m->lie == UNSTABLE ? -STIFFNESS
           : m->lie == PID      ? STIFFNESS * (1.0 + m->own)
                                : STIFFNESS;
}

static double rate(const Model *m, const State *s)
{
    return force(m, s) - stiffness(m) * s->x - DAMPING * s->v;
}

static void begin(Model *m)
{
    State s = {.x = m->lie == STICKY_RESET ? m->s.x : 0.0};
    m->s = s;
}

/* What memory that was used before holds: addresses, which differ from process to process. */
static double forgotten_to_set(void)
{
    unsigned char *block = malloc(USED), *after = malloc(USED);
    double sum = 0.0;
    free(block);
    volatile unsigned char *again = malloc(USED);
    for (size_t i = 0; again != NULL && i < 2 * sizeof(void *); i++) {
        sum += (double)again[i] * (double)(i + 1);
    }
    free((void *)again);
    free(after);
    return 1e-5 * sum;
}

static double own_part(Lie lie, int before)
{
    static double unset; /* as long as the process lives */
    if (lie == UNSET && before == 0) {
        unset = forgotten_to_set();
    }
    switch (lie) {
    case PID:
        return 1e-5 * (double)(getpid() % 10007 + 1);
    case FIRST:
        return before == 0 ? 0.01 : 0.0;
    case UNSET:
        return unset;
    default:
        return 0.0;
    }
}

/* ---- life ---- */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    Lie lie = (Lie)chosen(guid, "lying", names, N_LIES);
    (void)name;
    (void)location;
    (void)callbacks;
    (void)visible;
    (void)logging;
    if (lie == N_LIES || (lie == SINGLE && alive > 0)) {
        return NULL;
    }
    Model *m = calloc(1, sizeof *m);
    if (m != NULL) {
        bool solver_lies = lie == LATE_INPUTS || lie == OWN_CLOCK;
        m->tolerance = 1e-3;
        m->own = own_part(lie, begun++);
        m->lie = solver_lies && type == fmi2ModelExchange ? HONEST : lie;
        begin(m);
        alive++;
        size_t size = lie == LEAK ? SMALL_LEAK : lie == LARGE ? LARGE_LEAK : 0;
        if (size > 0) {
            hoard = malloc(size);
            memset(hoard, 1, size);
        }
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    alive -= c != NULL;
    free(c);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Model *m = c;
    if (m->lie == REFUSED_RESET) {
        return fmi2Error;
    }
    begin(m);
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean controlled, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)stop_defined;
    (void)stop;
    Model *m = c;
    m->tolerance = controlled ? tolerance : m->tolerance;
    m->s.time = m->lie == OWN_CLOCK ? 0.0 : start;
    return fmi2OK;
}


/* ---- values ---- */

static void take_inputs(Model *m)
{
    memcpy(m->s.input, m->s.waiting, sizeof m->s.input);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    take_inputs(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Model *m = c;
    const State *s = &m->s;
    m->s.unread = 0;
    for (size_t i = 0; i < n; i++) {
        switch (vr[i]) {
        case VR_X:
        case VR_Y:
            value[i] = m->lie == COUNTER ? s->x + 0.01 * (double)s->steps : s->x;
            break;
        case VR_V:
        case VR_DER_X:
            value[i] = s->v;
            break;
        case VR_DER_V:
            value[i] = rate(m, s);
            break;
        case VR_U:
        case VR_W:
            value[i] = s->waiting[vr[i] - VR_U];
            break;
        case VR_F:
            value[i] = s->v + 0.5 * s->input[0];
            break;
        default:
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        switch (vr[i]) {
        case VR_X:
            m->s.x = value[i];
            break;
        case VR_V:
            m->s.v = value[i];
            break;
        case VR_U:
        case VR_W:
            m->s.unread = m->s.unread || value[i] != m->s.waiting[vr[i] - VR_U];
            m->s.waiting[vr[i] - VR_U] = value[i];
            break;
        default:
            return fmi2Error;
        }
    }
    if (m->lie != DEAF && m->lie != LATE_INPUTS) {
        take_inputs(m);
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    Model *m = c;
    double factor = m->lie == IGNORED_SLOPES ? 0.0 : m->lie == WRONG_SLOPES ? -3.0 : 1.0;
    if (m->lie == REFUSED_SLOPES) {
        return fmi2Error;
    }
    for (size_t i = 0; i < n; i++) {
        if (order[i] != 1 || (vr[i] != VR_U && vr[i] != VR_W)) {
            return fmi2Error;
        }
        m->s.slope[vr[i] - VR_U] = factor * value[i];
    }
    return fmi2OK;
}

/* Derivative or output r with respect to known k. */
static double partial(const Model *m, fmi2ValueReference r, fmi2ValueReference k)
{
    switch (r) {
    case VR_DER_X:
        return k == VR_V;
    case VR_DER_V:
        return k == VR_X   ? -stiffness(m) * (m->lie == WRONG_DERIVATIVE ? 1.1 : 1.0)
               : k == VR_V ? -DAMPING
                           : (double)(k == VR_U || k == VR_W);
    case VR_Y:
        return k == VR_X;
    case VR_F:
        return k == VR_V ? 1.0 : k == VR_U ? 0.5 : 0.0;
    default:
        return 0.0;
    }
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                        const fmi2ValueReference known[], size_t k, const fmi2Real seed[],
                                        fmi2Real result[])
{
    const Model *m = c;
    if (m->lie == NO_DERIVATIVE) {
        return fmi2Error;
    }
    for (size_t i = 0; i < n; i++) {
        result[i] = 0.0;
        for (size_t j = 0; j < k; j++) {
            result[i] += partial(m, unknown[i], known[j]) * seed[j];
        }
    }
    return fmi2OK;
}

/* ---- saved states ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(State));
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, &((Model *)c)->s, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Model *m = c;
    long steps = m->s.steps;
    double v = m->s.v;
    if (m->lie == FAILING_RESTORE) {
        return fmi2Error;
    }
    memcpy(&m->s, state, sizeof m->s);
    if (m->lie == FORGETFUL) {
        m->s.steps = steps;
    }
    if (m->lie == HALF_RESTORE) {
        m->s.v = v;
    }
    m->s.x += m->lie == WRONG_RESTORE ? 1e-4 : 0.0;
    return fmi2OK;
}

/* ---- Model Exchange ---- */

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    take_inputs(c);
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set, fmi2Boolean *event, fmi2Boolean *terminate)
{
    (void)no_set;
    ((Model *)c)->s.steps++;
    *event = fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((Model *)c)->s.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    State *s = &((Model *)c)->s;
    (void)n;
    s->x = x[0];
    s->v = x[1];
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    const State *s = &((Model *)c)->s;
    (void)n;
    x[0] = s->x;
    x[1] = s->v;
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    const Model *m = c;
    (void)n;
    dx[0] = m->s.v;
    dx[1] = rate(m, &m->s);
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n)
{
    const Model *m = c;
    (void)n;
    nominal[0] = m->lie == ZERO_NOMINAL ? 0.0 : m->lie == TINY_NOMINAL ? 1e-9 : 0.01;
    nominal[1] = 0.1;
    return fmi2OK;
}

/* ---- Co-Simulation ---- */

static void after(State *s, const State *from, const double k[2], double h)
{
    *s = *from;
    s->time = from->time + h;
    s->x = from->x + h * k[0];
    s->v = from->v + h * k[1];
    s->input[0] = from->input[0] + h * from->slope[0];
    s->input[1] = from->input[1] + h * from->slope[1];
}

static void slopes(const Model *m, const State *s, double k[2])
{
    k[0] = s->v;
    k[1] = rate(m, s);
}

static void runge_kutta(Model *m, double h)
{
    double k[4][2], mean[2];
    State s;
    slopes(m, &m->s, k[0]);
    after(&s, &m->s, k[0], 0.5 * h);
    slopes(m, &s, k[1]);
    after(&s, &m->s, k[1], 0.5 * h);
    slopes(m, &s, k[2]);
    after(&s, &m->s, k[2], h);
    slopes(m, &s, k[3]);
    for (int i = 0; i < 2; i++) {
        mean[i] = (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]) / 6.0;
    }
    after(&s, &m->s, mean, h);
    m->s = s;
}

static void euler(Model *m, double h)
{
    double k[2];
    State s;
    slopes(m, &m->s, k);
    after(&s, &m->s, k, h);
    m->s = s;
}

static void go_on(Model *m, long count)
{
    memset(m->s.slope, 0, sizeof m->s.slope);
    for (long i = 0; i < count; i++) {
        if (m->s.inside++ % LOOKS == 0) {
            take_inputs(m);
        }
        runge_kutta(m, LONGEST);
    }
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean no_set)
{
    Model *m = c;
    if (m->lie == REPEATS && !no_set) {
        m->s.x = m->before.x;
        m->s.v = m->before.v;
    }
    m->before = m->s;
    if (m->lie == LATE_INPUTS) {
        go_on(m, (long)round(size / LONGEST));
        return fmi2OK;
    }
    take_inputs(m);
    if (m->lie == OWN_CLOCK) {
        size += point - m->s.time;
        point = m->s.time;
    }
    const bool overlooked = m->lie == PEEKED && !m->s.unread;
    double now[2];
    memcpy(now, m->s.input, sizeof now);
    memcpy(m->s.input, overlooked ? m->s.before : now, sizeof now);
    m->s.time = point;
    m->s.steps++;
    if (m->lie == EULER || m->lie == DIVERGING) {
        euler(m, size);
    } else {
        int count = (int)ceil(size / LONGEST);
        for (int i = 0; i < count; i++) {
            runge_kutta(m, size / count);
        }
    }
    m->s.time = point + size;
    for (int i = 0; i < 2 && overlooked; i++) {
        m->s.input[i] = now[i] + size * m->s.slope[i];
    }
    memcpy(m->s.before, m->s.input, sizeof now);
    m->s.unread = 0;
    memcpy(m->s.waiting, m->s.input, sizeof m->s.waiting);
    memset(m->s.slope, 0, sizeof m->s.slope);
    return fmi2OK;
}
