/* ring.c: the shortest master of a ring of FMI 2.0 slaves, beside which the kernel's is measured. */
#include <stddef.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef int (*SetReal)(void *, const unsigned *, size_t, const double *);
typedef int (*SetSlopes)(void *, const unsigned *, size_t, const int *, const double *);
typedef int (*GetReal)(void *, const unsigned *, size_t, double *);
typedef int (*DoStep)(void *, double, double, int);

typedef struct {
    void **components; /* [n] all of one library */
    size_t n;
    SetReal set;
    DoStep step;
    GetReal get;
    SetSlopes slopes;
    unsigned u, y;
    double gain, size; /* of the connection from the last to the first; of a step [s] */
    size_t steps;
} Ring;

static int larger(int a, int b)
{
    return a > b ? a : b;
}

static double passed(const Ring *ring, size_t from, double y)
{
    return from + 1 == ring->n ? ring->gain * y : y;
}

/* Each slave in turn gets what the one before it shows now, held over the step. */
EXPORT int bare_ring(const Ring *ring, double *last)
{
    int worst = ring->get(ring->components[ring->n - 1], &ring->y, 1, last);
    for (size_t i = 0; i < ring->steps; i++) {
        for (size_t k = 0; k < ring->n; k++) {
            const double input = passed(ring, k ? k - 1 : ring->n - 1, *last);
            worst = larger(worst, ring->set(ring->components[k], &ring->u, 1, &input));
            worst = larger(worst, ring->step(ring->components[k], (double)i * ring->size, ring->size, 1));
            worst = larger(worst, ring->get(ring->components[k], &ring->y, 1, last));
        }
    }
    return worst;
}

/* The calls that the workbench makes: inputs with their slopes, their left limits at the end of the step, their right
 * limits after it, and the last output on both sides of each communication point. */
EXPORT int same_calls_ring(const Ring *ring, double *last)
{
    const int order = 1;
    int worst = 0;
    for (size_t i = 0; i < ring->steps; i++) {
        for (size_t k = 0; k < ring->n; k++) {
            void *component = ring->components[k];
            double before = 0.0, slope = 0.0;
            worst = larger(worst, ring->get(ring->components[k ? k - 1 : ring->n - 1], &ring->y, 1, &before));
            before = passed(ring, k ? k - 1 : ring->n - 1, before);
            worst = larger(worst, ring->set(component, &ring->u, 1, &before));
            worst = larger(worst, ring->slopes(component, &ring->u, 1, &order, &slope));
            worst = larger(worst, ring->step(component, (double)i * ring->size, ring->size, 1));
            worst = larger(worst, ring->set(component, &ring->u, 1, &before));
            worst = larger(worst, ring->get(component, &ring->y, 1, last));
        }
        worst = larger(worst, ring->get(ring->components[ring->n - 1], &ring->y, 1, last));
        for (size_t k = 0; k < ring->n; k++) {
            double input = 0.0;
            worst = larger(worst, ring->get(ring->components[k ? k - 1 : ring->n - 1], &ring->y, 1, &input));
            input = passed(ring, k ? k - 1 : ring->n - 1, input);
            worst = larger(worst, ring->set(ring->components[k], &ring->u, 1, &input));
        }
        worst = larger(worst, ring->get(ring->components[ring->n - 1], &ring->y, 1, last));
    }
    return worst;
}
