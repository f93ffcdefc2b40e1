/* kernel_driver.c: the compiled inner loop on an FMU made of C functions, under sanitizers.
 *
 * The FMU: dx/dt = u + k, x falls to 0 where it reaches 1, a time event every 0.25 s; y = x. Runs model exchange
 * (FMI 2.0) and co-simulation (FMI 3.0 with early returns and event mode), a pair connected by a link, failing
 * functions, the same pair under a master, with the second as co-simulation or as a group of its own, its step fixed
 * and controlled, and every allocation failing once (linked with -Wl,--wrap=calloc,--wrap=realloc).
 */
#include "banded.h"
#include "kernel.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define CHECK(condition) check((condition), #condition, __LINE__)

enum { X, U, K, N_REFERENCES };

static int failures;
static long allowed = -1; /* allocations left before one fails, -1: all succeed */

static void check(bool condition, const char *text, int line) {
    if (!condition) {
        fprintf(stderr, "line %d: %s\n", line, text);
        failures++;
    }
}

static bool granted(void) {
    if (allowed == 0) {
        return false;
    }
    allowed -= allowed > 0;
    return true;
}

void *__real_calloc(size_t count, size_t size);
void *__real_malloc(size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_realloc(void *memory, size_t size);

void *__wrap_calloc(size_t count, size_t size) {
    return granted() ? __real_calloc(count, size) : NULL;
}

void *__wrap_malloc(size_t size) {
    return granted() ? __real_malloc(size) : NULL;
}

void *__wrap_realloc(void *memory, size_t size) {
    return granted() ? __real_realloc(memory, size) : NULL;
}

/* ---- the FMU ---- */

typedef struct {
    double t, x, u, next, bad_time; /* derivatives and steps fail with `bad_status` from bad_time on */
    int k, bad_status, falls, kept; /* kept: states that were got and not freed */
    int saying;
} Fake;

static int bad(const Fake *f) {
    return f->t >= f->bad_time ? f->bad_status : 0;
}

static int set_time(Fake *f, double t) {
    f->t = t;
    return 0;
}

static int set_states(Fake *f, const double *x, size_t n) {
    f->x = n ? x[0] : 0.0;
    return 0;
}

static int get_states(Fake *f, double *x, size_t n) {
    x[n - 1] = f->x;
    return 0;
}

static int get_derivatives(Fake *f, double *dx, size_t n) {
    dx[n - 1] = f->u + f->k;
    return bad(f);
}

static int get_indicators(Fake *f, double *z, size_t n) {
    z[n - 1] = 1.0 - f->x;
    return 0;
}

static int enter(Fake *f) {
    (void)f;
    return 0;
}

static bool event(Fake *f) {
    const bool fall = f->x >= 1.0;
    f->x = fall ? 0.0 : f->x;
    f->falls += fall;
    f->next = f->t >= f->next - 1e-12 ? f->next + 0.25 : f->next;
    return fall;
}

typedef struct {
    int again, terminate, nominals, states, timed;
    double time;
} Info2;

static int new_discrete_states(Fake *f, Info2 *info) {
    *info = (Info2){.states = event(f), .timed = 1};
    info->time = f->next;
    return 0;
}

static int completed_step(Fake *f, int no_set, int *enter_event, int *terminate) {
    *enter_event = *terminate = 0;
    return f && no_set == (f->kept == 0) ? 0 : 3;
}

static int get_real(Fake *f, const uint32_t *references, size_t n, double *values) {
    for (size_t i = 0; i < n; i++) {
        values[i] = references[i] == X ? f->x : f->u;
    }
    return 0;
}

static int set_real(Fake *f, const uint32_t *references, size_t n, const double *values) {
    for (size_t i = 0; i < n; i++) {
        f->u = references[i] == U ? values[i] : f->u;
    }
    return 0;
}

static int set_integer(Fake *f, const uint32_t *references, size_t n, const int32_t *values) {
    f->k = references[n - 1] == K ? values[n - 1] : f->k;
    return 0;
}

static int get_real3(Fake *f, const uint32_t *references, size_t n, double *values, size_t m) {
    return m == n ? get_real(f, references, n, values) : 3;
}

static int set_real3(Fake *f, const uint32_t *references, size_t n, const double *values, size_t m) {
    return m == n ? set_real(f, references, n, values) : 3;
}

static int set_integer3(Fake *f, const uint32_t *references, size_t n, const int32_t *values, size_t m) {
    return m == n ? set_integer(f, references, n, values) : 3;
}

static int update_discrete_states(Fake *f, bool *again, bool *terminate, bool *nominals, bool *states, bool *timed,
                                  double *time) {
    *again = *terminate = *nominals = false;
    *states = event(f);
    *timed = true;
    *time = f->next;
    return 0;
}

/* Returns early where x reaches 1 or a time event is due. */
static int do_step(Fake *f, double t, double h, bool no_set, bool *wants_event, bool *terminate, bool *early,
                   double *reached) {
    const double rate = f->u + f->k;
    double way = rate > 0.0 ? fmin(h, (1.0 - f->x) / rate) : h;
    way = f->next > t ? fmin(way, f->next - t) : way;
    f->t = *reached = t + way;
    f->x += rate * way;
    f->x = way < h && f->next > f->t ? 1.0 : f->x;
    *wants_event = *early = way < h;
    *terminate = false;
    return no_set == (f->kept == 0) ? bad(f) : 3;
}

static int get_fmu_state(Fake *f, void **state) {
    *state = malloc(sizeof *f);
    if (!*state) {
        return 3;
    }
    *(Fake *)*state = *f;
    f->kept++;
    return 0;
}

static int set_fmu_state(Fake *f, const void *state) {
    const int kept = f->kept;
    *f = *(const Fake *)state;
    f->kept = kept;
    return 0;
}

static int free_fmu_state(Fake *f, void **state) {
    free(*state);
    *state = NULL;
    f->kept--;
    return 0;
}

/* ---- a system of such FMUs ---- */

typedef struct {
    Fake fakes[2];
    Component components[2];
    Function functions[N_FUNCTIONS];
    const char *names[N_FUNCTIONS];
    uint32_t references[N_REFERENCES];
    size_t zero, one;
    double reals[4];
    int32_t integers[1];
    Block blocks[6];
    Signal signals[2];
    double bias[2], written[2], wanted[2], seen[2], slopes[2], gain, offset, closes_at, linked, linked_before, largest, fresh;
    int32_t closed, to, kept[2];
    int32_t types[2], owners[2], discrete[2], orders[2];
    Forcing forcing;
    Link link;
    System system;
    Record record;
} Bench;

static void fill_functions(Bench *b, int version) {
    Function *f = b->functions;
    for (size_t i = 0; i < N_FUNCTIONS; i++) {
        b->names[i] = function_name(i);
    }
    f[SET_TIME] = (Function)set_time;
    f[SET_STATES] = (Function)set_states;
    f[GET_STATES] = (Function)get_states;
    f[GET_DERIVATIVES] = (Function)get_derivatives;
    f[GET_INDICATORS] = (Function)get_indicators;
    f[COMPLETED_STEP] = (Function)completed_step;
    f[ENTER_EVENT_MODE] = f[ENTER_CONTINUOUS_MODE] = f[ENTER_STEP_MODE] = (Function)enter;
    f[UPDATE_DISCRETE_STATES] = version == 3 ? (Function)update_discrete_states : (Function)new_discrete_states;
    f[DO_STEP] = (Function)do_step;
    f[GET_FMU_STATE] = (Function)get_fmu_state;
    f[SET_FMU_STATE] = (Function)set_fmu_state;
    f[FREE_FMU_STATE] = (Function)free_fmu_state;
}

static Block block(Bench *b, int version, uint32_t reference, size_t *column, void *buffer, int32_t component) {
    const bool whole = reference == K;
    Block made = {
        .get = version == 3 ? (Function)get_real3 : (Function)get_real,
        .get_name = "get", .set_name = "set",
        .references = &b->references[reference], .n_references = 1, .buffer = buffer, .n_values = 1,
        .slots = &b->zero, .columns = column, .n = 1,
        .type = whole ? INT32 : FLOAT64, .component = component, .plain = !whole,
    };
    if (whole) {
        made.set = version == 3 ? (Function)set_integer3 : (Function)set_integer;
    } else {
        made.set = version == 3 ? (Function)set_real3 : (Function)set_real;
    }
    return made;
}

static void setup(Bench *b, int version, size_t n) {
    static const size_t backwards[2] = {1, 0};
    *b = (Bench){.references = {X, U, K}, .one = 1, .gain = 0.5, .closes_at = -INFINITY, .linked = NAN, .closed = 1, .to = 1, .orders = {1, 1}};
    fill_functions(b, version);
    for (int32_t i = 0; i < 2; i++) {
        b->fakes[i] = (Fake){.next = 0.25, .bad_time = 1e9, .bad_status = 3};
        b->components[i] = (Component){
            .handle = &b->fakes[i], .functions = b->functions, .names = b->names, .nx = 1, .nz = 1,
            .version = version, .event_mode = 1, .completed_step = version == 2, .slopes_work = 1, .centres = 1,
            .saved = &b->kept[i], .in_circle = 1, /* the second evaluates an event first, and again when its input has changed */
        };
    }
    b->blocks[0] = block(b, version, U, &b->zero, &b->reals[0], 0);
    b->blocks[1] = block(b, version, K, &b->one, &b->integers[0], 0);
    b->blocks[2] = block(b, version, X, &b->zero, &b->reals[1], 0);
    b->blocks[3] = block(b, version, X, &b->one, &b->reals[2], 1);
    b->blocks[4] = block(b, version, X, &b->zero, &b->reals[1], 0);
    b->blocks[5] = block(b, version, U, &b->zero, &b->reals[3], 1);
    b->signals[0] = (Signal){.kind = SIGNAL_SINE, .p = {0.5, 6.283185307179586, 0.0, 1.0, 0.0}};
    b->signals[1] = (Signal){.kind = SIGNAL_STEP, .p = {0.6, 2.0, 0.0}};
    b->types[1] = INT32;
    b->discrete[1] = 1;
    b->forcing = (Forcing){
        .signals = b->signals, .bias = b->bias, .types = b->types, .owners = b->owners, .discrete = b->discrete,
        .written = b->written, .wanted = b->wanted, .seen = b->seen, .slopes = b->slopes, .orders = b->orders,
        .n = 2, .n_discrete = 1, .fast = {&b->blocks[0], 1}, .slow = {&b->blocks[1], 1}, .longest_step = 0.125,
    };
    b->link = (Link){.source = {&b->blocks[4], 1}, .destination = {&b->blocks[5], 1}, .members = &b->zero, .n = 1};
    b->system = (System){.components = b->components, .n_components = n, .links = &b->link, .n_links = n - 1,
                         .moving = &b->link, .n_moving = n - 1, .forcing = &b->forcing,
                         .order = n == 2 ? backwards : NULL};
    b->system.wires = (Wires){.gains = &b->gain, .offsets = &b->offset, .closes_at = &b->closes_at,
                              .typical = &b->gain, .values = &b->linked, .sizes = &b->largest, .fresh = &b->fresh,
                              .seen = &b->linked_before, .to = &b->to,
                              .closed = &b->closed, .n = 1};
    b->record = (Record){.access = {&b->blocks[2], n}, .n_values = n, .bound = INFINITY, .keep = 1, .every = 1};
    CHECK(kernel_system_open(&b->system) == 1);
}

static int32_t run_me_along(Bench *b, double until, Slopes *slopes) {
    double scale[2] = {1e-3, 1e-3};
    const double most[2] = {1.0, 1.0};
    double targets[50];
    for (int i = 0; i < 50; i++) {
        targets[i] = until * (i + 1) / 50;
    }
    Me me = {.system = &b->system, .solver_name = "vkm", .rtol = 1e-8, .scale = scale, .most = most, .slopes = slopes};
    int32_t done = kernel_me_open(&me) && kernel_me_run(&me, until, targets, 50, &b->record, 1);
    while (!done && b->system.failure.code == PAUSED) {
        done = kernel_me_go_on(&me);
    }
    kernel_me_close(&me);
    kernel_me_close(&me);
    return done;
}

static int32_t run_me(Bench *b, double until) {
    return run_me_along(b, until, NULL);
}

static int32_t run_cs(Bench *b, double until) {
    Cs cs = {.system = &b->system, .fixed = NAN, .longest = 1e-3, .variable_step = 1};
    int32_t done = kernel_cs_run(&cs, until, &until, 1, &b->record, 1);
    while (!done && b->system.failure.code == PAUSED) {
        done = kernel_cs_go_on(&cs);
    }
    return done;
}

/* ---- the same pair under a master: x of the first is the input of the second ---- */

typedef struct {
    bool grouped, controlled, held;
} MasterCase;

static int32_t run_master(Bench *b, double until, MasterCase kind) {
    static const size_t order[2] = {0, 1}, stages[2] = {1, 2}, no_wire = 0, second = 1, forced = 1;
    static const int32_t float64 = FLOAT64, yes = 1, no = 0, ones[1] = {1};
    double numbers[2][5] = {{0}}, bows[2] = {0}, raw = 0.0, reached = 0.0, start = 0.0, slopes[2] = {0}, spans[2] = {0}, ramps[2] = {0}, ramped[2] = {0};
    double times[2] = {0}, table[2] = {0}, scale = 1e-3, coarse = 0.0, fine = 0.0, watched = 1e-3, saved[32];
    double group_numbers[5] = {0}, bias = 0.0;
    const double most = 1.0;
    const Instants ticks = {1.0, 3.0, 10.0};
    int32_t known = 0, late = 0, group_type = FLOAT64;
    void *states[2];
    Block inlets[2] = {block(b, b->components[0].version, U, &b->zero, &b->reals[0], 0),
                       block(b, b->components[0].version, U, &b->zero, &b->reals[3], 1)};
    Block outlet = block(b, b->components[0].version, X, &b->zero, &b->reals[1], 0);
    Component own = b->components[1];
    Block own_input = inlets[1];
    Signal signal = {.times = times, .values = table, .n = 2};
    own_input.component = 0;
    Forcing forcing = {.signals = &signal, .bias = &bias, .types = &group_type, .owners = &no, .discrete = &no,
                       .written = &group_numbers[0], .wanted = &group_numbers[1], .seen = &group_numbers[2],
                       .slopes = &group_numbers[3], .orders = ones, .n = 1, .fast = {&own_input, 1},
                       .longest_step = INFINITY};
    System group = {.components = &own, .n_components = 1, .forcing = &forcing};
    Me me = {.system = &group, .solver_name = "vkm", .rtol = 1e-8, .scale = &scale, .most = &most};
    Record nobody = {.bound = INFINITY, .every = 1};
    Unit units[2];
    for (int32_t i = 0; i < 2; i++) {
        units[i] = (Unit){.component = i, .as_start = kind.held, .types = &float64, .moving = &yes,
                          .sources = i ? &no_wire : &forced, .starts = &numbers[i][0], .ends = &numbers[i][1],
                          .values = &numbers[i][2], .rates = &numbers[i][3], .bows = &numbers[i][4], .orders = ones, .n = 1,
                          .inlet = {&inlets[i], 1}, .fast = {&inlets[i], 1}};
        b->components[i].interpolates = 1; /* which they claim only */
    }
    units[0].outgoing = &no_wire;
    units[0].raw = &raw;
    units[0].n_outgoing = 1;
    units[0].outlet = (Access){&outlet, 1};
    units[0].instants = &ticks;
    units[0].n_instants = 1;
    CHECK(kernel_system_open(&group));
    int32_t done = 1;
    if (kind.grouped) {
        units[1].component = -1;
        units[1].members = &second;
        units[1].n_members = 1;
        units[1].me = &me;
        units[1].signals = &signal;
        units[1].times = times;
        units[1].tables = table;
        units[1].stale = 1;
        done = kernel_me_open(&me);
        b->system.failure = group.failure;
    }
    Control control = {.tolerance = 1e-4, .step = 1e-2, .least = 1e-6, .wires = &no_wire, .n_wires = 1,
                       .scale = &watched, .coarse = &coarse, .fine = &fine, .saved = saved, .states = states};
    Master master = {.units = units, .n_units = 2, .order = order, .stages = stages, .n_stages = 2, .from_held = &yes, .late = &late,
                     .moves = &yes, .known = &known, .start = &start, .reached = &reached, .slopes = slopes, .spans = spans, .extrapolation = kind.held ? 0 : 2,
                     .ramps = ramps, .ramped = ramped, .bows = bows, .nobody = &nobody, .hold_inputs = kind.held,
                     .control = kind.controlled ? &control : NULL};
    Cs cs = {.system = &b->system, .master = &master, .fixed = NAN, .longest = 1e-2, .variable_step = 1};
    CHECK(kernel_control_doubles(&cs) <= sizeof saved / sizeof saved[0]);
    done = done && kernel_cs_run(&cs, until, &until, 1, &b->record, 1);
    while (!done && b->system.failure.code == PAUSED) {
        done = kernel_cs_go_on(&cs);
    }
    CHECK(!done || (cs.time == until && b->components[0].slopes_work == (kind.held ? 1 : 0)));
    CHECK(!done || !kind.controlled || control.longest > 0.0);
    if (!done && b->system.failure.code == FAILED_UNIT) {
        CHECK(group.failure.code != NO_FAILURE);
        b->system.failure = group.failure;
    }
    kernel_me_close(&me);
    kernel_record_free(&control.trial);
    return done;
}

static int32_t run_masters(Bench *b, double until, int number) {
    return run_master(b, until, (MasterCase){(number & 1) != 0, (number & 2) != 0, (number & 4) != 0});
}

/* x of the second follows that of the first alike, however it is stepped. */
static void test_masters(void) {
    double last[8] = {0.0};
    for (int k = 0; k < 8; k++) {
        Bench b;
        setup(&b, 3, 2);
        CHECK(run_masters(&b, 3.0, k));
        CHECK(b.system.failure.code == NO_FAILURE);
        CHECK(b.fakes[0].falls >= 6 && b.record.rows > 50);
        last[k] = b.fakes[1].x + b.fakes[1].falls;
        CHECK(fabs(last[k] - last[0]) < 0.05);
        kernel_record_free(&b.record);
    }
    for (int k = 0; k < 4; k++) {
        for (size_t who = 0; who < 2; who++) {
            Bench b;
            setup(&b, 3, 2);
            b.fakes[who].bad_time = 0.7;
            CHECK(!run_masters(&b, 3.0, k));
            CHECK(b.system.failure.code == FAILED_STATUS || b.system.failure.code == FAILED_SOLVER);
            kernel_record_free(&b.record);
        }
        for (size_t i = 0; i < N_FUNCTIONS; i++) {
            Bench b;
            setup(&b, 3, 2);
            b.functions[i] = i == FREE_FMU_STATE ? b.functions[i] : NULL; /* without it what is saved is lost */
            if (!run_masters(&b, 1.0, k)) {
                CHECK(b.system.failure.code == FAILED_MISSING && b.system.failure.function == (int32_t)i);
            }
            kernel_record_free(&b.record);
        }
    }
}

/* Every allocation fails once, those of the FMUs' saved states and of the rows of a step that is tried, too. */
static void test_masters_short_of_memory(void) {
    for (int k = 0; k < 4; k++) {
        for (long granted_ones = 0;; granted_ones++) {
            Bench b;
            setup(&b, 3, 2);
            allowed = granted_ones;
            const int32_t done = run_masters(&b, 0.05, k);
            allowed = -1;
            const int32_t code = b.system.failure.code;
            CHECK(done || code == FAILED_MEMORY || (code == FAILED_STATUS && b.system.failure.status == 3));
            kernel_record_free(&b.record);
            if (done) {
                break;
            }
        }
    }
}

typedef int32_t (*Run)(Bench *, double);

static void test_run(Run run, int version, size_t n) {
    Bench b;
    setup(&b, version, n);
    CHECK(run(&b, 3.0));
    CHECK(b.system.failure.code == NO_FAILURE);
    CHECK(b.fakes[0].falls >= 6);
    CHECK(b.record.rows > 50);
    CHECK(b.record.width == 1 + 2 + n);
    double *columns = malloc(b.record.rows * b.record.width * sizeof(double));
    kernel_record_columns(&b.record, columns);
    for (size_t i = 1; i < b.record.rows; i++) {
        CHECK(columns[i] >= columns[i - 1]);
    }
    free(columns);
    kernel_record_free(&b.record);
    kernel_record_free(&b.record);
}

/* The connection as an algebraic loop: it is none, and both ways give the same. */
static void test_loop(Run run, int version) {
    double last[2] = {0.0, 0.0};
    for (int as_loop = 0; as_loop < 2; as_loop++) {
        Bench b;
        double work[8] = {0};
        double jacobian = 0.0;
        int32_t known = 0;
        setup(&b, version, 2);
        CHECK(loop_doubles(1) == sizeof work / sizeof work[0]);
        b.link.work = as_loop ? work : NULL;
        b.link.jacobian = &jacobian;
        b.link.known = &known;
        b.closes_at = 0.4;
        b.closed = 0;
        b.linked = 0.0;
        CHECK(run(&b, 3.0));
        CHECK(b.closed == 1);
        CHECK(known == as_loop);
        CHECK(!as_loop || fabs(jacobian + 1.0) < 1e-9);
        last[as_loop] = b.record.data[(b.record.rows - 1) * b.record.width + 4];
        kernel_record_free(&b.record);
    }
    CHECK(fabs(last[0] - last[1]) <= 1e-7 * fabs(last[0]));
}

/* The derivative by u that the second component gives, which shows none of it: x follows. */
static int of_input(Fake *f, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns,
                    const double *seed, size_t n_seed, double *sensitivity, size_t n_sensitivity) {
    const bool right = n_unknowns <= 1 && n_knowns == 1 && knowns[0] == U && n_seed == 1 && seed[0] == 1.0;
    for (size_t i = 0; i < n_sensitivity; i++) {
        sensitivity[i] = f->saying == 1 ? 2.0 : f->saying == 2 ? (double)NAN : 0.0;
    }
    (void)unknowns;
    return !right ? 3 : f->saying == 3 ? 3 : f->saying == 4 ? 4 : 0;
}

/* The loop's Jacobian by what the component says, if that is true: once compared, then believed or never asked again. */
static void test_exact_loop(void) {
    static const int32_t self[1] = {1};
    static const uint32_t x[1] = {X}, u[1] = {U};
    for (int saying = 0; saying < 5; saying++) {
        Bench b;
        double work[8] = {0};
        double jacobian = 0.0;
        int32_t known = 0, exact = PERHAPS_EXACT;
        uint32_t asked = 0;
        Block own;
        setup(&b, 3, 2);
        own = b.blocks[3];
        own.columns = &b.zero;
        b.functions[GET_DIRECTIONAL] = (Function)of_input;
        b.fakes[1].saying = saying;
        b.link = (Link){.source = {&own, 1}, .destination = b.link.destination, .members = &b.zero, .n = 1,
                        .work = work, .jacobian = &jacobian, .known = &known, .from = self, .to = self,
                        .unknowns = x, .knowns = u, .asked = &asked, .exact = &exact};
        b.fakes[1].x = 0.5;
        b.linked = 0.0;
        const bool solved = loop_solve(&b.system, &b.link, 0.0);
        CHECK(solved == (saying != 4));
        CHECK(solved ? exact == (saying == 0 ? EXACT : NOT_EXACT) : b.system.failure.function == GET_DIRECTIONAL);
        CHECK(!solved || fabs(b.linked - b.gain * 0.5) < 1e-12);
        if (saying == 0) { /* found again without a difference */
            known = 0;
            b.fakes[1].x = 0.7;
            CHECK(loop_solve(&b.system, &b.link, 0.0) && jacobian == -1.0 && fabs(b.linked - b.gain * 0.7) < 1e-12);
        }
    }
}

/* What a component says of how rows 10 … 13 (f, then y) move with states 20 and 21; TRUE_ONES is right. */
typedef enum { TRUE_ONES, WRONG_ONES, NOT_NUMBERS, ERRORS, FATAL_ERRORS, N_SAYINGS } Saying;

static int directional(Fake *f, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns,
                       const double *seed, double *sensitivity) {
    static const int status[N_SAYINGS] = {[ERRORS] = 3, [FATAL_ERRORS] = 4};
    const double factor[N_SAYINGS] = {1.0, 1.1, NAN, 1.0, 1.0};
    for (size_t i = 0; i < n_unknowns; i++) {
        sensitivity[i] = 0.0;
        for (size_t j = 0; j < n_knowns; j++) {
            const bool first = knowns[j] == 20;
            const double f1 = unknowns[i] == 11 && first ? 0.5 * factor[f->saying] : 0.0;
            const bool y = unknowns[i] == (first ? 12U : 13U);
            sensitivity[i] += seed[j] * (f1 + (y ? 1.0 : 0.0));
        }
    }
    return status[f->saying];
}

static int directional3(Fake *f, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns,
                        const double *seed, size_t n_seed, double *sensitivity, size_t n_sensitivity) {
    const bool right = n_seed == n_knowns && n_sensitivity == n_unknowns;
    return right ? directional(f, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity) : 3;
}

/* Along a run with events: x of the first moves the second's derivative by the gain of the connection, nothing else. */
typedef struct {
    SlopesWay way;
    Saying saying;
    bool grouped, hidden; /* both states at once; the file does not say that f moves */
    double bad_time;
    int version;
} SlopesCase;

static void check_slopes(const SlopesCase *one) {
    static const double times[4] = {0.1, 0.7, 1.3, 2.9};
    static const size_t members[2] = {0, 1}, ends[2] = {1, 2}, together = 2;
    static const size_t first[3] = {0, 2, 3}, rows[3] = {1, 2, 3}, hidden_first[3] = {0, 1, 2}, hidden_rows[2] = {2, 3};
    static const uint32_t knowns[2] = {20, 21}, unknowns[4] = {10, 11, 12, 13};
    Bench b;
    double x[8] = {0}, dx[8] = {0}, a[16] = {0}, c[16] = {0}, work[24];
    Slopes slopes = {
        .times = times, .n_times = 4, .x = x, .dx = dx, .a = a, .c = c, .work = work,
        .groups = {
            .members = members, .ends = one->grouped ? &together : ends, .n_groups = one->grouped ? 1 : 2,
            .first = one->hidden ? hidden_first : one->grouped ? first : NULL,
            .rows = one->hidden ? hidden_rows : rows,
        },
        .knowns = knowns, .unknowns = unknowns, .way = (int32_t)one->way,
    };
    setup(&b, one->version, 2);
    b.functions[GET_DIRECTIONAL] = one->version == 3 ? (Function)directional3 : (Function)directional;
    b.fakes[0].saying = one->saying;
    b.fakes[0].bad_time = one->bad_time;
    const bool fatal = one->way == BY_DIRECTIONAL && one->saying == FATAL_ERRORS, fails = one->bad_time < 3.0;
    CHECK(run_me_along(&b, 3.0, &slopes) == !(fails || fatal));
    CHECK(!fatal || b.system.failure.function == GET_DIRECTIONAL);
    const size_t expected = fatal ? 0 : fails ? 2 : 4;
    CHECK(slopes.found == expected && slopes.passed == expected);
    const bool believed = one->saying == TRUE_ONES && !one->hidden;
    CHECK(slopes.refuted[BY_DIRECTIONAL] == (one->way == BY_DIRECTIONAL && !believed ? expected : 0));
    CHECK(slopes.refuted[BY_GROUPS] == (one->way <= BY_GROUPS && one->hidden ? expected : 0));
    for (size_t k = 0; k < slopes.found; k++) {
        const double *f = a + 4 * k, *y = c + 4 * k;
        CHECK(fabs(f[1] - b.gain) < 1e-6 && f[0] == 0.0 && f[2] == 0.0 && f[3] == 0.0);
        CHECK(fabs(y[0] - 1.0) < 1e-6 && y[1] == 0.0 && y[2] == 0.0 && fabs(y[3] - 1.0) < 1e-6);
        CHECK(fabs(dx[2 * k + 1] - b.gain * x[2 * k]) < 1e-9);
        CHECK(one->way != BY_DIRECTIONAL || !believed || f[1] == b.gain);
    }
    kernel_record_free(&b.record);
}

/* A band with zeros on its diagonal, which only pivoting solves: the residual, and copies and sums. */
static void check_banded(size_t n, size_t below, size_t above) {
    Banded *m = banded_new(n, below, above), *factors = banded_new(n, below, above);
    size_t pivots[40];
    double x[40], b[40];
    CHECK(m && factors);
    if (!m || !factors) {
        free(m);
        free(factors);
        return;
    }
    uint32_t random = 1;
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j > above ? j - above : 0; i < n && i <= j + below; i++) {
            random = 1664525u * random + 1013904223u;
            *banded_at(m, i, j) = i == j && below && above && j % 3 == 0 ? 0.0 : (double)random / 4294967296.0 - 0.5;
        }
        x[j] = b[j] = (double)(j + 1);
    }
    banded_copy(factors, m);
    CHECK(banded_factor(factors, pivots));
    banded_solve(factors, pivots, x);
    double residual = 0.0, size = 0.0; /* the largest, and of what it is made */
    for (size_t i = 0; i < n; i++) {
        double sum = -b[i], of = fabs(b[i]);
        for (size_t j = i > below ? i - below : 0; j < n && j <= i + above; j++) {
            sum += *banded_at(m, i, j) * x[j];
            of += fabs(*banded_at(m, i, j) * x[j]);
        }
        residual = fmax(residual, fabs(sum));
        size = fmax(size, of);
    }
    CHECK(residual <= 1e-13 * size);
    const double corner = *banded_at(m, 0, 0), beside = above && n > 1 ? *banded_at(m, 0, 1) : 0.0;
    banded_scale_add_identity(m, -2.0);
    CHECK(*banded_at(m, 0, 0) == 1.0 - 2.0 * corner && (!above || n < 2 || *banded_at(m, 0, 1) == -2.0 * beside));
    banded_zero(m);
    CHECK(!banded_factor(m, pivots));
    free(m);
    free(factors);
}

