/* record.h: the rows of one run: time, forced inputs, recorded values; kept, or handed to Fourier sums, or both. */
#ifndef WORKBENCH_KERNEL_RECORD_H
#define WORKBENCH_KERNEL_RECORD_H

#include "fourier.h"
#include "system.h"

typedef struct {
    Access access; /* columns 0 … n_values-1 */
    size_t n_values;
    double bound;     /* a larger magnitude of a recorded value is a failure */
    Fourier *fourier; /* NULL: none */
    int32_t keep;     /* 0: rows only go to `fourier` */
    size_t every;     /* of the plain points only each n-th is kept; the first and the last row and events always are */
    /* Owned by the kernel; `record_free` frees them. */
    double *data; /* [rows][width] */
    size_t rows, capacity, width, skipped;
} Record;

typedef enum {
    ROW_ALWAYS, /* begin, end, event */
    ROW_POINT,  /* may be decimated */
    ROW_SECOND  /* the right limit of the row before: kept if that was */
} RowKind;

void record_begin(Record *record, const System *system);
/* Read the FMUs as they stand. `inputs`: what they see. */
bool record_add(Record *record, System *system, double time, const double *inputs, RowKind kind);
void record_free(Record *record);

#endif
