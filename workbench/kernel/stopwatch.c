#define _POSIX_C_SOURCE 200809L /* clock_gettime */

#include "stopwatch.h"

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

double stopwatch(void) {
    LARGE_INTEGER ticks = {0}, per_second = {0};
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&per_second);
    return (double)ticks.QuadPart / (double)per_second.QuadPart;
}
#else
#include <time.h>

double stopwatch(void) {
    struct timespec read = {0};
    clock_gettime(CLOCK_MONOTONIC, &read);
    return (double)read.tv_sec + 1e-9 * (double)read.tv_nsec;
}
#endif