static void test_banded(void) {
    for (size_t below = 0; below < 5; below++) {
        for (size_t above = 0; above < 5; above++) {
            check_banded(below > above ? below + 1 : above + 1, below, above);
            check_banded(40, below, above);
        }
    }
}

static void test_slopes(void) {
    for (int version = 2; version <= 3; version++) {
        for (int way = BY_DIRECTIONAL; way < N_WAYS; way++) {
            for (int saying = 0; saying < N_SAYINGS; saying++) {
                for (int kind = 0; kind < 6; kind++) {
                    const bool grouped = kind % 3 > 0, hidden = kind % 3 == 2;
                    const double bad_time = kind < 3 ? 1e9 : 1.0;
                    check_slopes(&(SlopesCase){(SlopesWay)way, (Saying)saying, grouped, hidden, bad_time, version});
                }
            }
        }
    }
}

/* A linear system: continuous, then sampled. */
static void test_blocks(void) {
    const double a = -1.0, bb = 1.0, c = 1.0, d = 2.0;
    double memory[3] = {3.0, 5.0, 0.0};
    double next = 0.0;
    Lti lti = {.nx = 1, .nu = 1, .ny = 1, .a = &a, .b = &bb, .c = &c, .d = &d, .memory = memory, .next = &next};
    const uint32_t y = 2;
    double value = 0.0;
    CHECK(lti_get_real(&lti, &y, 1, &value) == 0 && value == 11.0);
    CHECK(lti_get_derivatives(&lti, &value, 1) == 0 && value == -2.0);
    const uint32_t input_and_state[2] = {0, 1}, output_and_rate[2] = {2, 3}, nothing = 4;
    const double seed[2] = {10.0, 1.0};
    double moved[2] = {0.0};
    CHECK(lti_get_directional(&lti, output_and_rate, 2, input_and_state, 2, seed, moved) == 0);
    CHECK(moved[0] == 10.0 * d + c && moved[1] == 10.0 * bb + a);
    CHECK(lti_get_directional(&lti, &nothing, 1, input_and_state, 2, seed, moved) == 3);
    void *saved = NULL;
    CHECK(lti_get_fmu_state(&lti, &saved) == 0);
    memory[1] = 7.0;
    CHECK(lti_set_fmu_state(&lti, saved) == 0 && memory[1] == 5.0);
    CHECK(lti_free_fmu_state(&lti, &saved) == 0 && !saved);
    lti.instants = (Instants){0.0, 1.0, 10.0};
    memory[0] = 4.0;
    CHECK(lti_get_real(&lti, &y, 1, &value) == 0 && value == 11.0); /* held */
    CHECK(lti_enter_event_mode(&lti) == 0 && lti.ticking);
    CHECK(lti_get_real(&lti, &y, 1, &value) == 0 && value == 13.0);
    CHECK(lti_enter_continuous_mode(&lti) == 0 && memory[1] == -1.0 && lti.ticks == 1);
}

