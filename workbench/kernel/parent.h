/* parent.h: a worker process ends with its parent. */
#ifndef WORKBENCH_PARENT_H
#define WORKBENCH_PARENT_H

#include <stdint.h>

#ifdef _WIN32
#define KERNEL_EXPORT __declspec(dllexport)
#else
#define KERNEL_EXPORT __attribute__((visibility("default")))
#endif

/* End this process `grace_ms` after its parent ended; does not return. To be called by a thread of its own: it works
 * also while code that hangs keeps Python from running. `sentinel`: becomes readable (Windows: signalled) at the
 * parent's end. `parent`: its process number. */
KERNEL_EXPORT void kernel_end_with(intptr_t sentinel, int64_t parent, int32_t grace_ms);

#endif
