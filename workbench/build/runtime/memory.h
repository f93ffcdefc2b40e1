/* memory.h: every allocation of the runtime goes through one pair of functions.
 *
 * FMI 2.0 hands both over at instantiation; FMI 3.0 uses the C library's.
 */
#ifndef WORKBENCH_MEMORY_H
#define WORKBENCH_MEMORY_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef struct {
    void *(*allocate)(size_t count, size_t size); /* like calloc */
    void (*release)(void *block);                 /* like free */
} Memory;

/* Zeroed memory, at least one element, or NULL. */
static inline void *memory_new(const Memory *memory, size_t count, size_t size)
{
    size_t at_least_one = count > 0 ? count : 1;
    if (size > 0 && at_least_one > SIZE_MAX / size) {
        return NULL;
    }
    void *block = memory->allocate(at_least_one, size);
    if (block != NULL) {
        memset(block, 0, at_least_one * size);
    }
    return block;
}

static inline void memory_delete(const Memory *memory, void *block)
{
    if (block != NULL) {
        memory->release(block);
    }
}

#endif
