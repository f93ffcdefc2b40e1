/* access.h: reading and writing a fixed list of variables as doubles, one FMI call for each type and component.
 *
 * The twin of workbench/fmi/access.py. The caller owns all memory a block points to.
 */
#ifndef WORKBENCH_KERNEL_ACCESS_H
#define WORKBENCH_KERNEL_ACCESS_H

#include <string.h>

#include "component.h"

/* C type of one value. The order is that of TYPES in workbench/kernel/structs.py. */
typedef enum {
    FLOAT64,
    FLOAT32,
    INT8,
    UINT8,
    INT16,
    UINT16,
    INT32,
    UINT32,
    INT64,
    UINT64,
    BOOLEAN8,  /* one byte: FMI 1.0 and 3.0 */
    BOOLEAN32, /* int: FMI 2.0 */
    TICKS,     /* of clocks so far: doubles in `buffer`, which the FMU is not asked for */
    N_TYPES
} ValueType;

typedef struct {
    Function get, set; /* NULL: not there */
    const char *get_name, *set_name;
    const uint32_t *references;
    size_t n_references;
    void *buffer; /* [n_values] of `type` */
    size_t n_values;
    const size_t *slots;   /* [n] where in the buffer */
    const size_t *columns; /* [n] where in the caller's list */
    size_t n;
    int32_t type, component;
    int32_t partial; /* the buffer holds array elements that are not ours: read before each write */
    int32_t plain;   /* doubles in the caller's order from `columns[0]` on: no conversion, the buffer is not used */
} Block;

typedef struct {
    Block *blocks;
    size_t n_blocks;
} Access;

/* Copy a few values: usually one, for which a call of the library takes longer than the copy. */
static inline void copy_values(double *to, const double *from, size_t n) {
    if (n == 1) {
        to[0] = from[0];
    } else {
        memcpy(to, from, n * sizeof *to);
    }
}

/* What the FMU would see if it were given `value`: integers are rounded, Booleans are value >= 0.5. */
double value_as_type(ValueType type, double value);

bool block_read(const Block *block, Component *components, double *values, Failure *failure);
bool block_write(Block *block, Component *components, const double *values, Failure *failure);
bool access_read(const Access *access, Component *components, double *values, Failure *failure);
bool access_write(Access *access, Component *components, const double *values, Failure *failure);

#endif
