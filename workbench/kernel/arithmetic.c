#include "arithmetic.h"

#include <fenv.h>

#if defined __x86_64__
#include <xmmintrin.h>

int64_t kernel_arithmetic(void) {
    const uint32_t flags = 0x3f; /* sticky: what has happened */
    uint16_t older = 0;          /* of the unit that long double uses, and that fegetround asks */
    __asm__ volatile("fnstcw %0" : "=m"(older));
    return (int64_t)(_mm_getcsr() & ~flags) << 16 | older;
}
#elif defined __aarch64__
int64_t kernel_arithmetic(void) {
    uint64_t control = 0;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return (int64_t)control;
}
#else
int64_t kernel_arithmetic(void) {
    return fegetround();
}
#endif
