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
    int32_t missing;  /* a value that is not finite is recorded as it is, while another one is finite */
    int32_t keep;     /* 0: rows only go to `fourier` */
    int32_t no_feedthrough; /* the file says that no recorded value depends on an input directly */
    int32_t checked;        /* how often that was found true in this run */
    int32_t read;           /* whether the FMUs were asked for the last row */
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
/* Read the FMUs as they stand. `inputs`: what they see.
 *
 * Rows that nobody keeps, sums or bounds are not read. The right limit after co-simulation's inputs have changed is
 * not read where the file declares no feed-through: an FMU would compute all its outputs anew for it. The declaration
 * is not believed at once: the first rows of each run are read and compared. */
bool record_add(Record *record, System *system, double time, const double *inputs, RowKind kind);
/* Take a row that was read elsewhere; false: no memory. */
bool record_put(Record *record, const double *values, RowKind kind);
void record_free(Record *record);

#endif
