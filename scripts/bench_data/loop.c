/* loop.c: the shortest loop around an FMI 2.0 slave, against which the kernel is measured. */
#include <math.h>
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
    void *component;
    SetReal set;
    DoStep step;
    GetReal get;
    SetSlopes slopes; /* NULL: inputs are held */
    unsigned u, y;
    double size, omega;
    size_t n;
} Loop;

static int larger(int a, int b)
{
    return a > b ? a : b;
}

/* n steps from t = 0 with u = sin(omega t); the output after each step goes to y. Returns the worst status. */
EXPORT int bare_loop(const Loop *loop, double *y)
{
    int worst = 0;
    for (size_t i = 0; i < loop->n; i++) {
        double t = (double)i * loop->size;
        double input = sin(loop->omega * t);
        worst = larger(worst, loop->set(loop->component, &loop->u, 1, &input));
        worst = larger(worst, loop->step(loop->component, t, loop->size, 1));
        worst = larger(worst, loop->get(loop->component, &loop->y, 1, &y[i]));
    }
    return worst;
}

/* The calls that the workbench makes: the input's slope where the FMU takes it, and the output on both sides of
 * each communication point, so that a jump of the input is seen as one. */
EXPORT int same_calls(const Loop *loop, double *y)
{
    const int order = 1;
    int worst = 0;
    double input = 0.0;
    for (size_t i = 0; i < loop->n; i++) {
        double t = (double)i * loop->size;
        double next = sin(loop->omega * (t + loop->size));
        double slope = (next - input) / loop->size;
        double right;
        if (loop->slopes != NULL) {
            worst = larger(worst, loop->slopes(loop->component, &loop->u, 1, &order, &slope));
        }
        worst = larger(worst, loop->step(loop->component, t, loop->size, 1));
        worst = larger(worst, loop->get(loop->component, &loop->y, 1, &y[i]));
        input = next;
        worst = larger(worst, loop->set(loop->component, &loop->u, 1, &input));
        worst = larger(worst, loop->get(loop->component, &loop->y, 1, &right));
    }
    return worst;
}
