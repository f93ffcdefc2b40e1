/* failure.h: why a run could not go on; the Python side turns it into an exception. */
#ifndef WORKBENCH_KERNEL_FAILURE_H
#define WORKBENCH_KERNEL_FAILURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "solver.h"

/* The order is that of FAILURES in workbench/session/compiled_errors.py. */
typedef enum {
    NO_FAILURE = 0,
    FAILED_STATUS,      /* an FMI function returned worse than "warning" */
    FAILED_MISSING,     /* the FMU does not export the function */
    FAILED_ENDED,       /* the FMU asks to end the simulation */
    FAILED_ITERATION,   /* the event iteration does not settle */
    FAILED_VALUE,       /* recorded variable `index` is not finite: `value` */
    FAILED_STATE,       /* state `index` is not finite */
    FAILED_BOUND,       /* recorded variable `index` left the bound: `value` */
    FAILED_SOLVER,      /* see `message` */
    FAILED_STEPS,       /* too many steps between two points */
    FAILED_ZENO,        /* infinitely many events before `time` */
    FAILED_CHATTER,     /* events without time passing */
    FAILED_THROUGH,     /* an indicator went on across the zero where an event turned it at `time` */
    FAILED_EARLY,       /* too many early returns from one communication step */
    FAILED_EVENT_MODE,  /* the FMU requests event mode, which it does not offer */
    FAILED_GRID,        /* point `value` lies off the grid of the constant step */
    FAILED_MEMORY,      /* no memory */
    FAILED_LOOP,        /* an algebraic loop has no solution: `value` is left at connection `index`, see `message` */
    FAILED_WIRE,        /* connection `index` passes `value`, which is not finite */
    FAILED_EVENT_TIME,  /* an FMI function gave a next event time that is not a number */
    FAILED_UNIT,        /* a group of components: unit `index` of the master has noted why */
    FAILED_INTERVAL,    /* the FMU gave an interval of a clock that is negative or not finite */
    FAILED_ORDER,       /* connection `index` passed on a value that changed behind it, to `value` */
    PAUSED,             /* no failure: the caller may look after signals, then go on */
    N_FAILURES
} FailureCode;

typedef struct {
    int32_t code;
    int32_t status;    /* FMI status */
    int32_t component; /* whose call failed */
    int32_t function;  /* index of a missing function, -1: a getter or setter */
    int64_t index;     /* of the variable or state */
    double time;       /* [s] */
    double value;
    const char *name; /* of the FMI function */
    char message[SOLVER_MESSAGE];
} Failure;

/* Note the failure unless one is noted already; always false, so that callers can return it. */
bool fail_at(Failure *failure, FailureCode code, double time);
bool fail_of(Failure *failure, FailureCode code, double time, int32_t component);
bool fail_value(Failure *failure, FailureCode code, double time, size_t index, double value);
void failure_clear(Failure *failure);

#endif
