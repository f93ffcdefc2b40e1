/* instance.h: one FMU instance, the part that FMI 2.0 and FMI 3.0 share.
 *
 * fmi2*.c and fmi3*.c translate names and types; what is allowed when, access to variables, saved
 * states and the communication step are here, once.
 *
 * Log categories, to be declared in both model descriptions:
 *   logEvents         events of Co-Simulation and information from the model
 *   logStatusWarning  a value outside its declared range and the like
 *   logStatusDiscard  an evaluation that failed and may succeed with other values
 *   logStatusError    why a call returned an error
 *   logAll            all of them
 * FMI 2.0 errors are logged even when debug logging is off; in FMI 3.0 nothing is logged then.
 */
#ifndef WORKBENCH_INSTANCE_H
#define WORKBENCH_INSTANCE_H

#include "core.h"
#include "event_rules.h"
#include "inputs.h"
#include "memory.h"
#include "solver.h"
#include "turned.h"

/* The values of fmi2Status and fmi3Status, which agree. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status;

typedef enum { KIND_ME = 1, KIND_CS = 2, KIND_BOTH = 3 } Kind;

/* One bit each, so that a set of states is a number. */
typedef enum {
    STATE_INSTANTIATED = 1,
    STATE_INITIALISATION = 2,
    STATE_EVENT = 4,
    STATE_CONTINUOUS = 8,
    STATE_STEP = 16,          /* FMI 2: stepComplete */
    STATE_STEP_FAILED = 32,   /* FMI 2 only: doStep returned fmi2Discard */
    STATE_INTERMEDIATE = 64,  /* FMI 3 only: inside the intermediate update callback */
    STATE_TERMINATED = 128,
    STATE_ERROR = 256         /* FMI 2 only: FMI 3 goes to Terminated */
} State;

typedef enum {
    CATEGORY_EVENTS = 1,
    CATEGORY_WARNING = 2,
    CATEGORY_DISCARD = 4,
    CATEGORY_ERROR = 8,
    CATEGORY_ALL = 15
} Category;

/* A function of the interface: for which kind and in which states it may be called. */
typedef struct {
    const char *name;
    unsigned kinds;
    unsigned states;
} Call;

/* Everything besides the core and the inputs that a saved FMU state holds. Only doubles: no padding. */
typedef struct {
    double state;
    double tolerance; /* 0: the model's default */
    double start_time;
    double stop_time;        /* HUGE_VAL: none */
    double communication_point;
    double last_successful_time;
    double next_event_time;  /* HUGE_VAL: none */
    double event_due;        /* 1: an event iteration is due before the next step */
    double touched;          /* 1: for an input or parameter set since; due before the next value, too */
    double terminate;        /* 1: the model asked for the end */
    double step;             /* proposed step size of the solver, 0: none */
    Flights flights;         /* between events */
    Turned turned;           /* indicators that an event turned back */
} Record;

typedef struct Instance Instance;

typedef bool (*IntermediateUpdate)(Instance *instance, double *stop_at); /* false: it went wrong */

struct Instance {
    int fmi; /* 2 or 3 */
    Kind kind;
    Memory memory;
    Core *core;
    Solver *solver; /* Co-Simulation only */
    Inputs inputs;
    double *turned; /* [turned_doubles()] the vectors of record.turned; Co-Simulation */
    double *sides; /* [n_indicators] domain of each event indicator since the last event: 1, -1, 0 unknown */
    Record record;
    char *name;
    const char *call; /* the function under way, for messages */
    unsigned categories;
    void (*emit)(const Instance *instance, Status status, const char *category, const char *message);
    void (*logger)(void); /* the environment's, of the version's type */
    void *environment;
    bool muted; /* the solver tries: what the core reports is kept, not logged */
    char kept[512];
    bool event_mode_used; /* FMI 3 */
    bool early_return_allowed;
    void (*update)(void); /* FMI 3: the environment's intermediate update */
    IntermediateUpdate intermediate; /* NULL: none */
};

