/* arithmetic.h: how the processor computes in this thread; FMUs may change it for whoever computes after them. */
#ifndef WORKBENCH_ARITHMETIC_H
#define WORKBENCH_ARITHMETIC_H

#include <stdint.h>

#include "parent.h"

/* What the processor's control words say of rounding, denormal numbers, precision and traps; not the flags that tell
 * what has happened. Comparable within one process only. */
KERNEL_EXPORT int64_t kernel_arithmetic(void);

#endif