/* Take a block through some thousand steps and events; false: it was short of memory. */
static bool drive(Element *e, double shortest) {
    void *saved = NULL;
    bool good = true;
    double values[8], seed = 1.0;
    const uint32_t u = 0, y = (uint32_t)(e->nu + e->nx), rate = y + 1;
    for (int k = 0; good && k < 3000; k++) {
        LtiEventInfo info;
        int event, terminate;
        const double t = 1e-3 * k * shortest, inputs[3] = {3.0 * sin(7.0 * t), cos(3.0 * t), 0.5};
        const uint32_t references[3] = {0, 1, 2};
        block_set_time(e, t);
        block_set_real(e, references, e->nu, inputs);
        if (k % 10 == 0) {
            block_enter_event_mode(e);
            good = block_update(e, &info) == 0;
            block_enter_continuous_mode(e);
        }
        block_get_indicators(e, values, e->nz);
        block_get_derivatives(e, values, e->nx);
        CHECK(block_get_real(e, &y, 1, values) == 0 && isfinite(values[0]));
        CHECK(block_get_directional(e, &y, 1, &u, 1, &seed, values) == 0);
        CHECK(e->nx == 0 || block_get_directional(e, &rate, 1, &u, 1, &seed, values) == 0);
        good = good && block_completed_step(e, 0, &event, &terminate) == 0;
        if (k % 500 == 250) {
            good = good && block_get_fmu_state(e, &saved) == 0 && block_set_fmu_state(e, saved) == 0;
        }
    }
    block_free_fmu_state(e, &saved);
    block_free(e);
    return good;
}

