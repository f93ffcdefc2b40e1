#include "gear_banded.h"

#include <stdlib.h>
#include <string.h>

/* How SUNDIALS' matrices and solvers begin. */
typedef struct {
    void *content;
    void **operations;
    Pointer context;
} Object;

enum { OF_NO_KIND_OF_SUNDIALS = 1000, DIRECT = 0 };
/* So many operations the tables of SUNDIALS 7.0 have; later ones are longer. */
enum { MATRIX_TABLE = 10, SOLVER_TABLE = 15 }; /* those that are looked for stand among them in each version */

struct BandedNewton {
    const Sundials *c;
    Pointer context;
    const Sparsity *sparsity;
    size_t n;
    size_t matrix_slots[MATRIX_OPERATIONS], solver_slots[SOLVER_OPERATIONS];
    double *ordered; /* [n] scratch */
    size_t pivots[]; /* [n] of the last factors */
};

typedef struct {
    BandedNewton *newton;
    Banded *banded;
} Content;

static Content *content_of(Pointer matrix) { return ((Object *)matrix)->content; }

Banded *banded_of(Pointer matrix) { return content_of(matrix)->banded; }

/* ---- operations ---- */

static int id(Pointer object)
{
    (void)object;
    return OF_NO_KIND_OF_SUNDIALS;
}

static int type(Pointer solver)
{
    (void)solver;
    return DIRECT;
}

static Pointer clone_matrix(Pointer matrix) { return gear_banded_matrix(content_of(matrix)->newton); }

static void destroy_matrix(Pointer matrix)
{
    const Sundials *c = content_of(matrix)->newton->c;
    free(banded_of(matrix));
    free(content_of(matrix));
    c->SUNMatFreeEmpty(matrix);
}

static int zero_matrix(Pointer matrix)
{
    banded_zero(banded_of(matrix));
    return 0;
}

static int copy_matrix(Pointer from, Pointer to)
{
    banded_copy(banded_of(to), banded_of(from));
    return 0;
}

static int scale_add_identity(double c, Pointer matrix)
{
    banded_scale_add_identity(banded_of(matrix), c);
    return 0;
}

static int set_up(Pointer solver, Pointer matrix)
{
    BandedNewton *newton = ((Object *)solver)->content;
    return banded_factor(banded_of(matrix), newton->pivots) ? 0 : 1; /* 1: another step may do */
}

static int solve(Pointer solver, Pointer matrix, Pointer x, Pointer b, double tolerance)
{
    BandedNewton *newton = ((Object *)solver)->content;
    const size_t *place = newton->sparsity->place;
    const double *given = newton->c->N_VGetArrayPointer(b);
    double *found = newton->c->N_VGetArrayPointer(x);
    (void)tolerance;
    for (size_t i = 0; i < newton->n; i++) {
        newton->ordered[place[i]] = given[i];
    }
    banded_solve(banded_of(matrix), newton->pivots, newton->ordered);
    for (size_t i = 0; i < newton->n; i++) {
        found[i] = newton->ordered[place[i]];
    }
    return 0;
}

/* ---- objects ---- */

/* Where in an object's table each of some functions stands. */
static bool find(const Object *object, size_t length, void *const *functions, size_t n, size_t *slots)
{
    for (size_t i = 0; i < n; i++) {
        for (slots[i] = 0; slots[i] < length && object->operations[slots[i]] != functions[i]; slots[i]++) {
        }
        if (slots[i] == length) {
            return false;
        }
    }
    return true;
}

static bool find_all(BandedNewton *newton)
{
    const Sundials *c = newton->c;
    Pointer matrix = c->SUNDenseMatrix(1, 1, newton->context);
    Pointer vector = c->N_VNew_Serial(1, newton->context);
    Pointer solver = matrix != NULL && vector != NULL ? c->SUNLinSol_Dense(vector, matrix, newton->context) : NULL;
    const bool found = solver != NULL
        && find(matrix, MATRIX_TABLE, c->matrix_operations, MATRIX_OPERATIONS, newton->matrix_slots)
        && find(solver, SOLVER_TABLE, c->solver_operations, SOLVER_OPERATIONS, newton->solver_slots);
    if (solver != NULL) {
        c->SUNLinSolFree(solver);
    }
    if (vector != NULL) {
        c->N_VDestroy(vector);
    }
    if (matrix != NULL) {
        c->SUNMatDestroy(matrix);
    }
    return found;
}

BandedNewton *gear_banded_new(const Sundials *c, Pointer context, const Sparsity *sparsity, size_t n)
{
    BandedNewton *newton = calloc(1, sizeof *newton + n * sizeof(size_t));
    double *ordered = calloc(n, sizeof(double));
    if (newton != NULL && ordered != NULL) {
        newton->c = c;
        newton->context = context;
        newton->sparsity = sparsity;
        newton->n = n;
        newton->ordered = ordered;
        if (find_all(newton)) {
            return newton;
        }
    }
    free(ordered);
    free(newton);
    return NULL;
}

void gear_banded_free_solver(const BandedNewton *newton, Pointer solver) { newton->c->SUNLinSolFreeEmpty(solver); }

void gear_banded_free(BandedNewton *newton)
{
    if (newton != NULL) {
        free(newton->ordered);
        free(newton);
    }
}

typedef void (*Function)(void);

/* C has no cast from functions to data pointers. */
static void put(Object *object, size_t slot, Function function)
{
    memcpy(&object->operations[slot], &function, sizeof function);
}

Pointer gear_banded_matrix(BandedNewton *newton)
{
    const Sparsity *sparsity = newton->sparsity;
    Object *matrix = newton->c->SUNMatNewEmpty(newton->context);
    Content *content = calloc(1, sizeof *content);
    Banded *banded = banded_new(newton->n, sparsity->below, sparsity->above);
    if (matrix == NULL || content == NULL || banded == NULL) {
        free(banded);
        free(content);
        if (matrix != NULL) {
            newton->c->SUNMatFreeEmpty(matrix);
        }
        return NULL;
    }
    *content = (Content){newton, banded};
    matrix->content = content;
    put(matrix, newton->matrix_slots[MATRIX_ID], (Function)id);
    put(matrix, newton->matrix_slots[MATRIX_CLONE], (Function)clone_matrix);
    put(matrix, newton->matrix_slots[MATRIX_DESTROY], (Function)destroy_matrix);
    put(matrix, newton->matrix_slots[MATRIX_ZERO], (Function)zero_matrix);
    put(matrix, newton->matrix_slots[MATRIX_COPY], (Function)copy_matrix);
    put(matrix, newton->matrix_slots[MATRIX_SCALE_ADD], (Function)scale_add_identity);
    return matrix;
}

Pointer gear_banded_solver(BandedNewton *newton)
{
    Object *solver = newton->c->SUNLinSolNewEmpty(newton->context);
    if (solver == NULL) {
        return NULL;
    }
    solver->content = newton;
    put(solver, newton->solver_slots[SOLVER_TYPE], (Function)type);
    put(solver, newton->solver_slots[SOLVER_ID], (Function)id);
    put(solver, newton->solver_slots[SOLVER_SETUP], (Function)set_up);
    put(solver, newton->solver_slots[SOLVER_SOLVE], (Function)solve);
    return solver;
}
