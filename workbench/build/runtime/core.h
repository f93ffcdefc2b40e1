/* core.h: one instance of a generated model: its memory, its evaluation and its events.
 *
 * The core knows nothing of an FMI version. fmi2.c and fmi3.c check the state machine and translate
 * types; solver.c integrates for Co-Simulation; the generated model.c holds the equations.
 *
 * Every variable, whatever its FMI type, is one double in `v`; its index is its value reference.
 * (Integers up to 2^53 and Booleans are exact in a double.) All that a saved FMU state has to hold
 * lies in ONE block of memory without pointers, the image; copying it is taking a snapshot. Only the past of delays
 * is beside it, as it grows with the steps; a snapshot has that behind the image.
 */
#ifndef WORKBENCH_CORE_H
#define WORKBENCH_CORE_H

#include <stdbool.h>
#include <stddef.h>

typedef enum { TYPE_REAL, TYPE_INTEGER, TYPE_BOOLEAN, TYPE_ENUMERATION } VariableType;

typedef enum {
    CAUSALITY_INPUT,
    CAUSALITY_OUTPUT,
    CAUSALITY_PARAMETER,
    CAUSALITY_CALCULATED_PARAMETER,
    CAUSALITY_LOCAL,
    CAUSALITY_INDEPENDENT
} Causality;

typedef enum {
    VARIABILITY_CONSTANT,
    VARIABILITY_FIXED,
    VARIABILITY_TUNABLE,
    VARIABILITY_DISCRETE,
    VARIABILITY_CONTINUOUS
} Variability;

typedef enum { INITIAL_NONE, INITIAL_EXACT, INITIAL_APPROX, INITIAL_CALCULATED } Initial;

typedef enum { ROLE_OTHER, ROLE_STATE, ROLE_DERIVATIVE, ROLE_DISCRETE_STATE } Role;

typedef struct {
    unsigned char type;        /* VariableType */
    unsigned char causality;   /* Causality */
    unsigned char variability; /* Variability */
    unsigned char initial;     /* Initial */
    unsigned char role;        /* Role */
} VariableInfo;

/* Constant facts of the model, in the generated model.c. */
typedef struct {
    const char *name;  /* model identifier */
    const char *token; /* FMI 2 GUID and FMI 3 instantiation token, one text */
    size_t n_variables;
    size_t n_states;
    size_t n_indicators;
    size_t n_relations;         /* frozen relations and integer-valued expressions (floor, ...) */
    size_t n_memory;            /* doubles for conditions, clocks and time events */
    const VariableInfo *variables;       /* [n_variables] */
    const char *const *names;            /* [n_variables], for log messages */
    const unsigned *states;              /* [n_states], value references in FMI's order */
    const unsigned *derivatives;         /* [n_states] */
    const double *state_nominals;        /* [n_states] */
    const double *minimum;               /* [n_variables], -HUGE_VAL where there is none */
    const double *maximum;               /* [n_variables], HUGE_VAL where there is none */
    bool has_time_events;
    bool stiff;                 /* CS integrates with the implicit method */
    double default_tolerance;
} ModelInfo;

extern const ModelInfo model_info;

typedef enum { CORE_INSTANTIATED, CORE_INITIALISING, CORE_EVENT, CORE_CONTINUOUS } CoreMode;

typedef struct Core Core;

typedef struct {
    bool discrete_states_need_update;      /* iterate once more */
    bool terminate;
    bool nominals_changed;
    bool continuous_states_changed;        /* a reinit happened in this iteration */
    bool next_event_time_defined;
    double next_event_time;
} CoreEventInfo;

/* A message for the environment's logger; `is_error` chooses the category. */
typedef void (*CoreLog)(void *environment, bool is_error, const char *message);

/* Life. core_new returns NULL when there is no memory. */
Core *core_new(CoreLog log, void *environment);
void core_free(Core *core);
void core_reset(Core *core); /* to start values, as after core_new */

/* Values. All functions that return bool return false after logging what went wrong (a value that is
 * not finite, an equation that cannot be solved, an event iteration that does not end). */
bool core_get(Core *core, unsigned vr, double *value); /* evaluates the equations if something changed */
void core_set(Core *core, unsigned vr, double value);  /* checks nothing; marks the equations as due */
double core_time(const Core *core);
CoreMode core_mode(const Core *core);

/* Modes. */
bool core_enter_initialisation(Core *core, double start_time);
bool core_exit_initialisation(Core *core);   /* ends in CORE_EVENT; the caller iterates */
void core_enter_event(Core *core);
bool core_new_discrete_states(Core *core, CoreEventInfo *info); /* ONE event iteration */
bool core_enter_continuous(Core *core);      /* freezes relations */
bool core_completed_step(Core *core);        /* the environment has accepted a step ... */
bool core_accepted(Core *core);              /* ... or the solver: delays note their inputs */
bool core_wants_event(const Core *core);     /* whether an event should follow there, as a delay's step was too long */

/* Continuous time. n is model_info.n_states / n_indicators. */
void core_set_time(Core *core, double time);
void core_set_states(Core *core, const double *x);
void core_get_states(const Core *core, double *x);
bool core_get_derivatives(Core *core, double *dx);
bool core_get_indicators(Core *core, double *z);
/* Exact forward-mode derivative: d(unknowns) = (∂unknowns/∂knowns) d(knowns), frozen relations.
 * Knowns: inputs, states, tunable parameters; unknowns: outputs, derivatives, algebraic locals. */
bool core_directional(Core *core, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                      size_t n_knowns, const double *seed, double *sensitivity);

/* Snapshots hold everything above; their size changes where the model has delays. */
size_t core_saved_size(const Core *core);
void core_save(const Core *core, void *saved);
bool core_holds(const void *saved, size_t size); /* whether bytes from anywhere can be what core_save wrote */
bool core_load(Core *core, const void *saved);   /* of what holds; false: no memory */

/* printf-like logging through the environment. */
void core_log(Core *core, bool is_error, const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 3, 4)))
#endif
    ;

#endif