static Element element(BlockNumber kind, const double *p, double *memory) {
    static const double x[] = {-1.0, 0.0, 2.0}, z[] = {0.0, 1.0, 2.0, 4.0, 3.0, 1.0, 0.0, -1.0, 5.0};
    const bool two = kind == BLOCK_LOOKUP_2D || kind == BLOCK_FRICTION || kind == BLOCK_PRODUCT || kind == BLOCK_EXTREME;
    const bool states = kind >= BLOCK_INTEGRATOR && kind <= BLOCK_PID;
    Element e = {
        .p = p, .grids = {x, kind == BLOCK_LOOKUP ? z : x, z}, .sizes = {3, 3, 9}, .memory = memory,
        .nu = kind == BLOCK_SWITCH ? 3 : two ? 2 : 1, .nx = states ? 1U + (kind == BLOCK_PID) : 0,
        .nz = kind == BLOCK_LOOKUP_2D ? 4 : kind == BLOCK_PRODUCT || kind == BLOCK_DELAY ? 0 : 2,
        .longest = (double)INFINITY, .kind = (int32_t)kind, .event_mode = 1,
    };
    e.nz += kind == BLOCK_INTEGRATOR;
    return e;
}

static void test_every_block(void) {
    const double p[] = {-0.5, 0.6, 0.01, 0.7, 0.2, 0.1, 0.3}, others[] = {1.0, 1.0, 1e-6, 1e-6};
    const double delay[] = {0.05, 0.05, 1.0, 2.0, 1.0};
    /* Behind it A, B, C, D of two states. */
    const double pilot[] = {0.05, 0.05, 0.0, 0.0, -7.0, -10.0, 1.0, 0.0, 1.0, 0.0, 2.0, 10.0, 0.5};
    for (int kind = 0; kind < N_BLOCKS; kind++) {
        const bool positive = kind == BLOCK_QUANTISER || kind == BLOCK_FRICTION || kind == BLOCK_EXTREME ||
                              kind == BLOCK_LOOKUP || kind == BLOCK_LOOKUP_2D;
        for (int behind = 0; behind < 1 + (kind == BLOCK_DELAY); behind++) {
            double memory[8] = {0.0};
            const double *given = kind != BLOCK_DELAY ? (positive ? others : p) : behind ? pilot : delay;
            Element e = element((BlockNumber)kind, given, memory);
            e.nx += behind ? 2 : 0;
            e.mode[0] = kind == BLOCK_DELAY ? -(double)INFINITY : 0.0;
            CHECK(drive(&e, 1.0));
        }
    }
    for (long k = 0;; k++) { /* a delay that is short of memory says so, and loses nothing */
        double memory[8] = {0.0};
        Element e = element(BLOCK_DELAY, delay, memory);
        e.mode[0] = -(double)INFINITY;
        allowed = k;
        const bool done = drive(&e, 1.0);
        allowed = -1;
        if (done) {
            CHECK(k > 2);
            return;
        }
    }
}

