#include "record.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_ROWS = 512, ENOUGH_CHECKS = 16 };

void record_begin(Record *record, const System *system) {
    const size_t width = 1 + system->forcing->n + record->n_values;
    /* The memory of wider or narrower rows is used again. */
    record->capacity = record->width ? record->capacity * record->width / width : 0;
    record->width = width;
    record->rows = 0;
    record->skipped = 0;
    record->checked = 0;
    if (record->fourier) {
        fourier_clear(record->fourier);
    }
}

static bool grow(Record *record) {
    const size_t capacity = record->capacity ? 2 * record->capacity : FIRST_ROWS;
    if (capacity > SIZE_MAX / sizeof(double) / record->width) {
        return false;
    }
    double *data = realloc(record->data, capacity * record->width * sizeof(double));
    if (data) {
        record->data = data;
        record->capacity = capacity;
    }
    return data != NULL;
}

static bool some_finite(const double *values, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (isfinite(values[i])) {
            return true;
        }
    }
    return false;
}

static bool check_values(const Record *record, System *system, double time, const double *values) {
    for (size_t i = 0; i < record->n_values; i++) {
        if (!isfinite(values[i])) {
            if (record->missing && some_finite(values, record->n_values)) {
                continue;
            }
            return fail_value(&system->failure, FAILED_VALUE, time, i, values[i]);
        }
        if (fabs(values[i]) > record->bound) {
            return fail_value(&system->failure, FAILED_BOUND, time, i, values[i]);
        }
    }
    return true;
}

static bool is_kept(Record *record, RowKind kind) {
    if (kind == ROW_SECOND) {
        return record->skipped == 0;
    }
    const bool skip = kind == ROW_POINT && record->skipped + 1 < record->every;
    record->skipped = skip ? record->skipped + 1 : 0;
    return !skip;
}

static bool read_values(Record *record, System *system, double time, double *values) {
    record->read = 1;
    return access_read(&record->access, system->components, values, &system->failure) &&
           check_values(record, system, time, values);
}

/* Read the values just after inputs changed; `left` are those just before. */
static bool read_second(Record *record, System *system, double time, double *values, const double *left) {
    const size_t size = record->n_values * sizeof(double);
    if (!record->no_feedthrough) {
        return read_values(record, system, time, values);
    }
    if (record->checked < ENOUGH_CHECKS) {
        double *fresh = values + record->width; /* in the row behind, which is free */
        if (!read_values(record, system, time, fresh)) {
            return false;
        }
        record->checked++;
        record->no_feedthrough = memcmp(fresh, left, size) == 0;
        left = fresh;
    }
    memmove(values, left, size);
    return true;
}

/* Make room for a row and for what is read behind it. */
static bool has_room(Record *record) {
    return record->rows + 1 < record->capacity || grow(record);
}

static void put(Record *record, const double *row, bool kept) {
    if (record->fourier) {
        fourier_add(record->fourier, row);
    }
    record->rows += kept;
}

bool record_put(Record *record, const double *values, RowKind kind) {
    const bool kept = record->keep && is_kept(record, kind);
    if (!kept && !record->fourier) {
        return true;
    }
    if (!has_room(record)) {
        return false;
    }
    double *row = record->data + record->rows * record->width;
    memcpy(row, values, record->width * sizeof *row);
    put(record, row, kept);
    return true;
}

bool record_add(Record *record, System *system, double time, const double *inputs, RowKind kind) {
    record->read = 0;
    const bool kept = record->keep && is_kept(record, kind);
    if (!kept && !record->fourier && !isfinite(record->bound)) {
        return true;
    }
    if (!has_room(record)) {
        return fail_at(&system->failure, FAILED_MEMORY, time);
    }
    const size_t n = system->forcing->n;
    double *row = record->data + record->rows * record->width;
    row[0] = time;
    copy_values(row + 1, inputs, n);
    double *values = row + 1 + n;
    /* The row before this one was kept if this one is; else it still stands where this one goes. */
    const double *left = values - (kept ? record->width : 0);
    if (!(kind == ROW_SECOND ? read_second(record, system, time, values, left)
                             : read_values(record, system, time, values))) {
        return false;
    }
    put(record, row, kept);
    return true;
}

void record_free(Record *record) {
    free(record->data);
    record->data = NULL;
    record->rows = record->capacity = record->width = 0;
}
