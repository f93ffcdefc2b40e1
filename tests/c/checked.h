/* checked.h: checks that are counted, and allocations that fail when asked to, for the drivers of the runtime.
 *
 * Linked with -Wl,--wrap=calloc,--wrap=realloc where the linker can (WRAP_CALLOC): then each allocation fails once.
 */
#ifndef CHECKED_H
#define CHECKED_H

#include <stdio.h>
#include <stdlib.h>

static int failures;
static long allowed = -1; /* allocations left before one fails, -1: all succeed */

static void check(int condition, const char *text, int line)
{
    if (!condition) {
        fprintf(stderr, "line %d: %s\n", line, text);
        failures++;
    }
}

static int granted(void)
{
    if (allowed == 0) {
        return 0;
    }
    allowed -= allowed > 0 ? 1 : 0;
    return 1;
}

#ifdef WRAP_CALLOC
void *__real_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size)
{
    return granted() ? __real_calloc(count, size) : NULL;
}
void *__real_realloc(void *block, size_t size);
void *__wrap_realloc(void *block, size_t size);
void *__wrap_realloc(void *block, size_t size)
{
    return granted() ? __real_realloc(block, size) : NULL;
}
#endif

#endif
