/* component.h: one FMU by the addresses of its functions, whatever its FMI version.
 *
 * The caller owns the memory that a Component points to and keeps it alive.
 */
#ifndef WORKBENCH_KERNEL_COMPONENT_H
#define WORKBENCH_KERNEL_COMPONENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "clocks.h"
#include "failure.h"

typedef void (*Function)(void);

/* What the kernel calls besides getters and setters; `function_name` gives the same names as text. */
typedef enum {
    SET_TIME,
    SET_STATES,
    GET_STATES,
    GET_DERIVATIVES,
    GET_INDICATORS,
    COMPLETED_STEP,
    ENTER_EVENT_MODE,
    ENTER_CONTINUOUS_MODE,
    ENTER_STEP_MODE,
    UPDATE_DISCRETE_STATES,
    DO_STEP,
    SET_SLOPES,
    GET_DIRECTIONAL,
    GET_FMU_STATE,
    SET_FMU_STATE,
    FREE_FMU_STATE,
    SET_CLOCK,
    GET_INTERVAL,
    GET_CLOCK,
    N_FUNCTIONS
} FunctionIndex;

/* NOT_EXPORTED stands for the status of a function that is not there; an FMU may return the same number. */
enum { FMI_WARNING = 1, FMI_DISCARD = 2, FMI_ERROR = 3, FMI_FATAL = 4, NOT_EXPORTED = -1 };

enum { MAX_EVENT_ITERATIONS = 1000 }; /* as in workbench/fmi/instance.py */

struct ComponentCalls;
struct Intermediate;

typedef struct {
    void *handle;
    const Function *functions; /* [N_FUNCTIONS], NULL where the FMU has none */
    const char *const *names;  /* [N_FUNCTIONS], as error messages call them */
    size_t nx, nz;
    int32_t version;
    int32_t event_mode;     /* model exchange, and co-simulation that was asked for it */
    int32_t completed_step; /* wants to be told of completed steps */
    int32_t interpolates;   /* co-simulation: takes the slopes of its inputs */
    int32_t slopes_work;    /* until it says otherwise */
    int32_t centres;        /* co-simulation: inputs held over a step have the value of its middle */
    int32_t event_due;      /* co-simulation: the last step ended at an event, which waits for the inputs there */
    double time;            /* of the last set_time or do_step [s] */
    double due;             /* its next time event [s] */
    double clock;           /* co-simulation: its own time is that much later than the session's [s] */
    const struct ComponentCalls *calls;
    Clocks *clocks; /* that the importer lets tick; NULL: none */
    struct Intermediate *intermediate; /* its environment, where it asks for inputs inside a step; NULL: it does not */
    int32_t ticked;        /* it was due when the last event was evaluated */
    int32_t in_circle;     /* what it shows at an instant may change what it sees there, and its state can be saved */
    void *before;          /* in a circle: saved before it evaluated the present event; NULL: it was not */
    int32_t *saved;        /* how many states of it are kept, to which it may be taken back; NULL: it never is */
    const double *longest; /* how long the next step of a solver may be [s]; NULL: it does not mind */
} Component;

/* What an event iteration or a step says. */
typedef struct {
    bool again, terminate, states_changed, event;
    double time; /* next time event (infinite: none), or how far the step got [s] */
} Answer;

/* One table for each FMI version. Each call returns the FMI status, or NOT_EXPORTED. */
typedef struct ComponentCalls {
    int (*completed_step)(const Component *component, Answer *answer);
    int (*update_discrete_states)(const Component *component, Answer *answer);
    int (*do_step)(const Component *component, double time, double step, Answer *answer);
    int (*set_slopes)(const Component *component, const uint32_t *references, size_t n, const int32_t *orders,
                      const double *slopes);
    int (*directional)(const Component *component, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                       const double *seed, size_t n_knowns, double *sensitivity);
    bool modes;          /* has the functions that enter a mode */
    bool sized;          /* getters and setters also take the number of values */
} ComponentCalls;

extern const ComponentCalls calls_fmi1;
extern const ComponentCalls calls_fmi2;
extern const ComponentCalls calls_fmi3;

const char *function_name(size_t index);
/* The table of an FMI version, NULL if there is none. */
const ComponentCalls *component_calls(int32_t version);

/* All of these note what went wrong in `failure` and return false then. `who` is the component's number. */
bool component_checked(const Component *component, FunctionIndex function, int status, int32_t who, Failure *failure);
bool component_set_time(Component *component, double time, int32_t who, Failure *failure);
bool component_states(const Component *component, FunctionIndex function, double *values, size_t n, int32_t who,
                      Failure *failure);
/* The promise noSetFMUStatePriorToCurrentPoint of FMI (2.0.4, 4.2.2). */
bool component_never_back(const Component *component);
/* GET_FMU_STATE, SET_FMU_STATE or FREE_FMU_STATE; a state that is not there is not freed. */
bool component_saved(const Component *component, FunctionIndex function, void **state, int32_t who, Failure *failure);
/* Evaluate the event once; a next event time that is not a number is refused. */
bool component_update(Component *component, Answer *answer, int32_t who, Failure *failure);
/* Evaluate the event until nothing changes, then go to step mode. */
bool component_settle(Component *component, int32_t who, Failure *failure);
/* Into event mode: clocks that are due tick. */
bool component_enter(const Component *component, FunctionIndex mode, int32_t who, Failure *failure);

#endif