/* instance.c */
typedef struct {
    int fmi;
    Kind kind;
    Memory memory;
    const char *name;
    const char *token;
    bool logging;
    void (*emit)(const Instance *, Status, const char *, const char *);
    void (*logger)(void);
    void *environment;
} Birth;

Instance *instance_new(const Birth *birth, const char *call); /* NULL after logging why */
void instance_free(Instance *instance);
void instance_reset(Instance *instance);
State instance_state(const Instance *instance);
void instance_set_state(Instance *instance, State state);
bool instance_can_be(const Instance *instance, double state); /* whether a number from anywhere is a state of it */
const char *instance_state_name(const Instance *instance);

/* First thing in every function: the instance, or NULL after logging that the call is not allowed. */
Instance *instance_enter(void *pointer, const Call *call);

/* Log an error, go to the state that follows an error, return STATUS_ERROR. */
Status instance_fail(Instance *instance, const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 2, 3)))
#endif
    ;
void instance_log(Instance *instance, Category category, const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 3, 4)))
#endif
    ;
/* The core has said why: discard where the environment may try other values, else an error. */
Status instance_core_failed(Instance *instance);
Status instance_set_logging(Instance *instance, bool on, size_t n, const char *const *categories);
bool instance_missing(Instance *instance, const void *argument, const char *name); /* logs a null pointer */

/* Steps in the life of an instance; time, tolerance and so on are in the record. */
Status instance_set_experiment(Instance *instance, bool has_tolerance, double tolerance, double start,
                               bool has_stop, double stop);
Status instance_enter_initialisation(Instance *instance);
Status instance_exit_initialisation(Instance *instance);
Status instance_enter_event(Instance *instance);
Status instance_new_discrete_states(Instance *instance, CoreEventInfo *info);
Status instance_leave_event(Instance *instance, State next);

/* access.c: values of variables. `type` is the one the function was made for. */
Status access_read(Instance *instance, unsigned reference, VariableType type, double *value);
Status access_write(Instance *instance, unsigned reference, VariableType type, double value);
bool access_can_set(const Instance *instance, unsigned reference);
Status access_settle(Instance *instance); /* CS: the event iteration that a new input asks for */
Status access_states(Instance *instance, double *x, size_t n);
Status access_set_states(Instance *instance, const double *x, size_t n);
Status access_derivatives(Instance *instance, double *dx, size_t n);
Status access_indicators(Instance *instance, double *z, size_t n);
void access_remember_sides(Instance *instance); /* when Continuous-Time Mode is entered */
Status access_nominals(Instance *instance, double *nominals, size_t n);
Status access_set_time(Instance *instance, double time);
Status access_directional(Instance *instance, const unsigned *unknowns, size_t n_unknowns,
                          const unsigned *knowns, size_t n_knowns, const double *seed, double *sensitivity);
Status access_input_derivative(Instance *instance, unsigned reference, int order, double value);
Status access_output_derivative(Instance *instance, unsigned reference, int order, double *value);

/* snapshot.c: saved FMU states, one block of memory without pointers. */
Status snapshot_save(Instance *instance, void **saved); /* *saved: NULL or one saved before, reused */
Status snapshot_restore(Instance *instance, const void *saved);
Status snapshot_delete(Instance *instance, void **saved);
Status snapshot_size(Instance *instance, const void *saved, size_t *size);
Status snapshot_write(Instance *instance, const void *saved, void *bytes, size_t size);
Status snapshot_read(Instance *instance, const void *bytes, size_t size, void **saved);

/* communicate.c: the communication step. */
typedef struct {
    bool event_handling_needed;
    bool early_return;
    bool terminate;
} StepReport;

Status communicate(Instance *instance, double point, double size, StepReport *report);
bool communicate_handle_event(Instance *instance); /* event iteration; false after logging why */
void communicate_reach_event(Instance *instance);

#endif
