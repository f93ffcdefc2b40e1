#define _POSIX_C_SOURCE 200809L /* getppid, kill, poll */

#include "parent.h"

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>

void kernel_end_with(intptr_t sentinel, int64_t parent, int32_t grace_ms) {
    (void)parent;
    WaitForSingleObject((HANDLE)sentinel, INFINITE);
    Sleep((DWORD)grace_ms);
    TerminateProcess(GetCurrentProcess(), 1);
}
#else
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

/* Interval at which the parent is compared with the one of the beginning [ms]. */
enum { PATIENCE = 1000 };

void kernel_end_with(intptr_t sentinel, int64_t parent, int32_t grace_ms) {
    struct pollfd end = {.fd = (int)sentinel, .events = 0}; /* its end; an FMU may write what it wants into it */
    int ready = 0;
    /* A copy of the parent made by fork keeps the pipe open; the system names another parent then. */
    while (getppid() == (pid_t)parent && (ready == 0 || (ready < 0 && errno == EINTR))) {
        ready = poll(&end, 1, PATIENCE);
    }
    poll(NULL, 0, grace_ms);
    if (getpgrp() == getpid()) {
        kill(0, SIGKILL); /* with the processes that the FMU has started */
    }
    _exit(1);
}
#endif
