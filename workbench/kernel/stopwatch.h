/* stopwatch.h: a clock that only goes on. */
#ifndef WORKBENCH_KERNEL_STOPWATCH_H
#define WORKBENCH_KERNEL_STOPWATCH_H

/* Time since some instant [s]. */
double stopwatch(void);

#endif
