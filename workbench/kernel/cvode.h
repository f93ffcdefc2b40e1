/* cvode.h: SUNDIALS' functions, which come by address (workbench/kernel/gear.py): no SUNDIALS header is needed. */
#ifndef WORKBENCH_KERNEL_CVODE_H
#define WORKBENCH_KERNEL_CVODE_H

#include <stdint.h>

/* The types of SUNDIALS 7: sunrealtype is double, sunindextype int64_t, SUNComm int without MPI; its
 * objects are pointers. */
typedef void *Pointer;
typedef int (*Rhs)(double t, Pointer y, Pointer ydot, void *data);
typedef int (*Weights)(Pointer y, Pointer weights, void *data);
typedef void (*Handler)(int line, const char *function, const char *file, const char *message, int code,
                        void *data, Pointer context);

typedef int (*Jacobian)(double t, Pointer y, Pointer ydot, Pointer matrix, void *data, Pointer scratch, Pointer scratch2,
                        Pointer scratch3);

/* The operations that CVODE asks of a matrix, and of a solver of linear equations; in a dense one these functions. */
enum {
    MATRIX_ID,        /* SUNMatGetID_Dense */
    MATRIX_CLONE,     /* SUNMatClone_Dense */
    MATRIX_DESTROY,   /* SUNMatDestroy_Dense */
    MATRIX_ZERO,      /* SUNMatZero_Dense */
    MATRIX_COPY,      /* SUNMatCopy_Dense */
    MATRIX_SCALE_ADD, /* SUNMatScaleAddI_Dense */
    MATRIX_OPERATIONS
};
enum {
    SOLVER_TYPE,  /* SUNLinSolGetType_Dense */
    SOLVER_ID,    /* SUNLinSolGetID_Dense */
    SOLVER_SETUP, /* SUNLinSolSetup_Dense */
    SOLVER_SOLVE, /* SUNLinSolSolve_Dense */
    SOLVER_OPERATIONS
};

/* One line each, in the order of GEAR_FUNCTIONS in workbench/kernel/gear.py. */
typedef struct {
    int (*SUNContext_Create)(int comm, Pointer *context);
    int (*SUNContext_Free)(Pointer *context);
    int (*SUNContext_ClearErrHandlers)(Pointer context);
    int (*SUNContext_PushErrHandler)(Pointer context, Handler handler, void *data);
    Pointer (*N_VNew_Serial)(int64_t n, Pointer context);
    int (*N_VEnableFusedOps_Serial)(Pointer vector, int on);
    double *(*N_VGetArrayPointer)(Pointer vector);
    void (*N_VDestroy)(Pointer vector);
    Pointer (*SUNDenseMatrix)(int64_t rows, int64_t columns, Pointer context);
    void (*SUNMatDestroy)(Pointer matrix);
    Pointer (*SUNLinSol_Dense)(Pointer vector, Pointer matrix, Pointer context);
    int (*SUNLinSolFree)(Pointer solver);
    Pointer (*CVodeCreate)(int method, Pointer context);
    int (*CVodeInit)(Pointer memory, Rhs rhs, double t, Pointer y);
    int (*CVodeReInit)(Pointer memory, double t, Pointer y);
    int (*CVodeSetUserData)(Pointer memory, void *data);
    int (*CVodeWFtolerances)(Pointer memory, Weights weights);
    int (*CVodeSetLinearSolver)(Pointer memory, Pointer solver, Pointer matrix);
    int (*CVodeSetMaxHnilWarns)(Pointer memory, int warnings);
    int (*CVodeSetMaxConvFails)(Pointer memory, int failures);
    int (*CVodeSetMaxErrTestFails)(Pointer memory, int failures);
    int (*CVodeSetInitStep)(Pointer memory, double h);
    int (*CVodeSetMaxStep)(Pointer memory, double h);
    int (*CVodeSetStopTime)(Pointer memory, double t);
    int (*CVode)(Pointer memory, double t_out, Pointer y, double *t, int task);
    int (*CVodeGetDky)(Pointer memory, double t, int order, Pointer y);
    int (*CVodeGetNumErrTestFails)(Pointer memory, long *failures);
    void (*CVodeFree)(Pointer *memory);
    int (*CVodeSetJacFn)(Pointer memory, Jacobian jacobian);
    Pointer (*SUNMatNewEmpty)(Pointer context);
    void (*SUNMatFreeEmpty)(Pointer matrix);
    Pointer (*SUNLinSolNewEmpty)(Pointer context);
    void (*SUNLinSolFreeEmpty)(Pointer solver);
    /* By these it is found where an object keeps its operations. */
    void *matrix_operations[MATRIX_OPERATIONS];
    void *solver_operations[SOLVER_OPERATIONS];
} Sundials;

enum { FUNCTIONS = 33 + MATRIX_OPERATIONS + SOLVER_OPERATIONS };
_Static_assert(sizeof(Sundials) == FUNCTIONS * sizeof(void *), "one address for each function");

#endif