static void test_failures(Run run, int version) {
    for (int status = 2; status <= 4; status++) {
        Bench b;
        setup(&b, version, 1);
        b.fakes[0].bad_time = 0.7;
        b.fakes[0].bad_status = status;
        CHECK(!run(&b, 3.0));
        CHECK(b.system.failure.code == FAILED_STATUS || b.system.failure.code == FAILED_SOLVER);
        kernel_record_free(&b.record);
    }
    for (size_t i = 0; i < N_FUNCTIONS; i++) {
        Bench b;
        setup(&b, version, 1);
        b.functions[i] = i == FREE_FMU_STATE ? b.functions[i] : NULL; /* without it what is saved is lost */
        if (!run(&b, 1.0)) {
            CHECK(b.system.failure.code == FAILED_MISSING);
            CHECK(b.system.failure.function == (int32_t)i);
        }
        kernel_record_free(&b.record);
    }
}

static void test_short_of_memory(Run run, int version) {
    for (long k = 0;; k++) {
        Bench b;
        setup(&b, version, 1);
        allowed = k;
        const int32_t done = run(&b, 3.0);
        allowed = -1;
        CHECK(done || b.system.failure.code == FAILED_MEMORY);
        kernel_record_free(&b.record);
        if (done) {
            CHECK(k > 0);
            return;
        }
    }
}

/* A step that ends early at 0.25 s, or fails, is the last, and is not counted. */
static void test_time_steps(void) {
    const double fails_at[2] = {1e9, 0.15};
    for (size_t i = 0; i < 2; i++) {
        Bench b;
        double seconds[10] = {0};
        setup(&b, 3, 1);
        b.fakes[0].bad_time = fails_at[i];
        CHECK(kernel_time_steps(&b.system, 0.0, 0.1, 10, 60.0, seconds) == 2 - i);
        CHECK(seconds[0] >= 0.0 && seconds[0] < 60.0);
        CHECK(kernel_time_steps(&b.system, 0.0, 0.1, 10, 0.0, seconds) == 0);
    }
}

int main(void) {
    for (size_t n = 1; n <= 2; n++) {
        test_run(run_me, 2, n);
        test_run(run_cs, 3, n);
    }
    test_loop(run_me, 2);
    test_slopes();
    test_exact_loop();
    test_masters();
    test_masters_short_of_memory();
    test_banded();
    test_blocks();
    test_every_block();
    test_time_steps();
    test_failures(run_me, 2);
    test_failures(run_cs, 3);
    test_short_of_memory(run_me, 2);
    test_short_of_memory(run_cs, 3);
    return failures != 0;
}
