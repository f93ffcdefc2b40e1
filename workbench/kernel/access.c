#include "access.h"

#include <math.h>

typedef int (*Plain)(void *, const uint32_t *, size_t, void *);
typedef int (*Sized)(void *, const uint32_t *, size_t, void *, size_t);

static bool is_integer(ValueType type) {
    return type >= INT8 && type <= UINT64;
}

double value_as_type(ValueType type, double value) {
    if (type == BOOLEAN8 || type == BOOLEAN32) {
        return value >= 0.5 ? 1.0 : 0.0;
    }
    return is_integer(type) ? nearbyint(value) : value;
}

static int64_t whole(double value) {
    if (!(value > -0x1p63)) {
        return INT64_MIN;
    }
    return value < 0x1p63 ? (int64_t)nearbyint(value) : INT64_MAX;
}

static uint64_t natural(double value) {
    if (value < 0x1p63) {
        return (uint64_t)whole(value);
    }
    return value < 0x1p64 ? (uint64_t)value : UINT64_MAX;
}

static double decoded(const Block *block, size_t slot) {
    const char *base = block->buffer;
    switch ((ValueType)block->type) {
    case FLOAT64: return ((const double *)block->buffer)[slot];
    case FLOAT32: return (double)((const float *)block->buffer)[slot];
    case INT8: return ((const int8_t *)block->buffer)[slot];
    case UINT8: return ((const uint8_t *)block->buffer)[slot];
    case INT16: return ((const int16_t *)block->buffer)[slot];
    case UINT16: return ((const uint16_t *)block->buffer)[slot];
    case INT32: return ((const int32_t *)block->buffer)[slot];
    case UINT32: return ((const uint32_t *)block->buffer)[slot];
    case INT64: return (double)((const int64_t *)block->buffer)[slot];
    case UINT64: return (double)((const uint64_t *)block->buffer)[slot];
    case BOOLEAN8: return base[slot] != 0 ? 1.0 : 0.0;
    case BOOLEAN32: return ((const int32_t *)block->buffer)[slot] != 0 ? 1.0 : 0.0;
    case TICKS:
    case N_TYPES: break;
    }
    return (double)NAN;
}

static void encode(const Block *block, size_t slot, double value) {
    switch ((ValueType)block->type) {
    case FLOAT64: ((double *)block->buffer)[slot] = value; break;
    case FLOAT32: ((float *)block->buffer)[slot] = (float)value; break;
    case INT8: ((int8_t *)block->buffer)[slot] = (int8_t)whole(value); break;
    case UINT8: ((uint8_t *)block->buffer)[slot] = (uint8_t)whole(value); break;
    case INT16: ((int16_t *)block->buffer)[slot] = (int16_t)whole(value); break;
    case UINT16: ((uint16_t *)block->buffer)[slot] = (uint16_t)whole(value); break;
    case INT32: ((int32_t *)block->buffer)[slot] = (int32_t)whole(value); break;
    case UINT32: ((uint32_t *)block->buffer)[slot] = (uint32_t)whole(value); break;
    case INT64: ((int64_t *)block->buffer)[slot] = whole(value); break;
    case UINT64: ((uint64_t *)block->buffer)[slot] = natural(value); break;
    case BOOLEAN8: ((char *)block->buffer)[slot] = value >= 0.5; break;
    case BOOLEAN32: ((int32_t *)block->buffer)[slot] = value >= 0.5; break;
    case TICKS:
    case N_TYPES: break;
    }
}

/* FMI's setters take a pointer to const; one signature serves getters and setters here. */
static bool block_call(const Block *block, const Component *component, Function function, const char *name,
                       void *buffer, Failure *failure) {
    int status = NOT_EXPORTED;
    if (function && component->calls->sized) {
        status = ((Sized)function)(component->handle, block->references, block->n_references, buffer, block->n_values);
    } else if (function) {
        status = ((Plain)function)(component->handle, block->references, block->n_references, buffer);
    }
    if (status >= 0 && status <= FMI_WARNING) {
        return true;
    }
    if (failure->code == NO_FAILURE) {
        failure->status = status;
        failure->component = block->component;
        failure->function = -1;
        failure->name = name;
    }
    return fail_at(failure, function ? FAILED_STATUS : FAILED_MISSING, component->time);
}

bool block_read(const Block *block, Component *components, double *values, Failure *failure) {
    if (block->type == TICKS) {
        for (size_t i = 0; i < block->n; i++) {
            values[block->columns[i]] = ((const double *)block->buffer)[block->slots[i]];
        }
        return true;
    }
    void *buffer = block->plain ? values + block->columns[0] : block->buffer;
    if (!block_call(block, &components[block->component], block->get, block->get_name, buffer, failure)) {
        return false;
    }
    if (block->plain) {
        return true;
    }
    for (size_t i = 0; i < block->n; i++) {
        values[block->columns[i]] = decoded(block, block->slots[i]);
    }
    return true;
}

static bool complete(Block *block, const Component *component, Failure *failure) {
    return !block->partial || block_call(block, component, block->get, block->get_name, block->buffer, failure);
}

bool block_write(Block *block, Component *components, const double *values, Failure *failure) {
    const Component *component = &components[block->component];
    if (block->plain) {
        double *own = (double *)values + block->columns[0];
        return block_call(block, component, block->set, block->set_name, own, failure);
    }
    if (!complete(block, component, failure)) {
        return false;
    }
    for (size_t i = 0; i < block->n; i++) {
        encode(block, block->slots[i], values[block->columns[i]]);
    }
    return block_call(block, component, block->set, block->set_name, block->buffer, failure);
}

bool access_read(const Access *access, Component *components, double *values, Failure *failure) {
    for (size_t i = 0; i < access->n_blocks; i++) {
        if (!block_read(&access->blocks[i], components, values, failure)) {
            return false;
        }
    }
    return true;
}

bool access_write(Access *access, Component *components, const double *values, Failure *failure) {
    for (size_t i = 0; i < access->n_blocks; i++) {
        if (!block_write(&access->blocks[i], components, values, failure)) {
            return false;
        }
    }
    return true;
}
